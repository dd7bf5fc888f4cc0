//! Checks that a Klipper file says what the machine is, so that no other machine's value
//! is used instead.

use super::Reading;

impl Reading<'_> {
    /// Notes each part of the machine's kind that no setting says. To be called when all of
    /// it has been read.
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
        self.signals_are_said();
        if !self.draft.says("nozzle.sensor") {
            self.gap("nozzle.sensor", "extruder", "sensor_type", "expected a thermistor that is known");
        }
        if self.section("heater_bed").is_some() && !self.draft.says("bed.sensor") {
            self.gap("bed.sensor", "heater_bed", "sensor_type", "expected a thermistor that is known");
        }
    }

    /// A pin whose line was not found may be turned by a `!` in a file that was not read.
    fn signals_are_said(&mut self) {
        if self.config.missing.is_empty() {
            return;
        }
        for section in ["stepper_x", "stepper_y", "stepper_z", "extruder"] {
            if self.entry(section, "dir_pin").is_none() {
                let what = "expected the pin of the direction, with ! where the motor runs the other way round";
                self.gap("driver.inverted", section, "dir_pin", what);
            }
        }
        let probe = [("bltouch", "sensor_pin"), ("probe", "pin"), ("smart_effector", "pin")]
            .into_iter()
            .find(|(section, _)| self.section(section).is_some());
        if let Some((section, key)) = probe.filter(|_| self.draft.word("homing.z.sensor") == Some("probe"))
            && self.entry(section, key).is_none()
        {
            self.gap("homing.z.triggers_low", section, key, "expected the probe's pin, with ! where it triggers low");
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
