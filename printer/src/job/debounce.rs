//! A level that counts when it has lasted.

/// Since when a level has differed from the one that counts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Debounce {
    /// Time when it began to differ, ms; `None`: it does not.
    since_ms: Option<u32>,
}

impl Debounce {
    /// A level that does not differ.
    pub const fn new() -> Self {
        Self { since_ms: None }
    }

    /// Returns true once the level has differed for long enough to count from now on. To be called
    /// again and again with the present level (`says`), the one that counts (`counts`), and a clock
    /// of milliseconds that may wrap.
    pub fn has_settled(&mut self, now_ms: u32, says: bool, counts: bool, debounce_ms: u32) -> bool {
        let lasts = says != counts && now_ms.wrapping_sub(*self.since_ms.get_or_insert(now_ms)) >= debounce_ms;
        if says == counts || lasts {
            self.since_ms = None;
        }
        lasts
    }
}
