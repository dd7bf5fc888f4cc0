//! Maps Klipper's settings to a profile's keys.

mod axes;
mod bed_mesh;
mod fans;
mod heaters;
mod identity;
mod macros;
mod reasons;
mod retraction;
mod skew;
mod tools;
mod z_motors;

use std::collections::HashSet;

use toml::Value;

use crate::draft::Draft;
use crate::error::ImportError;
use crate::imported::{Imported, Row};
use crate::klipper::{Config, Entry, Section};
use crate::text::shown;
use reasons::{nothing_in_it, reason};

/// Klipper's own values of keys that a file leaves out (its Configuration reference).
const SQUARE_CORNER_VELOCITY: f64 = 5.0;
const MINIMUM_CRUISE_RATIO: f64 = 0.5;
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
pub fn map(config: &Config, assume: bool) -> Result<Imported, ImportError> {
    let mut reading = Reading { config, draft: Draft::new(), seen: HashSet::new() };
    reading.draft.put("name", "imported");
    reading.printer()?;
    for axis in ["x", "y", "z"] {
        reading.axis(axis);
    }
    reading.probe();
    reading.bed_mesh();
    reading.bed_screws();
    reading.z_motors();
    reading.skew();
    reading.steps("extruder", "e");
    reading.extruder();
    for (section, heater) in [("extruder", "nozzle"), ("heater_bed", "bed")] {
        reading.heater(section, heater);
    }
    for (section, axis) in [("stepper_x", "x"), ("stepper_y", "y"), ("stepper_z", "z"), ("extruder", "e")] {
        reading.driver(section, axis);
    }
    reading.tools();
    reading.inverted();
    reading.shaper();
    reading.chamber();
    reading.fans();
    reading.retraction();
    reading.filament_sensor();
    reading.power_supply();
    reading.macros();
    reading.identity();
    reading.rest();
    reading.draft.finish(assume)
}

impl<'a> Reading<'a> {
    fn section(&self, name: &str) -> Option<&'a Section> {
        self.config.section(name)
    }

    /// The setting of a key that holds.
    fn entry(&self, section: &str, key: &str) -> Option<&'a Entry> {
        self.section(section)?.entry(key)
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
            refused: false,
        }
    }

    /// Parses a number without keeping it. A setting that is not a number gets its row.
    fn number(&mut self, section: &str, key: &str) -> Option<f64> {
        let entry = self.entry(section, key)?;
        let number = plain_number(&entry.value);
        if number.is_none() {
            let row = self.row(section, entry, "not a number");
            self.draft.note(row);
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
            self.draft.note(row);
        }
    }

    /// Notes that no setting gives a part of the machine's identity, or that it is missing.
    fn gap(&mut self, path: &str, section: &str, key: &str, what: &str) {
        let row = self.entry(section, key).map(|entry| self.row(section, entry, what));
        match row {
            Some(row) => self.draft.gap(path, Some(row), what),
            None => self.draft.gap(path, None, &format!("[{section}] has no {key}: {what}")),
        }
    }

    fn printer(&mut self) -> Result<(), ImportError> {
        let Some(printer) = self.section("printer") else { return Err(ImportError::Unknown) };
        let Some(entry) = self.entry("printer", "kinematics") else {
            let what = "[printer] has no kinematics: expected cartesian, corexy or corexz".to_owned();
            return Err(ImportError::Line(printer.file.clone(), printer.line, what));
        };
        // Kalico's kinds with a limit for each axis.
        let kind = entry.value.strip_prefix("limited_").unwrap_or(&entry.value).to_owned();
        if let Some(section) =
            self.config.sections.iter().find(|section| section.name.split(' ').next() == Some("dual_carriage"))
        {
            let what = format!("[{}]: two carriages: profiles know machines with one only", section.name);
            return Err(ImportError::Machine(section.file.clone(), section.line, what));
        }
        if !["cartesian", "corexy", "corexz"].contains(&kind.as_str()) {
            let kind = shown(&kind);
            let what = format!("kinematics: {kind}: profiles know cartesian, corexy and corexz machines only");
            return Err(ImportError::Machine(entry.file.clone(), entry.line, what));
        }
        self.keep("printer", "kinematics", &["kinematics"], kind, "");
        let feeds = ["max_feed_mm_per_s.x", "max_feed_mm_per_s.y"];
        let feed = self.keep_number("printer", "max_velocity", &feeds, |feed| feed);
        for axis in ["x", "y"] {
            self.keep_number(
                "printer",
                &format!("max_{axis}_velocity"),
                &[&format!("max_feed_mm_per_s.{axis}")],
                |feed| feed,
            );
        }
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
        for axis in ["x", "y"] {
            let path = format!("max_acceleration_mm_per_s2.{axis}");
            self.keep_number("printer", &format!("max_{axis}_accel"), &[&path], |limit| limit);
        }
        let z = self.keep_number("printer", "max_z_accel", &["max_acceleration_mm_per_s2.z"], |limit| limit);
        if let Some(acceleration) = acceleration {
            if z.is_none() {
                self.draft.put("max_acceleration_mm_per_s2.z", acceleration);
            }
            let deviation = |speed: f64| speed * speed * CORNER_SHARE / acceleration;
            let path = ["junction_deviation_mm"];
            let said = self.keep_number("printer", "square_corner_velocity", &path, deviation);
            let speed = said.unwrap_or(SQUARE_CORNER_VELOCITY);
            self.draft.put(path[0], deviation(speed));
            // Klipper computes the deviation again for each acceleration.
            const SPEED: &str = "square_corner_velocity_mm_per_s";
            self.draft.put(SPEED, speed);
            self.keep_number("printer", "square_corner_velocity", &[SPEED], |speed| speed);
        }
        self.rules(acceleration);
        Ok(())
    }

    /// Klipper plans in its own way, with limits that only it has.
    fn rules(&mut self, max_accel: Option<f64>) {
        const RATIO: &str = "rules.minimum_cruise_ratio";
        self.draft.put("rules.planned_by", "klipper");
        self.draft.put(RATIO, MINIMUM_CRUISE_RATIO);
        if let Some(max_accel) = max_accel.filter(|accel| *accel > 0.0) {
            let ratio = |until: f64| 1.0 - until.min(max_accel) / max_accel;
            self.keep_number("printer", "max_accel_to_decel", &[RATIO], ratio);
        }
        self.keep_number("printer", "minimum_cruise_ratio", &[RATIO], |ratio| ratio);
        self.keep_number("gcode_arcs", "resolution", &["rules.arc_chord_mm"], |chord| chord);
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

    /// A switch that reports whether there is filament; Klipper's is triggered while there is. Or a
    /// sensor that sees filament move, with or without a switch beside it.
    fn filament_sensor(&mut self) {
        let [motion, switch] =
            ["filament_motion_sensor", "filament_switch_sensor"].map(|kind| self.pausing_sensor(kind));
        let why = "its pin is the board's";
        if let Some(name) = motion {
            self.keep(name, "switch_pin", &["filament_sensor.kind"], "motion", why);
            self.keep_number(name, "detection_length", &["filament_sensor.detection_mm"], |length| length);
        }
        let table = if motion.is_some() { "filament_switch" } else { "filament_sensor" };
        if let Some(name) = switch
            && let Some(pin) = self.entry(name, "switch_pin")
        {
            let missing_is_low = !pin.value.contains('!');
            self.keep(name, "switch_pin", &[&format!("{table}.missing_is_low")], missing_is_low, why);
            self.keep_number(name, "debounce_delay", &[&format!("{table}.debounce_s")], |seconds| seconds);
        }
    }

    /// The first filament sensor of a kind that has a pin and pauses a print.
    fn pausing_sensor(&self, kind: &str) -> Option<&'a str> {
        let pauses = |name: &str| {
            let pause = self.entry(name, "pause_on_runout");
            pause.is_none_or(|entry| !entry.value.eq_ignore_ascii_case("false"))
                && self.entry(name, "switch_pin").is_some()
        };
        let mut names = self.config.sections.iter().map(|section| section.name.as_str());
        names.find(|name| name.split(' ').next() == Some(kind) && pauses(name))
    }

    /// The pin that switches the power supply, which Klipper knows as any other: by the names that
    /// its own samples give it.
    fn power_supply(&mut self) {
        let is_supply = |section: &&Section| {
            let name = section.name.to_ascii_lowercase();
            let names = ["ps_on", "psu", "power_supply", "powersupply"];
            name.strip_prefix("output_pin ").is_some_and(|name| names.iter().any(|supply| name.contains(supply)))
        };
        let Some(section) = self.config.sections.iter().find(is_supply) else { return };
        let name = section.name.as_str();
        let Some(pin) = self.entry(name, "pin") else { return };
        let on_is_low = pin.value.contains('!');
        self.keep(name, "pin", &["power_supply.on_is_low"], on_is_low, "its pin is the board's");
        // Klipper's pins are off at the start unless the file says otherwise.
        let on_at_start = self.number(name, "value").is_some_and(|value| value > 0.0);
        self.draft.put("power_supply.on_at_start", on_at_start);
        self.keep(name, "value", &["power_supply.on_at_start"], on_at_start, "");
        self.lose(name, "shutdown_value", "a halt switches the supply off");
    }

    /// Rows for all settings that have none yet.
    fn rest(&mut self) {
        for (file, line, name, why) in &self.config.missing {
            let why = format!("not read: {why}");
            let (file, value) = (file.clone(), shown(name));
            let refused = false;
            self.draft.add(Row { file, line: *line, key: "include".to_owned(), value, kept: None, why, refused });
        }
        for section in &self.config.sections {
            for entry in &section.entries {
                if !self.seen.contains(&(entry.file.clone(), entry.line)) {
                    let holds = self.entry(&section.name, &entry.key).is_some_and(|last| std::ptr::eq(last, entry));
                    let why = match (holds, entry.is_saved) {
                        (true, _) => reason(&section.name, &entry.key),
                        (false, false) => "a later line sets it",
                        (false, true) => "the file itself says it, and that holds over what SAVE_CONFIG has written",
                    };
                    let row = self.row(&section.name, entry, why);
                    self.draft.add(row);
                }
            }
            if section.entries.is_empty() {
                let (file, key) = (section.file.clone(), format!("[{}]", section.name));
                let why = nothing_in_it(&section.name).to_owned();
                let (line, value, refused) = (section.line, String::new(), false);
                self.draft.add(Row { file, line, key, value, kept: None, why, refused });
            }
        }
    }
}

/// A number as Python reads it.
fn plain_number(text: &str) -> Option<f64> {
    let text = text.trim();
    let digits = text.trim_start_matches(['+', '-']);
    if digits.starts_with('_') || digits.ends_with('_') || digits.contains("__") {
        return None;
    }
    text.replace('_', "").parse().ok().filter(|number: &f64| number.is_finite())
}

/// A name that a profile may have: letters, digits and _.
fn profile_name(name: &str) -> String {
    name.chars().map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '_' }).take(24).collect()
}
