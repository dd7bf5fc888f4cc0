//! What of Marlin's definitions a profile says.

mod backlash;
mod fans;
mod heaters;
mod mesh;
mod reasons;
mod sensor;
mod skew;
mod supply;
mod tools;
mod z_motors;

use std::collections::{HashMap, HashSet};

use toml::Value;

use super::draft::Draft;
use super::expression::{list, number};
use super::marlin::{Definition, Definitions};
use super::{ImportError, Imported, Row, shown};
use reasons::reason;
use sensor::sensor;

/// Marlin's `BLTOUCH_DELAY` without the definition, ms.
const MARLIN_BLTOUCH_DELAY_MS: f64 = 500.0;

/// Junction deviation of a jerk, as Marlin's own notes have it: 0.4 v^2 / a.
const JERK_SHARE: f64 = 0.4;

/// Why a value is not kept that the profile has a key for.
const NO_NUMBER: &str = "not a number that can be worked out here";

/// Kinds of machines that no profile describes.
const OTHER_MACHINES: [&str; 10] = [
    "DELTA",
    "MORGAN_SCARA",
    "MP_SCARA",
    "AXEL_TPARA",
    "POLAR",
    "POLARGRAPH",
    "COREYZ",
    "MARKFORGED_XY",
    "MARKFORGED_YX",
    "FOAMCUTTER_XYUV",
];

struct Reading<'a> {
    definitions: &'a Definitions,
    /// Values by name, those that Marlin works out with them.
    values: HashMap<String, String>,
    draft: Draft,
    seen: HashSet<String>,
}

/// Makes a profile of a configuration.
///
/// # Errors
/// The machine is of another kind than profiles know.
pub fn map(definitions: &Definitions) -> Result<Imported, ImportError> {
    if let Some(other) = OTHER_MACHINES.iter().find_map(|name| definitions.get(name)) {
        let what = format!("{}: profiles know Cartesian, CoreXY and CoreXZ machines only", other.name);
        return Err(ImportError::Machine(other.file.clone(), other.line, what));
    }
    let mut values = definitions.values.clone();
    add_derived(&mut values);
    let mut reading = Reading { definitions, values, draft: Draft::new(), seen: HashSet::new() };
    reading.draft.put("name", "imported");
    reading.machine();
    reading.motion();
    for (index, axis) in ["x", "y", "z"].into_iter().enumerate() {
        reading.axis(index, axis);
    }
    reading.probe();
    reading.mesh();
    reading.z_motors();
    reading.skew();
    reading.backlash();
    reading.fans();
    reading.filament_sensor();
    reading.power_supply();
    reading.supply_signal();
    reading.heaters();
    for axis in ["x", "y", "z", "e"] {
        reading.driver(axis);
    }
    reading.filters();
    reading.rest();
    reading.draft.finish()
}

/// Names that Marlin works out of a configuration and that configurations use.
fn add_derived(values: &mut HashMap<String, String>) {
    for axis in ["X", "Y", "Z"] {
        let length = format!("({axis}_MAX_POS - ({axis}_MIN_POS))");
        // Before the bed had a size of its own, it was the travel.
        let bed =
            if values.contains_key(&format!("{axis}_BED_SIZE")) { format!("{axis}_BED_SIZE") } else { length.clone() };
        let middle = if values.contains_key("BED_CENTER_AT_0_0") { "0".to_owned() } else { format!("({bed} / 2)") };
        for (name, value) in [("MAX_LENGTH", length), ("CENTER", middle)] {
            values.entry(format!("{axis}_{name}")).or_insert(value);
        }
    }
}

impl<'a> Reading<'a> {
    fn row(&mut self, definition: &Definition, why: &str) -> Row {
        self.seen.insert(definition.name.clone());
        Row {
            file: definition.file.clone(),
            line: definition.line,
            key: definition.name.clone(),
            value: shown(&definition.value),
            kept: None,
            why: why.to_owned(),
        }
    }

    fn get(&self, name: &str) -> Option<&'a Definition> {
        self.definitions.get(name)
    }

    fn number(&self, name: &str) -> Option<f64> {
        number(&self.get(name)?.value, &self.values)
    }

    fn list(&self, name: &str) -> Option<Vec<Option<f64>>> {
        list(&self.get(name)?.value, &self.values)
    }

    fn keep(&mut self, name: &str, path: &str, value: impl Into<Value>, why: &str) {
        if let Some(definition) = self.get(name) {
            let row = self.row(definition, why);
            self.draft.keep(path, value, row);
        }
    }

    fn keep_number<T: Into<toml::Value>>(&mut self, name: &str, path: &str, change: impl Fn(f64) -> T) -> Option<f64> {
        let number = self.number(name);
        match number {
            Some(number) => self.keep(name, path, change(number), ""),
            None => self.lose(name, NO_NUMBER),
        }
        number
    }

    /// The numbers of a list as the axes of a key.
    fn keep_axes(&mut self, name: &str, path: &str, axes: &[&str]) {
        let numbers = self.list(name).unwrap_or_default();
        if numbers.iter().zip(axes).filter(|(number, _)| number.is_some()).count() < axes.len() {
            self.lose(name, NO_NUMBER);
        }
        for (axis, number) in axes.iter().zip(numbers) {
            if let Some(number) = number {
                self.keep(name, &format!("{path}.{axis}"), number, "");
            }
        }
    }

    fn machine(&mut self) {
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

    fn motion(&mut self) {
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
        let turned: Vec<(String, &str)> = ALL
            .into_iter()
            .map(|axis| {
                (format!("INVERT_{}_DIR", if axis == "e" { "E0".to_owned() } else { axis.to_ascii_uppercase() }), axis)
            })
            .filter(|(name, _)| self.get(name).is_some_and(|definition| definition.value == "true"))
            .collect();
        let axes: Vec<Value> = turned.iter().map(|(_, axis)| Value::from(*axis)).collect();
        for (name, _) in turned {
            self.keep(&name, "driver.inverted", axes.clone(), "check the direction before homing");
        }
    }

    fn axis(&mut self, index: usize, axis: &str) {
        let upper = axis.to_ascii_uppercase();
        self.keep_number(&format!("{upper}_MIN_POS"), &format!("lower_end_mm.{axis}"), |low| low.min(0.0));
        let end = self.keep_number(&format!("{upper}_MAX_POS"), &format!("size_mm.{axis}"), |high| high);
        let homing = |key: &str| format!("homing.{axis}.{key}");
        let direction = format!("{upper}_HOME_DIR");
        let is_high = self.number(&direction).is_some_and(|direction| direction > 0.0);
        self.keep(&direction, &homing("end"), if is_high { "max" } else { "min" }, "");
        let own = format!("MANUAL_{upper}_HOME_POS");
        if self.keep_number(&own, &homing("position_mm"), |place| place).is_none() {
            let low = self.number(&format!("{upper}_MIN_POS")).unwrap_or(0.0);
            let place = if is_high { end.unwrap_or(low) } else { low };
            self.draft.put(&homing("position_mm"), place);
        }
        let nth = |list: Option<Vec<Option<f64>>>| list.and_then(|list| list.get(index).copied().flatten());
        // Newer and the oldest files have one list in mm/min, those between two numbers.
        let older = if axis == "z" { "HOMING_FEEDRATE_Z" } else { "HOMING_FEEDRATE_XY" };
        let lists = ["HOMING_FEEDRATE_MM_M", "HOMING_FEEDRATE"];
        let fast = match lists.into_iter().find_map(|name| Some((name, nth(self.list(name))?))) {
            Some((name, feed)) => {
                self.keep(name, &homing("fast_mm_per_s"), feed / 60.0, "");
                Some(feed / 60.0)
            }
            None => self.keep_number(older, &homing("fast_mm_per_s"), |feed| feed / 60.0).map(|feed| feed / 60.0),
        };
        let stall = format!("{upper}_STALL_SENSITIVITY");
        let by_stall = self.get("SENSORLESS_HOMING").is_some() && axis != "z" && self.get(&stall).is_some();
        let back = nth(self.list("HOMING_BUMP_MM"));
        if let Some(fast) = fast.filter(|_| by_stall && back == Some(0.0)) {
            // Marlin homes once then, at the full speed.
            self.draft.put(&homing("slow_mm_per_s"), fast);
        } else if let Some(fast) = fast {
            let divisor = nth(self.list("HOMING_BUMP_DIVISOR")).filter(|divisor| *divisor >= 1.0);
            self.draft.put(&homing("slow_mm_per_s"), fast / divisor.unwrap_or(4.0));
            if divisor.is_some() {
                self.keep("HOMING_BUMP_DIVISOR", &homing("slow_mm_per_s"), fast / divisor.unwrap_or(4.0), "");
            }
        }
        match back {
            Some(0.0) => {
                if let Some(definition) = self.get("HOMING_BUMP_MM") {
                    let why = "a profile homes twice: the distance is above 0, and where it is 0 here the built-in one";
                    let row = self.row(definition, why);
                    self.draft.note(row);
                }
            }
            Some(back) => self.keep("HOMING_BUMP_MM", &homing("back_off_mm"), back, ""),
            None => {}
        }
        let side = if is_high { "MAX" } else { "MIN" };
        let state = format!("{upper}_{side}_ENDSTOP_HIT_STATE");
        let is_low = self.get(&state).map(|definition| definition.value == "LOW");
        if let Some(is_low) = is_low {
            self.keep(&state, &homing("triggers_low"), is_low, "");
        }
        let inverting = format!("{upper}_{side}_ENDSTOP_INVERTING");
        if let Some(is_low) = self.get(&inverting).map(|definition| definition.value == "true") {
            self.keep(&inverting, &homing("triggers_low"), is_low, "");
        }
        if by_stall {
            self.keep("SENSORLESS_HOMING", &homing("sensor"), "stall", "");
        }
    }

    fn probe(&mut self) {
        let probes = ["BLTOUCH", "FIX_MOUNTED_PROBE", "NOZZLE_AS_PROBE", "TOUCH_MI_PROBE", "PROBE_MANUALLY"];
        let Some(name) = probes.into_iter().find(|name| self.get(name).is_some()) else { return };
        let homes = ["USE_PROBE_FOR_Z_HOMING", "Z_MIN_PROBE_USES_Z_MIN_ENDSTOP_PIN"];
        if name == "PROBE_MANUALLY" || !homes.iter().any(|home| self.get(home).is_some()) {
            return;
        }
        self.keep(name, "homing.z.sensor", "probe", "");
        for home in homes {
            self.keep(home, "homing.z.sensor", "probe", "");
        }
        for axis in ["x", "y", "z"] {
            self.draft.put(&format!("homing.probe_offset_mm.{axis}"), 0.0);
        }
        self.keep_axes("NOZZLE_TO_PROBE_OFFSET", "homing.probe_offset_mm", &["x", "y", "z"]);
        for axis in ["x", "y", "z"] {
            let older = format!("{}_PROBE_OFFSET_FROM_EXTRUDER", axis.to_ascii_uppercase());
            self.keep_number(&older, &format!("homing.probe_offset_mm.{axis}"), |offset| offset);
        }
        if name == "BLTOUCH" {
            self.draft.put("bltouch.move_ms", MARLIN_BLTOUCH_DELAY_MS);
            self.keep_number("BLTOUCH_DELAY", "bltouch.move_ms", |ms| ms);
            // Without a value it is on.
            if let Some(is_on) = self.get("BLTOUCH_HS_MODE").map(|definition| definition.value != "false") {
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

    fn lose(&mut self, name: &str, why: &str) {
        if let Some(definition) = self.get(name) {
            let row = self.row(definition, why);
            self.draft.note(row);
        }
    }

    fn driver(&mut self, axis: &str) {
        let upper = if axis == "e" { "E0".to_owned() } else { axis.to_ascii_uppercase() };
        let kind = format!("{upper}_DRIVER_TYPE");
        if self.get(&kind).is_none_or(|definition| definition.value != "TMC2209") {
            return;
        }
        let (current, microsteps) = (format!("{upper}_CURRENT"), format!("{upper}_MICROSTEPS"));
        let (Some(current_ma), Some(steps)) = (self.number(&current), self.number(&microsteps)) else {
            let why = format!("without {current} and {microsteps} (of Configuration_adv.h) it runs as its pins say");
            return self.lose(&kind, &why);
        };
        let path = |key: &str| format!("drivers.{axis}.{key}");
        self.keep(&kind, &path("current_ma"), current_ma as i64, "");
        self.keep(&current, &path("current_ma"), current_ma as i64, "");
        self.keep(&microsteps, &path("microsteps"), steps as i64, "");
        self.draft.put(&path("hold_current_percent"), 50);
        if let Some(hold) = self.number("HOLD_MULTIPLIER") {
            self.keep("HOLD_MULTIPLIER", &path("hold_current_percent"), (hold * 100.0).round() as i64, "");
        }
        let interpolates = self.get("INTERPOLATE").is_none_or(|definition| definition.value != "false");
        self.draft.put(&path("interpolate"), interpolates);
        self.keep("INTERPOLATE", &path("interpolate"), interpolates, "");
        let quiet = match axis {
            "z" => "STEALTHCHOP_Z",
            "e" => "STEALTHCHOP_E",
            _ => "STEALTHCHOP_XY",
        };
        self.draft.put(&path("stealth_chop"), self.get(quiet).is_some());
        self.keep(quiet, &path("stealth_chop"), true, "");
        self.draft.put(&path("spread_cycle_above_mm_per_s"), 0);
        let hybrid = format!("{upper}_HYBRID_THRESHOLD");
        if self.get("HYBRID_THRESHOLD").is_some() && self.get(quiet).is_some() {
            self.keep_number(&hybrid, &path("spread_cycle_above_mm_per_s"), |speed| speed as i64);
            self.keep("HYBRID_THRESHOLD", &path("stealth_chop"), true, "");
        }
        let stall = format!("{upper}_STALL_SENSITIVITY");
        let threshold = self.number(&stall).unwrap_or(0.0);
        self.draft.put(&path("stall_threshold"), threshold as i64);
        self.keep(&stall, &path("stall_threshold"), threshold as i64, "");
    }

    fn filters(&mut self) {
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

    /// The sensor that sees filament move, or the switch that tells whether there is some; its state is the one without.
    fn filament_sensor(&mut self) {
        let is_on = self.get("FIL_RUNOUT_ENABLED_DEFAULT").is_none_or(|definition| definition.value != "false");
        if self.get("FILAMENT_RUNOUT_SENSOR").is_none() || !is_on {
            return;
        }
        let both = self.get("FILAMENT_SWITCH_AND_MOTION").is_some();
        if both || self.get("FILAMENT_MOTION_SENSOR").is_some() {
            // With both, the state is the switch's.
            let names: &[&str] = if both {
                &["FILAMENT_SWITCH_AND_MOTION"]
            } else {
                &["FILAMENT_RUNOUT_SENSOR", "FILAMENT_MOTION_SENSOR"]
            };
            for name in names {
                self.keep(name, "filament_sensor.kind", "motion", "its pin is the board's");
            }
            self.keep_number("FILAMENT_RUNOUT_DISTANCE_MM", "filament_sensor.detection_mm", |length| length);
            if !both {
                self.lose("FIL_RUNOUT_STATE", "neither level of a motion sensor says anything");
                return;
            }
        }
        let path = if both { "filament_switch.missing_is_low" } else { "filament_sensor.missing_is_low" };
        let missing_is_low = self.get("FIL_RUNOUT_STATE").is_none_or(|definition| definition.value != "HIGH");
        for name in ["FILAMENT_RUNOUT_SENSOR", "FIL_RUNOUT_STATE"] {
            self.keep(name, path, missing_is_low, "its pin is the board's");
        }
    }

    /// Rows for all definitions that have none yet.
    fn rest(&mut self) {
        for definition in &self.definitions.all {
            if !self.seen.contains(&definition.name) {
                let row = self.row(definition, reason(&definition.name));
                self.draft.add(row);
            }
        }
    }
}
