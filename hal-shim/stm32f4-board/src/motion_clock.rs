//! TIM5 as a clock that runs at the motion clock's pace, however long its ticks are in seconds.

use crate::pac::{RCC, TIM5};

/// Handle to a 32-bit tick counter, which wraps after about 51 s at full speed. Copies read the
/// same counter.
#[derive(Clone, Copy, Debug)]
pub struct MotionClock(());

impl MotionClock {
    /// Starts the timer at the frequency of the timers on APB1.
    pub fn start(timer: TIM5, rcc: &RCC) -> Self {
        rcc.apb1enr().modify(|_, w| w.tim5en().set_bit());
        // Read back: `Registers::switch_clocks_on` says why.
        let _switched_on = rcc.apb1enr().read();
        // SAFETY: any reload value is valid; this one makes all 32 bits count.
        timer.arr().write(|w| unsafe { w.bits(u32::MAX) });
        timer.cr1().write(|w| w.cen().set_bit());
        Self(())
    }

    /// Ticks so far, modulo 2^32.
    pub fn now_ticks(self) -> u32 {
        // SAFETY: the counter is only read, and the timer's owner was given up in `start`.
        unsafe { &*TIM5::ptr() }.cnt().read().bits()
    }
}
