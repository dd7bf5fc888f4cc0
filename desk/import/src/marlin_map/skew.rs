//! Marlin's skew of the axes.

use super::Reading;

impl Reading<'_> {
    /// The skew: of each plane its factor, or three lengths.
    pub(super) fn skew(&mut self) {
        if self.get("SKEW_CORRECTION").is_none() {
            return;
        }
        let mut is_skew = false;
        for plane in ["xy", "xz", "yz"] {
            if plane != "xy" && self.get("SKEW_CORRECTION_FOR_Z").is_none() {
                continue;
            }
            let upper = plane.to_ascii_uppercase();
            let factor = format!("{upper}_SKEW_FACTOR");
            let lengths = ["DIAG_AC", "DIAG_BD", "SIDE_AD"].map(|length| format!("{upper}_{length}"));
            if self.get(&factor).is_some() {
                is_skew |= self.keep_number(&factor, &format!("skew.{plane}.factor"), |factor| factor).is_some();
                for length in &lengths {
                    self.lose(length, "the factor holds");
                }
            } else if lengths.iter().all(|name| self.number(name).is_some()) {
                is_skew = true;
                for (name, key) in lengths.iter().zip(["ac_mm", "bd_mm", "ad_mm"]) {
                    self.keep_number(name, &format!("skew.{plane}.{key}"), |length| length);
                }
            }
        }
        if is_skew {
            for name in ["SKEW_CORRECTION", "SKEW_CORRECTION_FOR_Z"] {
                self.lose(name, "what is measured of a plane corrects it");
            }
        }
    }
}
