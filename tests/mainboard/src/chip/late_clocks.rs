//! Clock enables that take effect late, as an option: an access to an instance too soon after
//! its enable is lost.
//!
//! ES0206 rev 24 2.2.7 (and the same erratum of the F405 and F407 in ES0182): after the bit is set,
//! an instance on an AHB answers two cycles later, one on an APB 1 + (AHB clock / APB clock) of its
//! bus's cycles later. A read of the enable register in between waits for the store before it: one
//! of the sheets' three workarounds. A read from an instance without a clock answers 0, a write has
//! no effect; the run reports an access that a closed gate of "LATE_CLOCKS" refused.
//!
//! rigless opens an instance at the write itself. With the option the bus checks a copy of the four
//! enable registers instead, which follows the true ones with this delay. The run reports each
//! access ([`super::Stm32f4::reached`]).
//!
//! | Behaviour | Test |
//! |---|---|
//! | an access right after the enable is lost, on an AHB and on an APB; one after the delay is answered |
//! `an_access_right_after_the_enable_is_lost` |
//! | a read-back of the enable ends the wait | `a_read_back_ends_the_wait` |
//! | a cleared bit closes at once; without the option enables have no delay |
//! `without_the_option_enables_have_no_delay` |
//!
//! **Left out**
//!
//! | What | Why |
//! |---|---|
//! | the clock's own rate | the run has a constant rate of instructions whatever the clock tree, so cycles are those of
//! 168 MHz |
//! | a barrier (DSB) in place of the read-back | no model sees it: code that relies on it is reported although it is
//! correct |
//! | AHB3 | no instance on it is modelled |

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32f427::generated::rcc;
use rigless::soc::{Gate, Layout, Peripheral, RegisterSpec};
use rigless::time::{EventId, VirtualNanos};

/// Core cycles per second, as in the run's rate of instructions.
const CYCLES_HZ: u64 = 168_000_000;
/// Cycles until an instance on an AHB answers.
const AHB_CYCLES: u64 = 2;
/// Address of the enable registers' block, RM0090 7.3.
const RCC: u64 = 0x4002_3800;

/// The true enable registers of the copies.
const ENABLES: [rcc::Register; 4] =
    [rcc::Register::Ahb1enr, rcc::Register::Ahb2enr, rcc::Register::Apb1enr, rcc::Register::Apb2enr];

static REGISTERS: [RegisterSpec; 4] = [
    rcc::REGISTERS[rcc::Register::Ahb1enr as usize],
    rcc::REGISTERS[rcc::Register::Ahb2enr as usize],
    rcc::REGISTERS[rcc::Register::Apb1enr as usize],
    rcc::REGISTERS[rcc::Register::Apb2enr as usize],
];

/// The copies' address on the bus, which is empty on the chip and which no firmware accesses.
pub const PERIPHERAL: Peripheral =
    Peripheral { name: "LATE_CLOCKS", base: 0x400F_F100, size: 0x80, interrupts: &[], registers: &REGISTERS };

/// The gate of the copy.
pub fn late(gate: Gate) -> Gate {
    Gate { instance: PERIPHERAL.name, ..gate }
}

/// The layout of the copies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Copy(usize);

impl Layout for Copy {
    const REGISTERS: &'static [RegisterSpec] = &REGISTERS;
    fn from_index(index: usize) -> Option<Self> {
        (index < REGISTERS.len()).then_some(Self(index))
    }
    fn index(self) -> usize {
        self.0
    }
}

/// The enables that are still waiting.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct LateClocks {
    /// The option is on.
    is_on: bool,
    /// The instant at which bits open.
    waiting: Vec<(VirtualNanos, Copy, u64)>,
}

impl LateClocks {
    /// Switches the option on.
    pub(super) fn switch_on(&mut self) {
        self.is_on = true;
    }

    /// True if the option is on.
    pub(super) const fn is_on(&self) -> bool {
        self.is_on
    }

    /// The state after a reset.
    pub(super) const fn fresh(&self) -> Self {
        Self { is_on: self.is_on, waiting: Vec::new() }
    }

    /// Follows a write to the true register, which now holds `enabled`.
    pub(super) fn written(
        &mut self,
        copy: Copy,
        enabled: u64,
        delay_ns: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let open = registers.get(copy) & enabled;
        registers.set(copy, open);
        let mut new = enabled & !open;
        for (_, of, bits) in &mut self.waiting {
            if *of == copy {
                *bits &= enabled;
                new &= !*bits;
            }
        }
        if new != 0 {
            let at = VirtualNanos(context.now().0 + delay_ns);
            self.waiting.push((at, copy, new));
            context.schedule(at);
        }
    }

    /// Opens the bits of all waiting enables for which `is_due` holds.
    pub(super) fn open(&mut self, registers: &mut RegisterFile, is_due: impl Fn(VirtualNanos, Copy) -> bool) {
        for (at, copy, bits) in &self.waiting {
            if is_due(*at, *copy) {
                registers.set(*copy, registers.get(*copy) | bits);
            }
        }
        self.waiting.retain(|(at, copy, _)| !is_due(*at, *copy));
    }
}

impl Device for LateClocks {
    type Register = Copy;

    fn on_event(&mut self, _: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let now = context.now();
        self.open(registers, |at, _| at <= now);
    }

    fn reset(&mut self) {
        self.waiting.clear();
    }
}

/// The copy of the enable register at an address, and the true one.
pub(super) fn enable_at(address: u64) -> Option<(Copy, rcc::Register)> {
    ENABLES
        .into_iter()
        .enumerate()
        .find(|(_, enable)| address & !3 == RCC + u64::from(Layout::spec(*enable).offset))
        .map(|(index, enable)| (Copy(index), enable))
}

/// The delay of an enable, ns; `cfgr` holds the prescalers.
pub(super) fn delay_ns(enable: rcc::Register, cfgr: u64) -> u64 {
    cycles(enable, cfgr) * 1_000_000_000 / CYCLES_HZ
}

/// The delay of an enable, cycles of the AHB. PPRE1 and PPRE2: RM0090 7.3.3.
fn cycles(enable: rcc::Register, cfgr: u64) -> u64 {
    let prescaler = |code: u64| if code & 0b100 == 0 { 1 } else { 2 << (code & 0b11) };
    let bus_cycles = |prescaler: u64| prescaler * (1 + prescaler);
    match enable {
        rcc::Register::Apb1enr => bus_cycles(prescaler(cfgr >> 10 & 0b111)),
        rcc::Register::Apb2enr => bus_cycles(prescaler(cfgr >> 13 & 0b111)),
        _ => AHB_CYCLES,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rigless::emulator::AccessKind;
    use rigless::mcu::Operate;
    use rigless::soc::Width;

    use super::super::Stm32f4;
    use super::*;
    use crate::wiring::Chip as Model;

    const AHB1ENR: u64 = RCC + 0x30;
    const APB1ENR: u64 = RCC + 0x40;
    const GPIOA_ODR: u64 = 0x4002_0014;
    const TIM2_ARR: u64 = 0x4000_002C;

    struct Bench(Stm32f4);

    impl Bench {
        fn late() -> Self {
            let mut chip = Stm32f4::new(Model::F407).unwrap();
            chip.start_clocks_late();
            Self(chip)
        }

        fn write(&mut self, at_ns: u64, address: u64, value: u64) -> bool {
            let at = VirtualNanos(at_ns);
            self.0.advance_to(at);
            let answered = self.0.write(at, address, Width::W32, value).is_ok();
            self.0.reached(at, AccessKind::Write, address);
            answered
        }

        fn read(&mut self, at_ns: u64, address: u64) -> bool {
            let at = VirtualNanos(at_ns);
            self.0.advance_to(at);
            let answered = self.0.read(at, address, Width::W32).is_ok();
            self.0.reached(at, AccessKind::Read, address);
            answered
        }
    }

    #[test]
    fn an_access_right_after_the_enable_is_lost() {
        // Two cycles are 11 ns. An APB with PPRE 0 takes as long.
        for (enable, instance) in [(AHB1ENR, GPIOA_ODR), (APB1ENR, TIM2_ARR)] {
            let mut bench = Bench::late();
            assert!(bench.write(1_000, enable, 1));
            assert!(!bench.write(1_008, instance, 7), "{instance:#x}");
            assert!(!bench.read(1_010, instance));
            assert!(bench.write(1_016, instance, 7) && bench.read(1_020, instance));
        }
        // PPRE1 = 4: five cycles of the bus, 119 ns.
        let mut bench = Bench::late();
        assert!(bench.write(0, RCC + 8, 0b101 << 10) && bench.write(1_000, APB1ENR, 1));
        assert!(!bench.write(1_118, TIM2_ARR, 7));
        assert!(bench.write(1_120, TIM2_ARR, 7));
    }

    #[test]
    fn a_read_back_ends_the_wait() {
        let mut bench = Bench::late();
        assert!(bench.write(1_000, AHB1ENR, 1) && bench.read(1_004, APB1ENR));
        assert!(!bench.write(1_005, GPIOA_ODR, 1), "reading another register does not help");
        assert!(bench.read(1_006, AHB1ENR) && bench.write(1_007, GPIOA_ODR, 1));
        assert!(bench.write(1_008, AHB1ENR, 0) && !bench.write(1_100, GPIOA_ODR, 1), "closed at once");
    }

    #[test]
    fn without_the_option_enables_have_no_delay() {
        let mut bench = Bench(Stm32f4::new(Model::F407).unwrap());
        assert!(bench.write(1_000, AHB1ENR, 1) && bench.write(1_000, GPIOA_ODR, 1));
    }
}
