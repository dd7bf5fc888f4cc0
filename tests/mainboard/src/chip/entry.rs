//! The delay of interrupt entry, and the clock registers of the F446 that the F427 lacks.
//!
//! The core enters a handler in 12 cycles (PM0214 rev 10, 2.3.7), more with wait states or a
//! floating-point frame; rigless's core enters in 0. The delay matters for the step timer's
//! interrupt only. That interrupt has the highest priority and is never masked, so [`Entry`] delays
//! every request of it, and the run holds the core meanwhile: it is stacking registers. A request
//! that its peripheral withdraws in that time does not arrive.
//!
//! **Left out:** the entries of all other interrupts, which only cost processor time; tail-chaining
//! (a handler that follows another pays the whole delay again); and all other delays of single
//! instructions, whose mean is in [`crate::machine::INSTRUCTIONS_PER_SECOND`].

use rigless::device::{Device, DeviceContext, InterruptChange, Level, RegisterFile};
use rigless::emulator::InterruptLine;
use rigless::soc::{Access, Layout, Peripheral, ReadAction, RegisterSpec, Width, WriteModify};
use rigless::time::{EventId, VirtualNanos};

/// 12 cycles at 168 MHz, ns.
pub const ENTRY_NS: u64 = 71;
/// TIM2's line, RM0090 table 62.
const STEP_TIMER: u16 = 28;

const fn word(name: &'static str, offset: u32) -> RegisterSpec {
    RegisterSpec {
        name,
        offset,
        width: Width::W32,
        reset: 0,
        access: Access::ReadWrite,
        read: ReadAction::None,
        write: WriteModify::None,
        fields: &[],
    }
}

/// The address of [`Entry`] on the bus, which is empty on the chip and which no firmware accesses.
pub const PERIPHERAL: Peripheral =
    Peripheral { name: "ENTRY", base: 0x400F_F000, size: 4, interrupts: &[], registers: &REGISTERS };
static REGISTERS: [RegisterSpec; 1] = [word("NONE", 0)];

/// The layout of an instance of plain words.
#[derive(Debug, Clone, Copy)]
pub struct Nothing;

impl Layout for Nothing {
    const REGISTERS: &'static [RegisterSpec] = &REGISTERS;
    fn from_index(index: usize) -> Option<Self> {
        (index == 0).then_some(Self)
    }
    fn index(self) -> usize {
        0
    }
}

/// The delay from a peripheral's request to the handler's first instruction.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Entry {
    delay_ns: u64,
    /// Delayed requests: instant of arrival, and line.
    waiting: Vec<(VirtualNanos, u16)>,
}

impl Entry {
    /// A delay, ns.
    #[must_use]
    pub const fn new(delay_ns: u64) -> Self {
        Self { delay_ns, waiting: Vec::new() }
    }

    /// True if a handler is being entered.
    #[must_use]
    pub const fn is_entering(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// The delay, ns.
    #[must_use]
    pub const fn delay_ns(&self) -> u64 {
        self.delay_ns
    }
}

impl Device for Entry {
    type Register = Nothing;

    fn on_interrupt(&mut self, change: InterruptChange, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let Some(line) = InterruptLine::new(change.interrupt) else { return };
        if change.level == Level::High && self.delay_ns > 0 && change.interrupt == STEP_TIMER {
            let at = VirtualNanos(context.now().0 + self.delay_ns);
            self.waiting.push((at, change.interrupt));
            context.schedule(at);
        } else {
            self.waiting.retain(|(_, waiting)| *waiting != change.interrupt);
            context.drive_line(line, change.level);
        }
    }

    fn on_event(&mut self, _: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let now = context.now();
        for (at, line) in &self.waiting {
            if *at <= now
                && let Some(line) = InterruptLine::new(*line)
            {
                context.drive_line(line, Level::High);
            }
        }
        self.waiting.retain(|(at, _)| *at > now);
    }

    fn reset(&mut self) {
        self.waiting.clear();
    }
}

/// RCC_CKGATENR and RCC_DCKCFGR2 of the F446 (RM0390 6.3.27, 6.3.28), after the registers that
/// the F427 has too.
pub const CLOCKS_F446: Peripheral =
    Peripheral { name: "RCC_F446", base: 0x4002_3890, size: 8, interrupts: &[], registers: &CLOCK_REGISTERS };
static CLOCK_REGISTERS: [RegisterSpec; 2] = [word("CKGATENR", 0), word("DCKCFGR2", 4)];
/// CK48MSEL: the source of the USB core's clock; 0 is the main PLL's Q.
const CK48MSEL: u64 = 1 << 27;

/// The layout of [`CLOCKS_F446`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockRegister {
    /// CKGATENR: gates that save current, with no other effect.
    Ckgatenr,
    /// DCKCFGR2: sources of some kernels' clocks.
    Dckcfgr2,
}

impl Layout for ClockRegister {
    const REGISTERS: &'static [RegisterSpec] = &CLOCK_REGISTERS;
    fn from_index(index: usize) -> Option<Self> {
        [Self::Ckgatenr, Self::Dckcfgr2].get(index).copied()
    }
    fn index(self) -> usize {
        self as usize
    }
}

/// Stores both registers, and reports a source of USB's clock that is not modelled.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct ClocksF446;

impl Device for ClocksF446 {
    type Register = ClockRegister;

    fn write(&mut self, register: ClockRegister, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if register == ClockRegister::Dckcfgr2 && value & CK48MSEL != 0 {
            context.tell("DCKCFGR2", "CK48MSEL takes USB's clock from PLLSAI, which is not modelled (RM0390 6.3.28)");
        }
    }
}
