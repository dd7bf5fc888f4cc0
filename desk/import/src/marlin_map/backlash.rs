//! Marlin's play of the drives.

use super::Reading;

impl Reading<'_> {
    /// The play, and how it is taken up. Marlin corrects 0 % of it by default and, without a
    /// smoothing distance, corrects in one move.
    pub(super) fn backlash(&mut self) {
        if self.get("BACKLASH_COMPENSATION").is_none() {
            return;
        }
        self.keep_axes("BACKLASH_DISTANCE_MM", "backlash.play_mm", &["x", "y", "z"]);
        if self.keep_number("BACKLASH_CORRECTION", "backlash.correction", |part| part).is_none() {
            self.keep(
                "BACKLASH_COMPENSATION",
                "backlash.correction",
                0.0,
                "without BACKLASH_CORRECTION Marlin takes up none",
            );
        }
        self.keep_number("BACKLASH_SMOOTHING_MM", "backlash.smoothing_mm", |way| way);
        self.lose("BACKLASH_COMPENSATION", "play that is known is taken up");
        self.lose("BACKLASH_GCODE", "M425 sets it");
        self.lose("MEASURE_BACKLASH_WHEN_PROBING", "play is measured by hand");
    }
}
