//! The system clock, with every wait bounded: a board with a broken crystal still prints, and says so.

use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::SystemHandler;
use ferrostep_hal_shim::clock_tree::{self, Clock, ClockSource, ClockTree, PllSource};

use crate::board::{APB1_CODE, APB2_CODE, APB2_HZ, CORE_HZ, FERROSTEP_PLL, FLASH_WAIT_STATES, INTERNAL_HZ, TIMER_HZ};
use crate::pac::{FLASH, RCC};

/// Most looks at a ready flag. A crystal takes 2 ms, a PLL 0.2 ms; a look takes at least four cycles of 16 MHz, so this
/// waits for 12 ms or longer.
const MOST_LOOKS: u32 = 50_000;

/// Starts the best clock there is.
pub fn start(rcc: &RCC, flash: &FLASH) -> Clock {
    let mut registers = Registers { rcc, flash };
    registers.start_internal();
    let source = clock_tree::start_best(&mut registers);
    match source {
        ClockSource::Crystal | ClockSource::InternalWithPll => {
            Clock { source, core_hz: CORE_HZ, timer_hz: TIMER_HZ, serial_hz: APB2_HZ }
        }
        ClockSource::Internal => Clock { source, core_hz: INTERNAL_HZ, timer_hz: INTERNAL_HZ, serial_hz: INTERNAL_HZ },
    }
}

struct Registers<'a> {
    rcc: &'a RCC,
    flash: &'a FLASH,
}

impl Registers<'_> {
    /// The state after reset: a boot loader may have left the chip on a PLL, which cannot be changed while it is used.
    fn start_internal(&self) {
        self.rcc.cr().modify(|_, w| w.hsion().set_bit());
        let _ready = comes_true(|| self.rcc.cr().read().hsirdy().bit_is_set());
        self.use_internal();
        let _switched = comes_true(|| self.rcc.cfgr().read().sws().bits() == 0);
        self.rcc.cr().modify(|_, w| w.pllon().clear_bit());
    }

    fn use_internal(&self) {
        // SAFETY: all dividers off, SW = internal oscillator: the state after reset.
        self.rcc.cfgr().modify(|_, w| unsafe { w.hpre().bits(0).ppre1().bits(0).ppre2().bits(0).sw().bits(0) });
    }
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
        let [with_crystal, with_internal] = FERROSTEP_PLL;
        let factors = match source {
            PllSource::Crystal => with_crystal,
            PllSource::Internal => with_internal,
        };
        rcc.cr().modify(|_, w| w.pllon().clear_bit());
        // SAFETY: within the limits of the manual (`boards/src/clock.rs` makes and tests it).
        rcc.pllcfgr().write(|w| unsafe { w.bits(factors) });
        rcc.cr().modify(|_, w| w.pllon().set_bit());
        if !comes_true(|| rcc.cr().read().pllrdy().bit_is_set()) {
            rcc.cr().modify(|_, w| w.pllon().clear_bit());
            return false;
        }
        // Before the core speeds up (RM0090 3.5.1); caches hide most of the wait states.
        flash.acr().modify(|_, w| {
            // SAFETY: a latency that the chips have.
            let w = unsafe { w.latency().bits(FLASH_WAIT_STATES) };
            w.prften().set_bit().icen().set_bit().dcen().set_bit()
        });
        // SAFETY: dividers that keep the buses within their limits; SW = PLL.
        rcc.cfgr().modify(|_, w| unsafe { w.ppre1().bits(APB1_CODE).ppre2().bits(APB2_CODE).sw().bits(0b10) });
        let switched = comes_true(|| rcc.cfgr().read().sws().bits() == 0b10);
        if !switched {
            self.use_internal();
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
