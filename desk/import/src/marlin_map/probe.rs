//! Marlin's probe of the bed.

use super::{NO_NUMBER, Reading};

/// Marlin's `BLTOUCH_DELAY` without the definition, ms.
const MARLIN_BLTOUCH_DELAY_MS: f64 = 500.0;

impl Reading<'_> {
    pub(super) fn probe(&mut self) {
        const SWITCHES: [&str; 6] = [
            "BLTOUCH",
            "FIX_MOUNTED_PROBE",
            "NOZZLE_AS_PROBE",
            "BIQU_MICROPROBE_V1",
            "BIQU_MICROPROBE_V2",
            "TOUCH_MI_PROBE",
        ];
        // Probes that a servo, a coil or a sledge brings out, or that are not switches.
        const OTHERS: [&str; 11] = [
            "Z_PROBE_SERVO_NR",
            "SOLENOID_PROBE",
            "Z_PROBE_SLED",
            "RACK_AND_PINION_PROBE",
            "Z_PROBE_ALLEN_KEY",
            "MAGLEV4",
            "MAG_MOUNTED_PROBE",
            "SENSORLESS_PROBING",
            "BD_SENSOR",
            "DUET_SMART_EFFECTOR",
            "TOUCH_MI_PROBE",
        ];
        let homes = ["USE_PROBE_FOR_Z_HOMING", "Z_MIN_PROBE_USES_Z_MIN_ENDSTOP_PIN"];
        if self.get("PROBE_MANUALLY").is_some() || !homes.iter().any(|home| self.flag(home) == Some(true)) {
            return;
        }
        if self.draft.word("homing.z.end") == Some("max") {
            for name in SWITCHES.into_iter().chain(OTHERS).chain(homes).chain(["NOZZLE_TO_PROBE_OFFSET"]) {
                self.lose(name, "Z homes to its upper end, by its switch: a profile's probe is what Z homes by");
            }
            return;
        }
        let other = OTHERS.iter().find_map(|name| self.get(name));
        let switch = SWITCHES.into_iter().find(|name| self.flag(name) == Some(true));
        if let Some(definition) = other.filter(|_| switch.is_none_or(|name| name == "TOUCH_MI_PROBE")) {
            let row = self.row(definition, "");
            let what = "Z homes by a probe of another kind: a profile's is a switch that is there, or a BLTouch";
            self.draft.gap("homing.z.sensor", Some(row), what);
        }
        let Some(name) = switch.or_else(|| other.map(|definition| definition.name.as_str())) else {
            // Marlin homes Z by a probe where it has one.
            for home in homes {
                self.lose(home, "no probe is defined: Z homes by its switch, as Marlin has it");
            }
            return;
        };
        self.keep(name, "homing.z.sensor", "probe", "");
        for home in homes {
            self.keep(home, "homing.z.sensor", "probe", "");
        }
        self.probe_level(name);
        for axis in ["x", "y", "z"] {
            self.draft.put(&format!("homing.probe_offset_mm.{axis}"), 0.0);
        }
        self.keep_axes("NOZZLE_TO_PROBE_OFFSET", "homing.probe_offset_mm", &["x", "y", "z"]);
        for (axis, offset) in ["x", "y", "z"].iter().zip(self.list("NOZZLE_TO_PROBE_OFFSET").unwrap_or(vec![None; 3])) {
            if let Some(definition) = self.get("NOZZLE_TO_PROBE_OFFSET").filter(|_| offset.is_none()) {
                let row = self.row(definition, NO_NUMBER);
                self.draft.gap(&format!("homing.probe_offset_mm.{axis}"), Some(row), NO_NUMBER);
            }
        }
        for axis in ["x", "y", "z"] {
            let older = format!("{}_PROBE_OFFSET_FROM_EXTRUDER", axis.to_ascii_uppercase());
            self.keep_number(&older, &format!("homing.probe_offset_mm.{axis}"), |offset| offset);
        }
        if name == "BLTOUCH" {
            self.draft.put("bltouch.move_ms", MARLIN_BLTOUCH_DELAY_MS);
            self.keep_number("BLTOUCH_DELAY", "bltouch.move_ms", |ms| ms);
            // The option is on without a value.
            if let Some(is_on) = self.flag("BLTOUCH_HS_MODE") {
                self.keep("BLTOUCH_HS_MODE", "bltouch.stow_each_touch", !is_on, "");
            }
        }
        self.draft.put("homing.raise_mm", 5.0);
        for name in ["Z_HOMING_HEIGHT", "Z_CLEARANCE_FOR_HOMING", "Z_RAISE_BEFORE_HOMING", "MIN_Z_HEIGHT_FOR_HOMING"] {
            self.keep_number(name, "homing.raise_mm", |height| height);
        }
        for axis in ["x", "y"] {
            let path = format!("homing.home_at_mm.{axis}");
            let size = self.draft.number(&format!("size_mm.{axis}")).unwrap_or_default();
            // Marlin's word is where the probe is, the profile's where the nozzle is.
            let offset = self.draft.number(&format!("homing.probe_offset_mm.{axis}")).unwrap_or_default();
            self.draft.put(&path, size / 2.0);
            let name = format!("Z_SAFE_HOMING_{}_POINT", axis.to_ascii_uppercase());
            if let Some(place) = self.number(&name) {
                self.keep(&name, &path, place - offset, "where the nozzle is, not the probe");
            }
        }
    }

    /// The level at which a probe triggers. Marlin takes that of a BLTouch as it is,
    /// whatever the file says.
    fn probe_level(&mut self, name: &str) {
        const PATH: &str = "homing.z.triggers_low";
        let names = ["Z_MIN_PROBE_ENDSTOP_HIT_STATE", "Z_MIN_PROBE_ENDSTOP_INVERTING"];
        if name == "BLTOUCH" {
            for name in names.into_iter().chain(["Z_MIN_ENDSTOP_HIT_STATE", "Z_MIN_ENDSTOP_INVERTING"]) {
                self.lose(name, "a BLTouch's signal is high when it triggers");
            }
            return self.keep("BLTOUCH", PATH, false, "");
        }
        let has_own_pin = self.flag("Z_MIN_PROBE_USES_Z_MIN_ENDSTOP_PIN") != Some(true);
        if has_own_pin {
            self.draft.put(PATH, false);
            for name in ["Z_MIN_ENDSTOP_HIT_STATE", "Z_MIN_ENDSTOP_INVERTING"] {
                self.lose(name, "Z homes by the probe, which has a separate level");
            }
        }
        for (name, is_low_where) in names.into_iter().zip([true, false]) {
            let Some(state) = self.is_low(name, PATH) else { continue };
            if has_own_pin {
                self.keep(name, PATH, state == is_low_where, "");
            } else {
                self.lose(name, "the probe is at the pin of Z's end stop, whose level counts");
            }
        }
    }
}
