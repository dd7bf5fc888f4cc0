//! Virtual time and waiting in it.

use core::cell::Cell;
use core::future::poll_fn;
use core::task::Poll;

use embedded_hal_async::delay::DelayNs;

use ferrostep_hal_shim::Clock;

/// Virtual time in nanoseconds, and the moment at which the last polled wait ends.
#[derive(Debug, Default)]
pub struct VirtualClock {
    now_ns: Cell<u64>,
    wake_ns: Cell<Option<u64>>,
}

impl VirtualClock {
    /// Now.
    pub fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    /// Advances time to `ns`, never back.
    pub fn advance_to(&self, ns: u64) {
        self.now_ns.set(self.now_ns.get().max(ns));
    }

    /// Takes the moment the last polled wait ends at.
    pub fn take_wake_ns(&self) -> Option<u64> {
        self.wake_ns.take()
    }
}

impl Clock for &VirtualClock {
    fn now_ms(&self) -> u64 {
        self.now_ns.get() / 1_000_000
    }
}

/// A wait in virtual time: its poller lets the time pass.
#[derive(Clone, Copy, Debug)]
pub struct VirtualDelay<'a>(pub &'a VirtualClock);

impl DelayNs for VirtualDelay<'_> {
    async fn delay_ns(&mut self, ns: u32) {
        let clock = self.0;
        let end = clock.now_ns.get() + u64::from(ns);
        poll_fn(|_| {
            if clock.now_ns.get() >= end {
                return Poll::Ready(());
            }
            clock.wake_ns.set(Some(end));
            Poll::Pending
        })
        .await;
    }
}

impl Clock for VirtualDelay<'_> {
    fn now_ms(&self) -> u64 {
        self.0.now_ms()
    }
}
