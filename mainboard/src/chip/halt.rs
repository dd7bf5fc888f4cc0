//! A core that stands still while the rest of the chip goes on: halted by a debugger, or stuck.
//!
//! rigless's debugger stops virtual time with the core, so that nothing shows of what a probe's halt does on a bench: timers go on
//! switching heaters, and the watchdog counts or not as DBGMCU says (RM0090 21.3.3, 38.16.4). Here the run holds the core
//! and lets time pass ([`Stm32f4::halt`]).
//!
//! | Section | Behaviour | Test |
//! |---|---|---|
//! | 38.16.4 | with DBG_IWDG_STOP the watchdog stands still while a debugger holds the core | `the_watchdog_stands_still_under_a_debugger_if_its_bit_is_set` |
//! | 21.3.3 | without it, and whenever the core hangs by itself, the watchdog counts | the same |
//! | 6.1.1 | a reset lets the core go: its halt request does not outlive it | the same |
//!
//! **Left out:** the other freeze bits of DBGMCU_APB1_FZ and APB2_FZ (timers, the buses' time-outs): a model of a timer has no input for
//! it. A firmware that sets one would be shown with a timer that goes on.

use rigless::device::Device;
use rigless::soc::stm32f427::generated::{dbg, rcc};
use rigless::time::VirtualNanos;

use super::{Field, Stm32f4};

/// DBG_IWDG_STOP in DBGMCU_APB1_FZ, RM0090 38.16.4.
const IWDG_STOP: u64 = 1 << 12;
/// LSIRDY in RCC_CSR, 7.3.21.
const LSI_READY: u64 = 1 << 1;

/// What keeps the core from running.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Halt {
    /// Nothing.
    #[default]
    Runs,
    /// A debugger.
    Debugger,
    /// Itself: locked up, or in a loop with its interrupts off.
    Stuck,
}

impl Stm32f4 {
    /// Stops the core, or lets it go.
    pub fn halt(&mut self, at: VirtualNanos, halt: Halt) {
        self.halt = halt;
        let freezes = Self::registers(&self.bus, self.slot(Field::Dbg)).get(dbg::Register::DbgmcuApb1Fz) & IWDG_STOP;
        let ready = Self::registers(&self.bus, self.slot(Field::Rcc)).get(rcc::Register::Csr) & LSI_READY != 0;
        let hz = match halt {
            Halt::Debugger if freezes != 0 => 0,
            _ if ready => self.rcc.lsi_hz(),
            _ => 0,
        };
        let slot = self.slot(Field::Iwdg);
        let (registers, mut context) = self.bus.drive(at, slot);
        self.iwdg.on_clock(hz, registers, &mut context);
    }

    /// What keeps the core from running.
    #[must_use]
    pub const fn halted(&self) -> Halt {
        self.halt
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rigless::mcu::{Mcu, Operate};
    use rigless::soc::Width;

    use super::*;
    use crate::wiring::Chip as Model;

    const KR: u64 = 0x4000_3000;
    const APB1_FZ: u64 = 0xE004_2008;

    /// Whether the watchdog, started at 0 with its time-out after reset (512 ms), resets a core halted at 0.1 s within 10 s.
    fn resets(halt: Halt, freeze: u64) -> bool {
        let mut chip = Stm32f4::new(Model::F407).unwrap();
        let settle = |chip: &mut Stm32f4, at_ns| {
            chip.advance_to(VirtualNanos(at_ns));
            chip.settle(&mut Nowhere).unwrap();
        };
        chip.write(VirtualNanos(0), APB1_FZ, Width::W32, freeze).unwrap();
        chip.write(VirtualNanos(0), KR, Width::W32, 0xCCCC).unwrap();
        settle(&mut chip, 0);
        settle(&mut chip, 100_000_000);
        chip.halt(VirtualNanos(100_000_000), halt);
        for ms in 101..10_000 {
            settle(&mut chip, ms * 1_000_000);
            if chip.take_reset_request().is_some() {
                return true;
            }
        }
        chip.halt(VirtualNanos(10_000_000_000), Halt::Runs);
        settle(&mut chip, 10_400_000_000);
        assert!(!chip.take_reset_request().is_some(), "it goes on where it stood: 412 ms are left");
        settle(&mut chip, 10_420_000_000);
        assert!(chip.take_reset_request().is_some());
        false
    }

    struct Nowhere;

    impl rigless::emulator::Memory for Nowhere {
        fn read(&mut self, _: u64, _: Width) -> Result<u64, rigless::emulator::Error> {
            Ok(0)
        }
        fn write(&mut self, _: u64, _: Width, _: u64) -> Result<(), rigless::emulator::Error> {
            Ok(())
        }
    }

    #[test]
    fn the_watchdog_stands_still_under_a_debugger_if_its_bit_is_set() {
        assert!(!resets(Halt::Debugger, IWDG_STOP));
        assert!(resets(Halt::Debugger, 0));
        assert!(resets(Halt::Stuck, IWDG_STOP));
        let mut chip = Stm32f4::new(Model::F407).unwrap();
        chip.halt(VirtualNanos(0), Halt::Debugger);
        Mcu::reset(&mut chip, VirtualNanos(5), rigless::device::ResetCause::Core);
        assert_eq!(chip.halted(), Halt::Runs);
    }
}
