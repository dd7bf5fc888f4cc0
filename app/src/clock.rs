//! Time for the command side, from SysTick in milliseconds.

use core::cell::Cell;

use embedded_hal_async::delay::DelayNs;
use ferrostep_hal_shim::Clock;
use rtic_monotonics::systick::prelude::*;

systick_monotonic!(Mono, 1_000);

#[cfg(any(drivers, tachometers, accelerometer))]
/// A period without drift: [`Mono::delay`] adds a tick, so that a loop of one millisecond would
/// take two.
pub struct Period {
    next: <Mono as Monotonic>::Instant,
    length: <Mono as Monotonic>::Duration,
}

#[cfg(any(drivers, tachometers, accelerometer))]
impl Period {
    /// Begins a period now, in milliseconds.
    pub fn new(milliseconds: u32) -> Self {
        Self { next: Mono::now(), length: milliseconds.millis() }
    }

    /// Waits for the next end of the period. Missed ends are skipped.
    pub async fn pass(&mut self) {
        self.next = (self.next + self.length).max(Mono::now());
        Mono::delay_until(self.next).await;
    }
}

/// A clock that tells the time and waits.
#[derive(Clone, Debug, Default)]
pub struct SystemClock {
    /// Last reading of SysTick's count, 32 bits of milliseconds (49 days); the number of wraps
    /// follows.
    last_ms: Cell<u32>,
    wraps: Cell<u32>,
}

impl Clock for SystemClock {
    fn now_ms(&self) -> u64 {
        let now_ms = Mono::now().ticks();
        if now_ms < self.last_ms.replace(now_ms) {
            self.wraps.set(self.wraps.get().wrapping_add(1));
        }
        u64::from(self.wraps.get()) << 32 | u64::from(now_ms)
    }
}

impl DelayNs for SystemClock {
    async fn delay_ns(&mut self, ns: u32) {
        Mono::delay(ns.div_ceil(1_000_000).millis()).await;
    }

    async fn delay_us(&mut self, us: u32) {
        Mono::delay(us.div_ceil(1_000).millis()).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        Mono::delay(ms.millis()).await;
    }
}
