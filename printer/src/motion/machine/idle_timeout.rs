//! Switching the motors off after a rest.

/// Watches for how long the motors have rested with current.
#[derive(Debug, Default)]
pub struct IdleTimeout {
    /// Time when their rest began, ms of a clock that may wrap.
    since_ms: Option<u32>,
    /// The timeout has switched the motors off, and the printer task has not read it yet.
    fired: bool,
}

impl IdleTimeout {
    /// Returns true if the motors have now rested for `timeout_ms`; `None`: they do not rest, or
    /// keep their current.
    pub fn check(&mut self, now_ms: u32, timeout_ms: Option<u32>) -> bool {
        let Some(timeout_ms) = timeout_ms else {
            self.since_ms = None;
            return false;
        };
        let is_over = now_ms.wrapping_sub(*self.since_ms.get_or_insert(now_ms)) >= timeout_ms;
        self.fired |= is_over;
        is_over
    }

    /// Returns true if the motors have been switched off since the last call.
    pub fn take_fired(&mut self) -> bool {
        core::mem::take(&mut self.fired)
    }
}
