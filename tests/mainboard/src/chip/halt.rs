//! Halts the core while the rest of the chip continues: by a debugger, or because
//! the core is stuck.
//!
//! rigless's debugger stops virtual time with the core, so it cannot show the effects of a probe's
//! halt: timers continue to switch heaters, and the watchdog counts or not according to DBGMCU
//! (RM0090 21.3.3, 38.16.4). Here the run holds the core and lets time pass ([`Stm32f4::halt`]).
//!
//! | Section | Behaviour | Test |
//! |---|---|---|
//! | 38.16.4 | with DBG_IWDG_STOP the watchdog stops while a debugger halts the core |
//! `dbg_iwdg_stop_stops_the_watchdog_under_a_debugger` |
//! | 21.3.3 | without it, and whenever the core hangs by itself, the watchdog counts | the same |
//! | 6.1.1 | a reset releases the core: it clears the halt request | the same |
//!
//! **Left out:** the other freeze bits of DBGMCU_APB1_FZ and APB2_FZ (timers, the buses'
//! time-outs): the timer models have no input for them, so their timers continue.

use rigless::device::Device;
use rigless::soc::stm32f427::generated::{dbg, rcc};
use rigless::time::VirtualNanos;

use super::instances::Instance;
use super::{Halt, Stm32f4};

/// DBG_IWDG_STOP in DBGMCU_APB1_FZ, RM0090 38.16.4.
const IWDG_STOP: u64 = 1 << 12;
/// LSIRDY in RCC_CSR, 7.3.21.
const LSI_READY: u64 = 1 << 1;

impl Stm32f4 {
    /// Stops the core, or releases it.
    pub fn halt(&mut self, at: VirtualNanos, halt: Halt) {
        self.halt = halt;
        let freezes = Self::registers(&self.bus, self.slot(Instance::Dbg)).get(dbg::Register::DbgmcuApb1Fz) & IWDG_STOP;
        let ready = Self::registers(&self.bus, self.slot(Instance::Rcc)).get(rcc::Register::Csr) & LSI_READY != 0;
        let hz = match halt {
            Halt::Debugger if freezes != 0 => 0,
            _ if ready => self.rcc.lsi_hz(),
            _ => 0,
        };
        let slot = self.slot(Instance::Iwdg);
        let (registers, mut context) = self.bus.drive(at, slot);
        self.iwdg.on_clock(hz, registers, &mut context);
    }

    /// State of the core: running, or held by something.
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

    /// True if the watchdog, started at 0 with its time-out after reset (512 ms), resets a core
    /// halted at 0.1 s within 10 s.
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
        assert!(!chip.take_reset_request().is_some(), "the watchdog continues with the remaining 412 ms");
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
    fn dbg_iwdg_stop_stops_the_watchdog_under_a_debugger() {
        assert!(!resets(Halt::Debugger, IWDG_STOP));
        assert!(resets(Halt::Debugger, 0));
        assert!(resets(Halt::Stuck, IWDG_STOP));
        let mut chip = Stm32f4::new(Model::F407).unwrap();
        chip.halt(VirtualNanos(0), Halt::Debugger);
        Mcu::reset(&mut chip, VirtualNanos(5), rigless::device::ResetCause::Core);
        assert_eq!(chip.halted(), Halt::Runs);
    }
}
