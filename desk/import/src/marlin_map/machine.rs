//! Reads the kind of machine and the limits of its motion from Marlin's definitions.

use toml::Value;

use super::{NO_NUMBER, Reading};

/// Junction deviation of a jerk, as Marlin's own notes have it: 0.4 v^2 / a.
const JERK_SHARE: f64 = 0.4;

impl Reading<'_> {
    pub(super) fn machine(&mut self) {
        // Marlin's machine is a Cartesian one where it defines no other.
        self.draft.put("kinematics", "cartesian");
        for (name, kind) in [("COREXY", "corexy"), ("COREYX", "corexy"), ("COREXZ", "corexz")] {
            let why = if name == "COREYX" { "motors A and B the other way round: check the directions" } else { "" };
            self.keep(name, "kinematics", kind, why);
        }
        if let Some(name) = self.get("CUSTOM_MACHINE_NAME") {
            let text: String =
                name.value.trim_matches('"').chars().filter(|c| c.is_ascii_graphic() || *c == ' ').take(32).collect();
            self.keep("CUSTOM_MACHINE_NAME", "name", text, "");
        }
    }

    pub(super) fn motion(&mut self) {
        const ALL: [&str; 4] = ["x", "y", "z", "e"];
        self.keep_axes("DEFAULT_AXIS_STEPS_PER_UNIT", "steps_per_mm", &ALL);
        self.keep_axes("DEFAULT_MAX_FEEDRATE", "max_feed_mm_per_s", &ALL);
        self.keep_axes("DEFAULT_MAX_ACCELERATION", "max_acceleration_mm_per_s2", &ALL);
        let same = |number: f64| number;
        let acceleration = self.keep_number("DEFAULT_ACCELERATION", "acceleration_mm_per_s2.print", same);
        self.keep_number("DEFAULT_TRAVEL_ACCELERATION", "acceleration_mm_per_s2.travel", same);
        self.keep_number("DEFAULT_RETRACT_ACCELERATION", "acceleration_mm_per_s2.retract", same);
        // Marlin 1 knows the jerk only, at first one for X and Y.
        let jerk = ["DEFAULT_XJERK", "DEFAULT_XYJERK"].into_iter().find_map(|name| Some((name, self.number(name)?)));
        if self.get("CLASSIC_JERK").is_none() && self.get("JUNCTION_DEVIATION_MM").is_some() {
            self.keep_number("JUNCTION_DEVIATION_MM", "junction_deviation_mm", same);
        } else if let (Some((name, jerk)), Some(acceleration)) = (jerk, acceleration) {
            let why = "an arc that is as fast at the same acceleration";
            self.keep(name, "junction_deviation_mm", JERK_SHARE * jerk * jerk / acceleration.max(1.0), why);
        }
        for axis in ["z", "e"] {
            let name = format!("DEFAULT_{}JERK", axis.to_ascii_uppercase());
            self.keep_number(&name, &format!("instantaneous_corner_velocity_mm_per_s.{axis}"), same);
        }
        self.rules(jerk);
        self.keep_number("DEFAULT_NOMINAL_FILAMENT_DIA", "extrusion.filament_diameter_mm", same);
        if self.draft.says("extrusion.filament_diameter_mm") {
            self.draft.put("extrusion.mode", "gcode");
        }
        for (name, path) in [
            ("RETRACT_LENGTH", "firmware_retraction.length_mm"),
            ("RETRACT_FEEDRATE", "firmware_retraction.retract_mm_per_s"),
            ("RETRACT_ZRAISE", "firmware_retraction.lift_mm"),
            ("RETRACT_RECOVER_LENGTH", "firmware_retraction.extra_recover_mm"),
            ("RETRACT_RECOVER_FEEDRATE", "firmware_retraction.recover_mm_per_s"),
        ] {
            self.keep_number(name, path, same);
        }
        self.directions();
        self.e_of_several();
    }

    /// Marlin plans in its own way: with junction deviation, or with the jerk that it had before
    /// and that CLASSIC_JERK keeps.
    fn rules(&mut self, jerk: Option<(&str, f64)>) {
        const BY: &str = "rules.planned_by";
        let is_older = self.get("JUNCTION_DEVIATION_MM").is_none() && jerk.is_some();
        if self.get("CLASSIC_JERK").is_none() && !is_older {
            self.draft.put(BY, "marlin-junction-deviation");
        } else {
            self.draft.put(BY, "marlin-classic-jerk");
            self.keep("CLASSIC_JERK", BY, "marlin-classic-jerk", "");
            for (axis, of_marlin) in [("x", 10.0), ("y", 10.0), ("z", 0.3), ("e", 5.0)] {
                let path = format!("rules.jerk_mm_per_s.{axis}");
                self.draft.put(&path, of_marlin);
                let own = format!("DEFAULT_{}JERK", axis.to_ascii_uppercase());
                if let Some((name, jerk)) = jerk.filter(|_| matches!(axis, "x" | "y") && self.get(&own).is_none()) {
                    self.keep(name, &path, jerk, "");
                }
                self.keep_number(&own, &path, |jerk| jerk);
            }
        }
        self.keep_number("BLOCK_BUFFER_SIZE", "rules.queued_moves", |moves| moves as i64);
        self.keep_number("MAX_ARC_SEGMENT_MM", "rules.arc_chord_mm", |chord| chord);
    }

    /// Motors that run the other way round.
    fn directions(&mut self) {
        let mut turned = Vec::new();
        for axis in ["x", "y", "z", "e"] {
            let upper = if axis == "e" { "E0".to_owned() } else { axis.to_ascii_uppercase() };
            let name = format!("INVERT_{upper}_DIR");
            let Some(definition) = self.get(&name) else { continue };
            match self.flag(&name) {
                Some(true) => turned.push((name, axis)),
                Some(false) => {
                    self.lose(&name, "as the board turns it: the profile's driver.inverted does not name it")
                }
                None => {
                    let row = self.row(definition, NO_NUMBER);
                    self.draft.gap(
                        "driver.inverted",
                        Some(row),
                        "expected true or false, or what can be worked out to one",
                    );
                }
            }
        }
        let axes: Vec<Value> = turned.iter().map(|(_, axis)| Value::from(*axis)).collect();
        for (name, _) in turned {
            self.keep(&name, "driver.inverted", axes.clone(), "check the direction before homing");
        }
    }

    /// Lists may continue after E, with an element for each further extruder.
    fn e_of_several(&mut self) {
        if self.flag("DISTINCT_E_FACTORS") == Some(true) {
            let why = "the first extruder's values are kept: write the second one's as tools.t1.steps_per_mm";
            self.lose("DISTINCT_E_FACTORS", why);
        }
    }
}
