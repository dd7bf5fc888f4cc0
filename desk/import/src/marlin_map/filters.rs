//! Marlin's input shapers and linear advance.

use super::Reading;

impl Reading<'_> {
    pub(super) fn filters(&mut self) {
        for axis in ["x", "y"] {
            let upper = axis.to_ascii_uppercase();
            let (frequency, path) = (format!("SHAPING_FREQ_{upper}"), format!("input_shaper.{axis}"));
            if self.get(&format!("INPUT_SHAPING_{upper}")).is_some()
                && self.number(&frequency).is_some_and(|hz| hz > 0.0)
            {
                self.keep_number(&frequency, &format!("{path}.frequency_hz"), |hz| hz);
                self.keep(&format!("INPUT_SHAPING_{upper}"), &format!("{path}.kind"), "zv", "");
                self.keep_number(&format!("SHAPING_ZETA_{upper}"), &format!("{path}.damping"), |ratio| ratio);
            }
        }
        if self.get("LIN_ADVANCE").is_some() {
            let name = ["ADVANCE_K", "LIN_ADVANCE_K"].into_iter().find(|name| self.get(name).is_some());
            if let Some(name) = name {
                let first =
                    self.list(name).and_then(|list| list.first().copied().flatten()).or_else(|| self.number(name));
                if let Some(k) = first {
                    self.keep(name, "pressure_advance.seconds", k, "");
                    self.keep("LIN_ADVANCE", "pressure_advance.seconds", k, "");
                }
            }
        }
    }
}
