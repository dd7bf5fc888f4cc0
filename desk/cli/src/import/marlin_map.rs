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

use std::collections::HashSet;

use toml::Value;

use super::c_macros::is_enabled;
use super::draft::Draft;
use super::expression::{list, number};
use super::marlin::{Definition, Definitions};
use super::{ImportError, Imported, Row, shown};
use reasons::reason;

/// Marlin's `BLTOUCH_DELAY` without the definition, ms.
const MARLIN_BLTOUCH_DELAY_MS: f64 = 500.0;

/// Junction deviation of a jerk, as Marlin's own notes have it: 0.4 v^2 / a.
const JERK_SHARE: f64 = 0.4;

/// Why a value is not kept that the profile has a key for.
const NO_NUMBER: &str = "not a number that can be worked out here";

/// Kinds of machines that no profile describes.
const OTHER_MACHINES: [&str; 16] = [
    "DELTA",
    "MORGAN_SCARA",
    "MP_SCARA",
    "AXEL_TPARA",
    "POLAR",
    "POLARGRAPH",
    "COREYZ",
    "COREZY",
    "COREZX",
    "ARTICULATED_ROBOT_ARM",
    "TPARA",
    "DUAL_X_CARRIAGE",
    "MAGNETIC_PARKING_EXTRUDER",
    "MARKFORGED_XY",
    "MARKFORGED_YX",
    "FOAMCUTTER_XYUV",
];

struct Reading<'a> {
    definitions: &'a Definitions,
    /// The same with the values that Marlin works out of them.
    values: Definitions,
    draft: Draft,
    seen: HashSet<String>,
}

/// Makes a profile of a configuration.
///
/// # Errors
/// The machine is of another kind than profiles know.
pub fn map(definitions: &Definitions, assume: bool) -> Result<Imported, ImportError> {
    let is_on = |name: &&str| is_enabled(name, definitions).unwrap_or(true);
    if let Some(other) = OTHER_MACHINES.iter().filter(|name| is_on(name)).find_map(|name| definitions.get(name)) {
        let kinds = "profiles know Cartesian, CoreXY and CoreXZ machines with one carriage only";
        let what = format!("{}: {kinds}", other.name);
        return Err(ImportError::Machine(other.file.clone(), other.line, what));
    }
    if definitions.get("DEFAULT_AXIS_STEPS_PER_UNIT").is_none() && definitions.missing.is_empty() {
        return Err(ImportError::Unknown);
    }
    let mut values = definitions.clone();
    add_derived(&mut values.values);
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
    reading.identity();
    reading.rest();
    reading.draft.finish(assume)
}

/// Names that Marlin works out of a configuration and that configurations use.
fn add_derived(values: &mut std::collections::HashMap<String, String>) {
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
            refused: false,
        }
    }

    fn get(&self, name: &str) -> Option<&'a Definition> {
        self.definitions.get(name)
    }

    /// Whether a switch is on: without a value it is. `None` where it is not there or cannot be worked out.
    fn flag(&self, name: &str) -> Option<bool> {
        let definition = self.get(name)?;
        if definition.value.is_empty() {
            return Some(true);
        }
        number(name, &self.values).map(|number| number != 0.0)
    }

    /// Whether a signal's state is low. A state that cannot be worked out is a gap in what the machine is.
    fn is_low(&mut self, name: &str, path: &str) -> Option<bool> {
        let definition = self.get(name)?;
        let state = number(name, &self.values).map(|number| number == 0.0);
        if state.is_none() {
            let row = self.row(definition, NO_NUMBER);
            self.draft.gap(path, Some(row), "expected HIGH or LOW, or what can be worked out to one of them");
        }
        state
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
        self.directions();
        self.e_of_several();
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

    /// Lists may go on after E, with an element for each further extruder.
    fn e_of_several(&mut self) {
        if self.flag("DISTINCT_E_FACTORS") == Some(true) {
            let why = "the first extruder's values are kept: write the second one's as tools.t1.steps_per_mm";
            self.lose("DISTINCT_E_FACTORS", why);
        }
    }

    fn axis(&mut self, index: usize, axis: &str) {
        let upper = axis.to_ascii_uppercase();
        let low_name = format!("{upper}_MIN_POS");
        if self.keep_number(&low_name, &format!("lower_end_mm.{axis}"), |low| low.min(0.0)).is_some_and(|low| low > 0.0)
        {
            self.lose(&low_name, "a profile's travel begins at 0 or below");
        }
        let end = self.keep_number(&format!("{upper}_MAX_POS"), &format!("size_mm.{axis}"), |high| high);
        let homing = |key: &str| format!("homing.{axis}.{key}");
        let direction = format!("{upper}_HOME_DIR");
        let is_high = self.number(&direction).is_some_and(|direction| direction > 0.0);
        if self.number(&direction).is_some() {
            self.keep(&direction, &homing("end"), if is_high { "max" } else { "min" }, "");
        }
        self.draft.put(&homing("sensor"), "end-stop");
        let own = format!("MANUAL_{upper}_HOME_POS");
        if self.keep_number(&own, &homing("position_mm"), |place| place).is_none() {
            let low = self.number(&format!("{upper}_MIN_POS")).unwrap_or(0.0);
            let place = if is_high { end.unwrap_or(low) } else { low };
            self.draft.put(&homing("position_mm"), place);
        }
        self.reach_end_stop(axis, &own);
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
        let path = homing("triggers_low");
        let state = format!("{upper}_{side}_ENDSTOP_HIT_STATE");
        if let Some(is_low) = self.is_low(&state, &path) {
            self.keep(&state, &path, is_low, "");
        }
        let inverting = format!("{upper}_{side}_ENDSTOP_INVERTING");
        if let Some(is_low) = self.is_low(&inverting, &path).map(|is_false| !is_false) {
            self.keep(&inverting, &path, is_low, "");
        }
        if by_stall {
            self.keep("SENSORLESS_HOMING", &homing("sensor"), "stall", "");
            // The signal of a driver is high, whatever the file says of a switch.
            self.draft.put(&path, false);
        } else if self.get("SENSORLESS_HOMING").is_some() && self.get(&stall).is_some() {
            let row = self.get("SENSORLESS_HOMING").map(|definition| self.row(definition, ""));
            self.draft.gap(&homing("sensor"), row, "Z would push the nozzle into the bed: give it a switch or a probe");
        }
    }

    /// The travel goes as far as the end stop is: an end stop beyond it would be at another machine's place.
    fn reach_end_stop(&mut self, axis: &str, name: &str) {
        let number = |draft: &Draft, path: String| draft.number(&path);
        let Some(place) =
            number(&self.draft, format!("homing.{axis}.position_mm")).filter(|_| self.get(name).is_some())
        else {
            return;
        };
        let why = "the travel goes as far as the end stop is";
        let (low, high) = (format!("lower_end_mm.{axis}"), format!("size_mm.{axis}"));
        if number(&self.draft, low.clone()).is_some_and(|low| place < low) {
            self.keep(name, &low, place, why);
        } else if number(&self.draft, high.clone()).is_some_and(|high| place > high) {
            self.keep(name, &high, place, why);
        }
    }

    fn probe(&mut self) {
        const SWITCHES: [&str; 6] = [
            "BLTOUCH",
            "FIX_MOUNTED_PROBE",
            "NOZZLE_AS_PROBE",
            "BIQU_MICROPROBE_V1",
            "BIQU_MICROPROBE_V2",
            "TOUCH_MI_PROBE",
        ];
        // Those that a servo, a coil or a sledge brings out, or that are no switch.
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
            let home = self.get("USE_PROBE_FOR_Z_HOMING").filter(|_| self.flag("USE_PROBE_FOR_Z_HOMING") == Some(true));
            if let Some(definition) = home {
                let row = self.row(definition, "");
                self.draft.gap("homing.z.sensor", Some(row), "Z homes by a probe, and none of a known kind is defined");
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
            // Without a value it is on.
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

    /// The level at which a probe triggers. Marlin takes that of a BLTouch as it is, whatever the file says.
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
                self.lose(name, "Z homes by the probe, which has a level of its own");
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

    /// Notes what the configuration does not say of what the machine is.
    fn identity(&mut self) {
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
        let interpolates = self.flag("INTERPOLATE").unwrap_or(true);
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
        let is_on = self.flag("FIL_RUNOUT_ENABLED_DEFAULT").unwrap_or(true);
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
        let missing_is_low = self.is_low("FIL_RUNOUT_STATE", path).unwrap_or(true);
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
