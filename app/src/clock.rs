//! Time for the command side: SysTick's milliseconds.

use embedded_hal_async::delay::DelayNs;
use ferrostep_hal_shim::Clock;
use rtic_monotonics::systick::prelude::*;

systick_monotonic!(Mono, 1_000);

/// Tells the time and waits for it.
#[derive(Clone, Copy, Debug)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now_ms(&self) -> u64 {
        Mono::now().ticks()
    }
}

impl DelayNs for SystemClock {
    async fn delay_ns(&mut self, ns: u32) {
        Mono::delay(u64::from(ns).nanos()).await;
    }

    async fn delay_us(&mut self, us: u32) {
        Mono::delay(u64::from(us).micros()).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        Mono::delay(u64::from(ms).millis()).await;
    }
}
