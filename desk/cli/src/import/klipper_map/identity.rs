//! What a Klipper file must say of the machine, so that no other machine's value stands in.

use super::Reading;

impl Reading<'_> {
    /// Notes each part of what the machine is that no setting says. To be called when all of it has been read.
    pub(super) fn identity(&mut self) {
        for (file, line, name, why) in &self.config.missing {
            self.draft.unread(format!("{file}:{line}: [include {name}] was not read: {why}"));
        }
        for axis in ["x", "y", "z"] {
            let section = format!("stepper_{axis}");
            self.steps_are_said(&format!("steps_per_mm.{axis}"), &section);
            let path = format!("size_mm.{axis}");
            if !self.draft.says(&path) {
                self.gap(&path, &section, "position_max", "expected the upper end of the travel, mm");
            }
            let path = format!("lower_end_mm.{axis}");
            if !self.draft.says(&path) && self.entry(&section, "position_min").is_some() {
                self.gap(&path, &section, "position_min", "expected the lower end of the travel, mm");
            }
            let path = format!("homing.{axis}.sensor");
            if !self.draft.says(&path) {
                self.gap(
                    &path,
                    &section,
                    "endstop_pin",
                    "expected a pin, probe:z_virtual_endstop or a driver's virtual_endstop",
                );
            }
            let by_probe = self.draft.word(&path) == Some("probe");
            let path = format!("homing.{axis}.position_mm");
            if !self.draft.says(&path) && !by_probe {
                self.gap(&path, &section, "position_endstop", "expected where the end stop is, mm");
            }
        }
        self.steps_are_said("steps_per_mm.e", "extruder");
        if !self.draft.says("nozzle.sensor") {
            self.gap("nozzle.sensor", "extruder", "sensor_type", "expected a thermistor that is known");
        }
        if self.section("heater_bed").is_some() && !self.draft.says("bed.sensor") {
            self.gap("bed.sensor", "heater_bed", "sensor_type", "expected a thermistor that is known");
        }
    }

    fn steps_are_said(&mut self, path: &str, section: &str) {
        if self.draft.says(path) {
            return;
        }
        let missing = ["rotation_distance", "microsteps"]
            .into_iter()
            .find(|key| self.number(section, key).is_none_or(|n| n == 0.0));
        let key = missing.unwrap_or("gear_ratio");
        self.gap(path, section, key, "expected a number above 0, of which the steps follow");
    }
}
