//! What of Klipper's settings a profile says.

use std::collections::HashSet;

use toml::{Table, Value};

use super::draft::Draft;
use super::klipper::{Config, Entry, Section};
use super::{ImportError, Imported, Row, shown};

/// Klipper's own values of keys that a file leaves out (its Configuration reference).
const SQUARE_CORNER_VELOCITY: f64 = 5.0;
const HOMING_SPEED: f64 = 5.0;
const HOMING_RETRACT_DIST: f64 = 5.0;
/// Junction deviation of a square corner: (sqrt 2 - 1) of v^2 / a.
const CORNER_SHARE: f64 = std::f64::consts::SQRT_2 - 1.0;
/// Klipper's PID gains are for a power of 255.
const FULL_POWER: f64 = 255.0;

/// The settings that have been looked at, and the profile that they make.
struct Reading<'a> {
    config: &'a Config,
    draft: Draft,
    /// Places of settings with a row.
    seen: HashSet<(String, usize)>,
}

/// Makes a profile of a configuration.
///
/// # Errors
/// The machine is of another kind than profiles know, or lacks what they need.
pub fn map(config: &Config) -> Result<Imported, ImportError> {
    let mut reading = Reading { config, draft: Draft::new(), seen: HashSet::new() };
    reading.draft.put("name", "imported");
    reading.printer()?;
    for axis in ["x", "y", "z"] {
        reading.axis(axis);
    }
    reading.probe();
    reading.steps("extruder", "e");
    reading.extruder();
    for (section, heater) in [("extruder", "nozzle"), ("heater_bed", "bed")] {
        reading.heater(section, heater);
    }
    for (section, axis) in [("stepper_x", "x"), ("stepper_y", "y"), ("stepper_z", "z"), ("extruder", "e")] {
        reading.driver(section, axis);
    }
    reading.inverted();
    reading.shaper();
    reading.retraction();
    reading.rest();
    reading.draft.finish()
}

impl<'a> Reading<'a> {
    fn section(&self, name: &str) -> Option<&'a Section> {
        self.config.section(name)
    }

    /// The last setting of a key, which holds.
    fn entry(&self, section: &str, key: &str) -> Option<&'a Entry> {
        self.section(section)?.entries.iter().rev().find(|entry| entry.key == key)
    }

    fn row(&mut self, section: &str, entry: &Entry, why: impl Into<String>) -> Row {
        self.seen.insert((entry.file.clone(), entry.line));
        Row {
            file: entry.file.clone(),
            line: entry.line,
            key: format!("[{section}] {}", entry.key),
            value: shown(&entry.value),
            kept: None,
            why: why.into(),
        }
    }

    /// A number, without keeping it. A setting that is none gets its row.
    fn number(&mut self, section: &str, key: &str) -> Option<f64> {
        let entry = self.entry(section, key)?;
        let number = entry.value.parse().ok().filter(|number: &f64| number.is_finite());
        if number.is_none() {
            let row = self.row(section, entry, "not a number");
            self.draft.add(row);
        }
        number
    }

    /// Keeps a setting as these keys.
    fn keep(&mut self, section: &str, key: &str, paths: &[&str], value: impl Into<Value>, why: &str) {
        let Some(entry) = self.entry(section, key) else { return };
        let value = value.into();
        for path in paths {
            let row = self.row(section, entry, why);
            self.draft.keep(path, value.clone(), row);
        }
    }

    /// Keeps a number as these keys, changed by a function.
    fn keep_number(&mut self, section: &str, key: &str, paths: &[&str], change: impl Fn(f64) -> f64) -> Option<f64> {
        let number = self.number(section, key)?;
        self.keep(section, key, paths, change(number), "");
        Some(number)
    }

    fn lose(&mut self, section: &str, key: &str, why: &str) {
        if let Some(entry) = self.entry(section, key) {
            let row = self.row(section, entry, why);
            self.draft.add(row);
        }
    }

    fn printer(&mut self) -> Result<(), ImportError> {
        let Some(printer) = self.section("printer") else { return Err(ImportError::Unknown) };
        let Some(entry) = self.entry("printer", "kinematics") else {
            let what = "[printer] has no kinematics: expected cartesian, corexy or corexz".to_owned();
            return Err(ImportError::Line(printer.file.clone(), printer.line, what));
        };
        let kind = entry.value.clone();
        if !["cartesian", "corexy", "corexz"].contains(&kind.as_str()) {
            let kind = shown(&kind);
            let what = format!("kinematics: {kind}: profiles know cartesian, corexy and corexz machines only");
            return Err(ImportError::Machine(entry.file.clone(), entry.line, what));
        }
        self.keep("printer", "kinematics", &["kinematics"], kind, "");
        let feeds = ["max_feed_mm_per_s.x", "max_feed_mm_per_s.y"];
        let feed = self.keep_number("printer", "max_velocity", &feeds, |feed| feed);
        let z = self.keep_number("printer", "max_z_velocity", &["max_feed_mm_per_s.z"], |feed| feed);
        if let (Some(feed), None) = (feed, z) {
            self.draft.put("max_feed_mm_per_s.z", feed);
        }
        let limits = [
            "acceleration_mm_per_s2.print",
            "acceleration_mm_per_s2.travel",
            "max_acceleration_mm_per_s2.x",
            "max_acceleration_mm_per_s2.y",
        ];
        let acceleration = self.keep_number("printer", "max_accel", &limits, |limit| limit);
        let z = self.keep_number("printer", "max_z_accel", &["max_acceleration_mm_per_s2.z"], |limit| limit);
        if let Some(acceleration) = acceleration {
            if z.is_none() {
                self.draft.put("max_acceleration_mm_per_s2.z", acceleration);
            }
            let deviation = |speed: f64| speed * speed * CORNER_SHARE / acceleration;
            let path = ["junction_deviation_mm"];
            if self.keep_number("printer", "square_corner_velocity", &path, deviation).is_none() {
                self.draft.put(path[0], deviation(SQUARE_CORNER_VELOCITY));
            }
        }
        Ok(())
    }

    /// Steps per mm of a motor; mm per turn of it.
    fn steps(&mut self, section: &str, axis: &str) -> Option<f64> {
        let path = format!("steps_per_mm.{axis}");
        if let Some(distance) = self.number(section, "step_distance") {
            self.keep(section, "step_distance", &[&path], 1.0 / distance, "");
            return None;
        }
        let distance = self.number(section, "rotation_distance")?;
        let full_steps = self.number(section, "full_steps_per_rotation").unwrap_or(200.0);
        let driver = format!("tmc2209 {section}");
        let microsteps = self.number(section, "microsteps").or_else(|| self.number(&driver, "microsteps"))?;
        let gears = match self.entry(section, "gear_ratio") {
            None => 1.0,
            Some(entry) => match gear_ratio(&entry.value) {
                Some(ratio) => ratio,
                None => {
                    let row = self.row(section, entry, "not a ratio such as 50:17");
                    self.draft.add(row);
                    return None;
                }
            },
        };
        let steps = full_steps * microsteps * gears / distance;
        for key in ["rotation_distance", "microsteps", "full_steps_per_rotation", "gear_ratio"] {
            self.keep(section, key, &[&path], steps, "");
        }
        Some(distance / gears)
    }

    fn axis(&mut self, axis: &str) {
        let section = &*format!("stepper_{axis}");
        self.steps(section, axis);
        let position = |key: &str| format!("{key}.{axis}");
        let low = self.number(section, "position_min");
        if let Some(low) = low {
            let why = if low > 0.0 { "a profile's travel begins at 0 or below" } else { "" };
            self.keep(section, "position_min", &[&position("lower_end_mm")], low.min(0.0), why);
        }
        let high = self.keep_number(section, "position_max", &[&position("size_mm")], |high| high);
        let homing = |key: &str| format!("homing.{axis}.{key}");
        let pin = self.entry(section, "endstop_pin");
        let text = pin.map_or("", |pin| pin.value.as_str());
        let is_stall = text.contains("virtual_endstop") && !text.contains("z_virtual_endstop");
        let is_probe = text.contains("z_virtual_endstop");
        let end = self.number(section, "position_endstop");
        let is_high = match self.entry(section, "homing_positive_dir").map(|entry| entry.value.to_ascii_lowercase()) {
            Some(word) => matches!(word.as_str(), "true" | "1" | "yes"),
            None => {
                let (low, high, end) = (low.unwrap_or(0.0), high.unwrap_or(0.0), end.unwrap_or(0.0));
                (high - end).abs() < (end - low).abs()
            }
        };
        let side = if is_high { "max" } else { "min" };
        if self.entry(section, "homing_positive_dir").is_some() {
            self.keep(section, "homing_positive_dir", &[&homing("end")], side, "");
        } else if end.is_some() {
            self.keep(section, "position_endstop", &[&homing("end")], side, "");
        }
        match end {
            Some(end) => self.keep(section, "position_endstop", &[&homing("position_mm")], end, ""),
            None if is_probe => self.draft.put(&homing("position_mm"), 0.0),
            None => {}
        }
        let fast = self.keep_number(section, "homing_speed", &[&homing("fast_mm_per_s")], |speed| speed);
        let fast = fast.unwrap_or(HOMING_SPEED);
        self.draft.put(&homing("fast_mm_per_s"), fast);
        let slow = self.keep_number(section, "second_homing_speed", &[&homing("slow_mm_per_s")], |speed| speed);
        if slow.is_none() {
            self.draft.put(&homing("slow_mm_per_s"), fast / 2.0);
        }
        let back = self.number(section, "homing_retract_dist");
        match back {
            Some(0.0) => self.lose(section, "homing_retract_dist", "a profile homes twice: the distance is above 0"),
            Some(back) => self.keep(section, "homing_retract_dist", &[&homing("back_off_mm")], back, ""),
            None => self.draft.put(&homing("back_off_mm"), HOMING_RETRACT_DIST),
        }
        if pin.is_some() {
            let sensor = if is_probe {
                "probe"
            } else if is_stall {
                "stall"
            } else {
                "end-stop"
            };
            self.keep(section, "endstop_pin", &[&homing("sensor")], sensor, "its pin is the board's");
            if text.contains('!') && !is_stall {
                self.keep(section, "endstop_pin", &[&homing("triggers_low")], true, "its pin is the board's");
            }
        }
    }

    fn probe(&mut self) {
        let home = self.entry("safe_z_home", "home_xy_position").and_then(|entry| two_numbers(&entry.value));
        if let Some([x, y]) = home {
            self.keep("safe_z_home", "home_xy_position", &["homing.home_at_mm.x"], x, "");
            self.keep("safe_z_home", "home_xy_position", &["homing.home_at_mm.y"], y, "");
        }
        self.keep_number("safe_z_home", "z_hop", &["homing.raise_mm"], |height| height);
        let is_probe =
            self.entry("stepper_z", "endstop_pin").is_some_and(|pin| pin.value.contains("z_virtual_endstop"));
        let Some(section) = ["probe", "bltouch", "smart_effector", "probe_eddy_current"]
            .into_iter()
            .find(|name| self.section(name).is_some())
            .filter(|_| is_probe)
        else {
            return;
        };
        for (axis, sign) in [("x", 1.0), ("y", 1.0), ("z", -1.0)] {
            let path = format!("homing.probe_offset_mm.{axis}");
            if self.keep_number(section, &format!("{axis}_offset"), &[&path], |offset| sign * offset).is_none() {
                self.draft.put(&path, 0.0);
            }
        }
        if !self.draft.says("homing.raise_mm") {
            self.draft.put("homing.raise_mm", 5.0);
        }
        for axis in ["x", "y"] {
            let path = format!("homing.home_at_mm.{axis}");
            if !self.draft.says(&path) {
                let middle = self.draft.number(&format!("size_mm.{axis}")).unwrap_or_default() / 2.0;
                self.draft.put(&path, middle);
            }
        }
    }

    fn extruder(&mut self) {
        let same = |number: f64| number;
        self.keep_number("extruder", "nozzle_diameter", &["nozzle_diameter_mm"], same);
        self.keep_number("extruder", "filament_diameter", &["extrusion.filament_diameter_mm"], same);
        if self.draft.says("extrusion.filament_diameter_mm") {
            self.draft.put("extrusion.mode", "gcode");
        }
        self.keep_number("extruder", "min_extrude_temp", &["min_extrusion_celsius"], same);
        self.keep_number("extruder", "max_extrude_only_velocity", &["max_feed_mm_per_s.e"], same);
        let limits = ["acceleration_mm_per_s2.retract", "max_acceleration_mm_per_s2.e"];
        self.keep_number("extruder", "max_extrude_only_accel", &limits, same);
        self.keep_number(
            "extruder",
            "instantaneous_corner_velocity",
            &["instantaneous_corner_velocity_mm_per_s.e"],
            same,
        );
        if self.keep_number("extruder", "pressure_advance", &["pressure_advance.seconds"], same).is_some() {
            self.keep_number("extruder", "pressure_advance_smooth_time", &["pressure_advance.smooth_time_s"], same);
        }
        self.keep_number("idle_timeout", "timeout", &["heater_timeout_s"], same);
    }

    fn heater(&mut self, section: &str, heater: &str) {
        let path = |key: &str| format!("{heater}.{key}");
        let same = |number: f64| number;
        if let Some(entry) = self.entry(section, "sensor_type") {
            let custom = format!("thermistor {}", entry.value);
            let beta = self.number(&custom, "beta");
            let resistance = self.number(&custom, "resistance1");
            let sensor = match (beta, resistance) {
                (Some(beta), Some(resistance)) if self.number(&custom, "temperature1") == Some(25.0) => {
                    for key in ["temperature1", "resistance1", "beta"] {
                        self.keep(&custom, key, &[&path("sensor")], beta_table(resistance, beta), "");
                    }
                    Some(beta_table(resistance, beta))
                }
                _ => sensor(&entry.value),
            };
            match sensor {
                Some(value) => self.keep(section, "sensor_type", &[&path("sensor")], value, ""),
                None => {
                    let stand_in =
                        "no thermistor that a profile knows: set the sensor by hand, or temperatures are wrong";
                    self.lose(section, "sensor_type", stand_in);
                }
            }
        }
        self.keep_number(section, "pullup_resistor", &[&path("pull_up_ohm")], same);
        self.keep_number(section, "min_temp", &[&path("min_celsius")], same);
        self.keep_number(section, "max_temp", &[&path("max_celsius")], same);
        for (key, name) in [("pid_kp", "proportional"), ("pid_ki", "integral"), ("pid_kd", "derivative")] {
            self.keep_number(section, key, &[&path(name)], |gain| gain / FULL_POWER);
        }
        if let Some(entry) = self.entry(section, "control") {
            let why = if entry.value == "pid" {
                "profiles know PID only"
            } else {
                "profiles know PID only: set the gains by hand"
            };
            self.lose(section, "control", why);
        }
        let watch = format!("verify_heater {section}");
        for (key, name) in
            [("check_gain_time", "watch_s"), ("heating_gain", "watch_celsius"), ("hysteresis", "runaway_celsius")]
        {
            self.keep_number(&watch, key, &[&path(name)], same);
        }
    }

    fn driver(&mut self, section: &str, axis: &str) {
        let name = format!("tmc2209 {section}");
        let Some(milliamperes) = self.number(&name, "run_current").map(|amperes| (amperes * 1000.0).round()) else {
            return;
        };
        let path = |key: &str| format!("drivers.{axis}.{key}");
        self.keep(&name, "run_current", &[&path("current_ma")], milliamperes as i64, "");
        let hold = self.number(&name, "hold_current").filter(|_| milliamperes > 0.0);
        let percent = hold.map_or(100.0, |amperes| (amperes * 100_000.0 / milliamperes).round());
        self.draft.put(&path("hold_current_percent"), percent as i64);
        self.keep(&name, "hold_current", &[&path("hold_current_percent")], percent as i64, "");
        let microsteps =
            self.number(section, "microsteps").or_else(|| self.number(&name, "microsteps")).unwrap_or(16.0);
        self.draft.put(&path("microsteps"), microsteps as i64);
        if self.entry(&name, "microsteps").is_some() {
            self.keep(&name, "microsteps", &[&path("microsteps")], microsteps as i64, "");
        }
        let full_steps = self.number(section, "full_steps_per_rotation").unwrap_or(200.0);
        if let Some(steps_per_mm) = self.draft.number(&format!("steps_per_mm.{axis}")).filter(|steps| *steps > 0.0) {
            self.draft.put(&path("full_steps_per_turn"), full_steps);
            self.draft.put(&path("mm_per_turn"), full_steps * microsteps / steps_per_mm);
        }
        let interpolates =
            self.entry(&name, "interpolate").is_none_or(|entry| !entry.value.eq_ignore_ascii_case("false"));
        self.draft.put(&path("interpolate"), interpolates);
        self.keep(&name, "interpolate", &[&path("interpolate")], interpolates, "");
        // Below the threshold's speed the driver is quiet; 0 means never, 999999 always.
        let threshold = self.number(&name, "stealthchop_threshold").unwrap_or(0.0);
        let above = if threshold > 2000.0 { 0.0 } else { threshold };
        self.draft.put(&path("stealth_chop"), threshold > 0.0);
        self.draft.put(&path("spread_cycle_above_mm_per_s"), above);
        self.keep(&name, "stealthchop_threshold", &[&path("stealth_chop")], threshold > 0.0, "");
        let stall = self.number(&name, "driver_sgthrs").unwrap_or(0.0) as i64;
        self.draft.put(&path("stall_threshold"), stall);
        self.keep(&name, "driver_sgthrs", &[&path("stall_threshold")], stall, "");
    }

    /// Motors whose direction pin has a `!`.
    fn inverted(&mut self) {
        let axes = [("stepper_x", "x"), ("stepper_y", "y"), ("stepper_z", "z"), ("extruder", "e")];
        let pins = axes.map(|(section, axis)| (section, axis, self.entry(section, "dir_pin")));
        let turned = |pin: &Option<&Entry>| pin.is_some_and(|pin| pin.value.contains('!'));
        let list: Vec<Value> =
            pins.iter().filter(|(.., pin)| turned(pin)).map(|(_, axis, _)| Value::from(*axis)).collect();
        for (section, _, pin) in &pins {
            if turned(pin) {
                let why = "its pin is the board's: check the direction before homing";
                self.keep(section, "dir_pin", &["driver.inverted"], list.clone(), why);
            }
        }
    }

    fn shaper(&mut self) {
        for axis in ["x", "y"] {
            let frequency = format!("shaper_freq_{axis}");
            let path = |key: &str| format!("input_shaper.{axis}.{key}");
            if self.number("input_shaper", &frequency).is_none_or(|frequency| frequency <= 0.0) {
                continue;
            }
            let own = format!("shaper_type_{axis}");
            let key = if self.entry("input_shaper", &own).is_some() { own.as_str() } else { "shaper_type" };
            let kind =
                self.entry("input_shaper", key).map_or("mzv".to_owned(), |entry| entry.value.to_ascii_lowercase());
            self.draft.put(&path("kind"), kind.clone());
            self.keep("input_shaper", key, &[&path("kind")], kind, "");
            self.keep_number("input_shaper", &frequency, &[&path("frequency_hz")], |frequency| frequency);
            self.keep_number("input_shaper", &format!("damping_ratio_{axis}"), &[&path("damping")], |ratio| ratio);
        }
    }

    fn retraction(&mut self) {
        for (key, path) in [
            ("retract_length", "firmware_retraction.length_mm"),
            ("retract_speed", "firmware_retraction.retract_mm_per_s"),
            ("unretract_extra_length", "firmware_retraction.extra_recover_mm"),
            ("unretract_speed", "firmware_retraction.recover_mm_per_s"),
        ] {
            self.keep_number("firmware_retraction", key, &[path], |number| number);
        }
    }

    /// Rows for all settings that have none yet.
    fn rest(&mut self) {
        for (file, line, name, why) in &self.config.missing {
            let why = format!("not read: {why}");
            let (file, value) = (file.clone(), shown(name));
            self.draft.add(Row { file, line: *line, key: "include".to_owned(), value, kept: None, why });
        }
        for section in &self.config.sections {
            for entry in &section.entries {
                if !self.seen.contains(&(entry.file.clone(), entry.line)) {
                    let holds = self.entry(&section.name, &entry.key).is_some_and(|last| std::ptr::eq(last, entry));
                    let why = if holds { reason(&section.name, &entry.key) } else { "a later line sets it" };
                    let row = self.row(&section.name, entry, why);
                    self.draft.add(row);
                }
            }
            if section.entries.is_empty() {
                let (file, key) = (section.file.clone(), format!("[{}]", section.name));
                let why = reason(&section.name, "").to_owned();
                self.draft.add(Row { file, line: section.line, key, value: String::new(), kept: None, why });
            }
        }
    }
}

/// Why a profile has no place for a setting.
fn reason(section: &str, key: &str) -> &'static str {
    let kind = section.split(' ').next().unwrap_or_default();
    match kind {
        "gcode_macro" | "delayed_gcode" => "macros: write plain G-code into the slicer's start and end code",
        "bed_mesh" => "no mesh of the bed",
        "mcu" | "board_pins" | "static_digital_output" | "output_pin" | "multi_pin" | "duplicate_pin_override" => {
            "the board's"
        }
        "stepper_z1" | "stepper_z2" | "stepper_z3" | "stepper_x1" | "stepper_y1" | "z_tilt" | "quad_gantry_level" => {
            "one driver an axis: several motors on one driver turn together"
        }
        "extruder1" | "extruder2" | "extruder_stepper" => "one extruder",
        "tmc2208" | "tmc2130" | "tmc5160" | "tmc2240" | "tmc2660" => {
            "drivers that are set are TMC2209: this one runs as its pins say"
        }
        "fan" | "heater_fan" | "controller_fan" | "fan_generic" | "temperature_fan" => "fans are the board's",
        "display" | "display_template" | "neopixel" | "led" | "menu" => "no display and no lights",
        "filament_switch_sensor" | "filament_motion_sensor" => "no filament sensor",
        "virtual_sdcard" | "pause_resume" | "display_status" | "respond" | "exclude_object" | "gcode_arcs"
        | "save_variables" => "Klipper's own module",
        "adxl345" | "resonance_tester" | "lis2dw" | "mpu9250" => "no accelerometer",
        "temperature_sensor" | "heater_generic" => "two heaters with their sensors: nozzle and bed",
        _ if key.ends_with("_pin") || key == "pin" || key == "serial" || key == "uart_address" => {
            "pins are the board's"
        }
        _ if key == "sense_resistor" => "the board's",
        _ => "no such key in a profile",
    }
}

/// The product of ratios such as `50:17, 3:1`.
fn gear_ratio(text: &str) -> Option<f64> {
    text.split(',').try_fold(1.0, |product, pair| {
        let (driven, driving) = pair.split_once(':')?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
        Some(product * number(driven)? / number(driving)?)
    })
}

fn two_numbers(text: &str) -> Option<[f64; 2]> {
    let (x, y) = text.split_once(',')?;
    Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
}

fn beta_table(r25_ohm: f64, beta_k: f64) -> Value {
    Value::Table(Table::from_iter([("r25_ohm".to_owned(), r25_ohm.into()), ("beta_k".to_owned(), beta_k.into())]))
}

/// A thermistor by Klipper's name.
fn sensor(name: &str) -> Option<Value> {
    match name {
        "EPCOS 100K B57560G104F" => Some("epcos-100k".into()),
        "ATC Semitec 104GT-2" => Some("semitec-104gt-2".into()),
        "Generic 3950" | "NTC 100K beta 3950" => Some(beta_table(100_000.0, 3950.0)),
        _ => None,
    }
}
