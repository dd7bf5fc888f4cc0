//! The external interrupt controller of RM0090 rev 22 chapter 12, and the system configuration
//! controller of chapter 9, which selects the port of each of its first 16 lines.
//!
//! | Section | Behaviour | Test |
//! |---|---|---|
//! | 9.2.3 to 9.2.6 | SYSCFG_EXTICR1 to 4: line n follows pin n of the selected port |
//! `a_line_follows_the_selected_port` |
//! | 12.2.5, 12.3.3, 12.3.4 | rising and falling edges, each with its own bit | `an_edge_sets_pending_by_its_direction`
//! |
//! | 12.3.1 | IMR passes a pending line to the interrupt controller | `a_masked_line_is_pending_and_silent` |
//! | 12.3.5 | SWIER makes a line pending; clearing it clears the bit | `software_makes_a_line_pending` |
//! | 12.3.6 | PR is cleared by writing one | `a_written_one_clears_pending` |
//! | table 62 | lines 0 to 4 have an interrupt each, 5 to 9 and 10 to 15 share one | `lines_share_interrupts` |
//!
//! **Left out**
//!
//! | Section | What | Why |
//! |---|---|---|
//! | 12.2.3, 12.3.2 | events (EMR), which wake the core from WFE | stored; the firmware never waits for an event |
//! | 12.2.5 | lines 16 to 22 (supply, RTC, USB, Ethernet) | no model drives them |
//! | 9.2.1, 9.2.2, 9.2.7 | memory remap, Ethernet interface, compensation cell | stored; boards here boot from flash and have no Ethernet |

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::exti::Register;
use rigless::soc::stm32f427::generated::syscfg;
use rigless::soc::stm32f427::peripherals::PORTS;

/// Number of lines from pins.
const LINES: usize = 16;
/// Position of each interrupt in the instance's table: one for each of lines 0 to 4, then 9
/// to 5 and 15 to 10.
const INTERRUPTS: [u64; 7] = [1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 0x03E0, 0xFC00];

/// The system configuration controller. It reports the selection to the EXTI by requests: number 16
/// x line + port, high for the selected port.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Syscfg {
    chosen: [u8; LINES],
}

impl Device for Syscfg {
    type Register = syscfg::Register;

    fn write(
        &mut self,
        register: syscfg::Register,
        _: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let first = match register {
            syscfg::Register::Exticr1 => 0,
            syscfg::Register::Exticr2 => 4,
            syscfg::Register::Exticr3 => 8,
            syscfg::Register::Exticr4 => 12,
            _ => return,
        };
        let value = registers.get(register);
        for (place, line) in (first..first + 4).enumerate() {
            let port = (value >> (4 * place) & 0xF) as u8;
            if self.chosen[line] != port {
                context.request(16 * line + usize::from(self.chosen[line]), Level::Low);
                context.request(16 * line + usize::from(port), Level::High);
                self.chosen[line] = port;
            }
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

/// The external interrupt controller.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Exti {
    /// Level of each pin of each port as it last announced it; a bit a pin.
    levels: [u16; PORTS.len()],
    /// Pins with a known level. The first announced level is not an edge: the level of a
    /// floating pin is unknown.
    known: [u16; PORTS.len()],
    chosen: [u8; LINES],
    driven: [Level; INTERRUPTS.len()],
}

impl Default for Exti {
    fn default() -> Self {
        Self {
            levels: [0; PORTS.len()],
            known: [0; PORTS.len()],
            chosen: [0; LINES],
            driven: [Level::Low; INTERRUPTS.len()],
        }
    }
}

impl Exti {
    fn settle(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let passed = registers.get(Register::Pr) & registers.get(Register::Imr);
        for (position, lines) in INTERRUPTS.into_iter().enumerate() {
            let level = Level::from(passed & lines != 0);
            if self.driven[position] != level {
                self.driven[position] = level;
                context.interrupt(position, level);
            }
        }
    }

    fn pin(&mut self, port: usize, pin: usize, level: Level, registers: &mut RegisterFile) {
        let bit = 1u16 << pin;
        let high = level == Level::High;
        let was_high = self.levels[port] & bit != 0;
        let was_known = self.known[port] & bit != 0;
        self.known[port] |= bit;
        self.levels[port] = if high { self.levels[port] | bit } else { self.levels[port] & !bit };
        if !was_known || was_high == high || usize::from(self.chosen[pin]) != port {
            return;
        }
        let edges = registers.get(if high { Register::Rtsr } else { Register::Ftsr });
        if edges & u64::from(bit) != 0 {
            let pending = registers.get(Register::Pr);
            registers.set(Register::Pr, pending | u64::from(bit));
        }
    }
}

impl Device for Exti {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let pending = registers.get(Register::Pr);
        match register {
            Register::Swier => registers.set(Register::Pr, pending | value & 0x007F_FFFF),
            Register::Pr => {
                let software = registers.get(Register::Swier);
                registers.set(Register::Swier, software & !value);
            }
            _ => {}
        }
        self.settle(registers, context);
    }

    fn on_request(&mut self, request: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if let Some(port) = PORTS.iter().position(|name| *name == request.instance) {
            if request.request < LINES {
                self.pin(port, request.request, request.level, registers);
                self.settle(registers, context);
            }
        } else if request.instance == "SYSCFG" && request.level == Level::High {
            let (line, port) = (request.request / 16, request.request % 16);
            if line < LINES {
                self.chosen[line] = port as u8;
            }
        }
    }

    fn reset(&mut self) {
        self.chosen = [0; LINES];
        self.driven = [Level::Low; INTERRUPTS.len()];
        // Ports announce their pins again after a reset of the whole chip.
        self.known = [0; PORTS.len()];
    }
}
