//! Ownership of the served printer's line by the web page or the host outside, one at a time.

use std::sync::atomic::{AtomicU8, Ordering};

const FREE: u8 = 0;
const PAGE: u8 = 1;
const OUTSIDE: u8 = 2;

/// The owner of a line, shared by both sides.
#[derive(Debug, Default)]
pub struct Ownership(AtomicU8);

impl Ownership {
    /// Takes the line for the page, if the outside host does not own it; whether the
    /// page has it now.
    pub fn take_for_page(&self) -> bool {
        self.take(PAGE)
    }

    /// The page no longer needs it.
    pub fn release_page(&self) {
        self.release(PAGE);
    }

    /// Returns true if the page owns it.
    pub fn is_pages(&self) -> bool {
        self.0.load(Ordering::SeqCst) == PAGE
    }

    /// Takes the line for the outside host, if the page does not own it; whether that
    /// host has it now.
    pub fn take_for_outside(&self) -> bool {
        self.take(OUTSIDE)
    }

    /// The outside host has left.
    pub fn release_outside(&self) {
        self.release(OUTSIDE);
    }

    /// Returns true if the outside host owns it.
    pub fn is_outsides(&self) -> bool {
        self.0.load(Ordering::SeqCst) == OUTSIDE
    }

    fn take(&self, owner: u8) -> bool {
        self.0
            .compare_exchange(FREE, owner, Ordering::SeqCst, Ordering::SeqCst)
            .map_or_else(|present| present == owner, |_| true)
    }

    fn release(&self, owner: u8) {
        // Another owner keeps it.
        let _ = self.0.compare_exchange(owner, FREE, Ordering::SeqCst, Ordering::SeqCst);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_owns_it_at_a_time() {
        let ownership = Ownership::default();
        assert!(ownership.take_for_page() && ownership.take_for_page() && !ownership.take_for_outside());
        ownership.release_outside();
        assert!(ownership.is_pages());
        ownership.release_page();
        assert!(ownership.take_for_outside() && !ownership.take_for_page() && ownership.is_outsides());
    }
}
