//! Klipper's macros: those of plain lines become the profile's.

use super::Reading;

impl Reading<'_> {
    /// To be written.
    pub(super) fn macros(&mut self) {}
}
