//! Notes what Marlin's definitions do not say about the machine's identity.

use super::{NO_NUMBER, Reading, sensor};
use crate::definitions::Running;

/// Says that a running Marlin does not report the value of a definition.
fn not_told(name: &str) -> String {
    format!("a running Marlin does not tell it; {name} in its Configuration.h says it")
}

impl Reading<'_> {
    /// Notes what the configuration omits about the machine's kind.
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
        if let Some(running) = self.definitions.running {
            self.untold(running);
        }
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
            None if self.definitions.running.is_some() => self.draft.gap(path, None, &not_told(name)),
            None => self.draft.gap(path, None, &format!("{name} is not defined")),
        }
    }

    /// Notes values that a file gives, or leaves to Marlin's default, and that a running Marlin
    /// does not report.
    fn untold(&mut self, running: Running) {
        self.draft.gap("kinematics", None, &not_told("COREXY or COREXZ"));
        self.draft.gap("driver.inverted", None, &not_told("INVERT_X_DIR and so on"));
        for axis in ["x", "y", "z"] {
            let upper = axis.to_ascii_uppercase();
            self.required(&format!("lower_end_mm.{axis}"), &format!("{upper}_MIN_POS"));
            let home = not_told(&format!("MANUAL_{upper}_HOME_POS"));
            self.draft.gap(&format!("homing.{axis}.position_mm"), None, &home);
            let what = match axis {
                "z" if running.has_probe => {
                    "it has a probe (Cap:Z_PROBE:1), and does not tell whether Z homes by it (USE_PROBE_FOR_Z_HOMING)"
                        .to_owned()
                }
                _ => not_told("SENSORLESS_HOMING"),
            };
            self.draft.gap(&format!("homing.{axis}.sensor"), None, &what);
            let state = not_told(&format!("{upper}_MIN_ENDSTOP_HIT_STATE"));
            self.draft.gap(&format!("homing.{axis}.triggers_low"), None, &state);
        }
        self.required("bed.sensor", "TEMP_SENSOR_BED");
        self.lose("NOZZLE_TO_PROBE_OFFSET", "by what Z homes is not told: write homing.probe_offset_mm by hand");
        for name in ["ENABLE_LEVELING_FADE_HEIGHT", "DEFAULT_LEVELING_FADE_HEIGHT"] {
            self.lose(name, "points and area of the mesh are not told: write mesh by hand, and measure the bed by G29");
        }
        for motor in ["X", "Y", "Z", "E0"] {
            for what in ["CURRENT", "HYBRID_THRESHOLD", "STALL_SENSITIVITY"] {
                let why = "the kind of driver and its microsteps are not told: write drivers by hand";
                self.lose(&format!("{motor}_{what}"), why);
            }
        }
        if self.number("EXTRUDERS").is_some_and(|count| count >= 2.0) {
            self.required("tools.t1.nozzle.sensor", "TEMP_SENSOR_1");
            self.required("tools.t1.inverted", "INVERT_E1_DIR");
        }
    }
}
