//! Klipper's firmware retraction, with the values that it has by itself.

use super::Reading;

const SECTION: &str = "firmware_retraction";

impl Reading<'_> {
    /// The section, each of whose keys has a value of Klipper's own.
    pub(super) fn retraction(&mut self) {
        if self.section(SECTION).is_none() {
            return;
        }
        for (key, path, own) in [
            ("retract_length", "firmware_retraction.length_mm", 0.0),
            ("retract_speed", "firmware_retraction.retract_mm_per_s", 20.0),
            ("unretract_extra_length", "firmware_retraction.extra_recover_mm", 0.0),
            ("unretract_speed", "firmware_retraction.recover_mm_per_s", 10.0),
        ] {
            self.draft.put(path, own);
            self.keep_number(SECTION, key, &[path], |number| number);
        }
    }
}
