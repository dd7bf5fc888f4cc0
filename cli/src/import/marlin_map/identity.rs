//! What Marlin's definitions do not say of what the machine is.

use super::{NO_NUMBER, Reading, sensor};

impl Reading<'_> {
    /// Notes what the configuration does not say of what the machine is.
    pub(super) fn identity(&mut self) {
        for (file, line, name, why) in &self.definitions.missing {
            self.draft.unread(format!("{file}:{line}: #include \"{name}\" was not read: {why}"));
        }
        for axis in ["x", "y", "z", "e"] {
            self.required(&format!("steps_per_mm.{axis}"), "DEFAULT_AXIS_STEPS_PER_UNIT");
        }
        for axis in ["x", "y", "z"] {
            let upper = axis.to_ascii_uppercase();
            self.required(&format!("size_mm.{axis}"), &format!("{upper}_MAX_POS"));
            self.required(&format!("homing.{axis}.end"), &format!("{upper}_HOME_DIR"));
            for (name, path) in [("MIN_POS", "lower_end_mm"), ("HOME_POS", "position_mm")] {
                let own = if name == "HOME_POS" { format!("MANUAL_{upper}_{name}") } else { format!("{upper}_{name}") };
                if self.get(&own).is_some() && self.number(&own).is_none() {
                    let row = self.get(&own).map(|definition| self.row(definition, NO_NUMBER));
                    self.draft.gap(&format!("{path}.{axis}"), row, NO_NUMBER);
                }
            }
        }
        self.required("nozzle.sensor", "TEMP_SENSOR_0");
        let is_none = self.number("TEMP_SENSOR_BED").is_some_and(|number| number == 0.0 || sensor::is_dummy(number));
        if !is_none && self.get("TEMP_SENSOR_BED").is_some() {
            self.required("bed.sensor", "TEMP_SENSOR_BED");
        }
    }

    /// Notes a key that no definition says, with the one that should.
    fn required(&mut self, path: &str, name: &str) {
        if self.draft.says(path) {
            return;
        }
        match self.get(name) {
            Some(definition) => {
                let row = self.row(definition, NO_NUMBER);
                self.draft.gap(path, Some(row), &format!("{path} cannot be worked out of it"));
            }
            None => self.draft.gap(path, None, &format!("{name} is not defined")),
        }
    }
}
