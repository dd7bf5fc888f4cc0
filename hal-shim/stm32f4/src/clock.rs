//! The system clock, with every wait bounded: a board with a broken crystal still prints, and says so.

use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::SystemHandler;
use ferrostep_hal_shim::clock_tree::{self, Clock, ClockSource, ClockTree, PllSource};

use crate::pac::{FLASH, RCC};

/// Most looks at a ready flag. A crystal takes 2 ms, a PLL 0.2 ms; a look takes at least four cycles of 16 MHz, so this
/// waits for 12 ms or longer.
const MOST_LOOKS: u32 = 50_000;

/// Frequency of the internal oscillator, Hz.
const INTERNAL_HZ: u32 = 16_000_000;

/// Frequency of the core with the PLL, Hz.
const FULL_HZ: u32 = 168_000_000;

/// Starts the best clock there is; the crystal has `crystal_mhz`, 4 to 25.
pub fn start(rcc: &RCC, flash: &FLASH, crystal_mhz: u8) -> Clock {
    let source = clock_tree::start_best(&mut Registers { rcc, flash, crystal_mhz });
    match source {
        ClockSource::Crystal | ClockSource::InternalWithPll => {
            Clock { source, core_hz: FULL_HZ, timer_hz: FULL_HZ / 2, serial_hz: FULL_HZ / 2 }
        }
        ClockSource::Internal => Clock { source, core_hz: INTERNAL_HZ, timer_hz: INTERNAL_HZ, serial_hz: INTERNAL_HZ },
    }
}

struct Registers<'a> {
    rcc: &'a RCC,
    flash: &'a FLASH,
    crystal_mhz: u8,
}

impl ClockTree for Registers<'_> {
    fn start_crystal(&mut self) -> bool {
        self.rcc.cr().modify(|_, w| w.hseon().set_bit());
        comes_true(|| self.rcc.cr().read().hserdy().bit_is_set())
    }

    fn stop_crystal(&mut self) {
        self.rcc.cr().modify(|_, w| w.hseon().clear_bit());
    }

    fn start_pll(&mut self, source: PllSource) -> bool {
        let (rcc, flash) = (self.rcc, self.flash);
        let (oscillator_mhz, from_crystal) = match source {
            PllSource::Crystal => (u32::from(self.crystal_mhz), 1),
            PllSource::Internal => (INTERNAL_HZ / 1_000_000, 0),
        };
        rcc.cr().modify(|_, w| w.pllon().clear_bit());
        // 1 MHz x 336 / 2 = 168 MHz (a divider of 2 is coded as 0); / 7 = 48 MHz for USB.
        let factors = oscillator_mhz | 336 << 6 | from_crystal << 22 | 7 << 24;
        // SAFETY: RM0090 6.3.2 allows M 2 to 63, N 50 to 432, P 2, Q 2 to 15.
        rcc.pllcfgr().write(|w| unsafe { w.bits(factors) });
        rcc.cr().modify(|_, w| w.pllon().set_bit());
        if !comes_true(|| rcc.cr().read().pllrdy().bit_is_set()) {
            rcc.cr().modify(|_, w| w.pllon().clear_bit());
            return false;
        }
        // Five wait states at 168 MHz and 3.3 V, before the core speeds up (RM0090 3.5.1); caches hide most of them.
        // SAFETY: five is a latency this chip has.
        flash.acr().modify(|_, w| unsafe { w.latency().bits(5) }.prften().set_bit().icen().set_bit().dcen().set_bit());
        // SAFETY: APB1 / 4 = 42 MHz (timers: twice that), APB2 / 2 = 84 MHz, the highest each bus may have; SW = PLL.
        rcc.cfgr().modify(|_, w| unsafe { w.ppre1().bits(0b101).ppre2().bits(0b100).sw().bits(0b10) });
        let switched = comes_true(|| rcc.cfgr().read().sws().bits() == 0b10);
        if !switched {
            // SAFETY: all dividers off, SW = internal oscillator: the state after reset.
            rcc.cfgr().modify(|_, w| unsafe { w.ppre1().bits(0).ppre2().bits(0).sw().bits(0) });
        }
        switched
    }
}

/// Gives SysTick, the timer of the waits, a priority from 1 to 16 in RTIC's sense. After reset it has the highest, and
/// the step interrupt would have to wait for it.
pub fn set_systick_priority(scb: &mut SCB, priority: u8) {
    // Four bits of priority, in the upper half of the byte, 0 the highest.
    let hardware = (16 - priority.clamp(1, 16)) << 4;
    // SAFETY: called in `init`, before any task or critical section by priority exists.
    unsafe { scb.set_priority(SystemHandler::SysTick, hardware) };
}

/// Whether a flag comes up within [`MOST_LOOKS`].
pub fn comes_true(mut flag: impl FnMut() -> bool) -> bool {
    (0..MOST_LOOKS).any(|_| flag())
}
