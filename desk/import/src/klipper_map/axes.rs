//! Klipper's settings of motors, of homing and of the probe.

use toml::Value;

use super::Reading;
use crate::klipper::Entry;
use crate::nearest::QUIET_UNTIL;

/// Klipper's own values of keys that a file leaves out (its Configuration reference).
const HOMING_SPEED: f64 = 5.0;
const HOMING_RETRACT_DIST: f64 = 5.0;
const MICROSTEPS: f64 = 16.0;
const FULL_STEPS: f64 = 200.0;
const PIN_MOVE_MS: f64 = 680.0;
/// Klipper's thresholds above any speed mean stealthChop at all speeds; a profile says that with 0.
const ANY_SPEED: f64 = 2000.0;

/// Sections of probes that are switches, and of others.
const SWITCHES: [&str; 3] = ["bltouch", "probe", "smart_effector"];
const OTHER_PROBES: [&str; 12] = [
    "probe_eddy_current",
    "beacon",
    "scanner",
    "cartographer",
    "idm",
    "bdsensor",
    "load_cell_probe",
    "dockable_probe",
    "eddy",
    "btt_eddy",
    "prtouch_v2",
    "z_tilt_probe",
];

impl<'a> Reading<'a> {
    /// Steps per mm of a motor.
    pub(super) fn steps(&mut self, section: &str, axis: &str) {
        self.steps_as(section, &format!("steps_per_mm.{axis}"));
    }

    /// Steps of a motor, as this key.
    pub(super) fn steps_as(&mut self, section: &str, path: &str) {
        if let Some(distance) = self.number(section, "step_distance").filter(|distance| *distance != 0.0) {
            self.keep(section, "step_distance", &[path], 1.0 / distance, "");
            return;
        }
        let Some(distance) = self.number(section, "rotation_distance").filter(|distance| *distance != 0.0) else {
            return;
        };
        let full_steps = self.number(section, "full_steps_per_rotation").unwrap_or(FULL_STEPS);
        let microsteps = self.number(section, "microsteps").or_else(|| self.drivers_microsteps(section));
        let Some(microsteps) = microsteps else { return };
        let gears = match self.entry(section, "gear_ratio") {
            None => 1.0,
            Some(entry) => match gear_ratio(&entry.value) {
                Some(ratio) => ratio,
                None => {
                    let row = self.row(section, entry, "not a ratio such as 50:17");
                    self.draft.add(row);
                    return;
                }
            },
        };
        let steps = full_steps * microsteps * gears / distance;
        for key in ["rotation_distance", "microsteps", "full_steps_per_rotation", "gear_ratio"] {
            self.keep(section, key, &[path], steps, "");
        }
    }

    /// Microsteps that an older file has in the section of the motor's driver.
    fn drivers_microsteps(&mut self, section: &str) -> Option<f64> {
        let is_drivers =
            |name: &&str| name.split_once(' ').is_some_and(|(kind, of)| kind.starts_with("tmc") && of == section);
        let mut names = self.config.sections.iter().map(|section| section.name.as_str());
        let driver = names.find(is_drivers)?;
        self.number(driver, "microsteps")
    }

    pub(super) fn axis(&mut self, axis: &str) {
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
        // The probe's trigger height is its own z_offset.
        let end = self.number(section, "position_endstop").filter(|_| !is_probe);
        self.draft.put(&homing("triggers_low"), false);
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
        let back = self.number(section, "homing_retract_dist");
        // Klipper homes once, at the full speed, without a way back: a stall is then never
        // sensed at half of it.
        let once = is_stall && back == Some(0.0);
        if slow.is_none() {
            self.draft.put(&homing("slow_mm_per_s"), if once { fast } else { fast / 2.0 });
        }
        match back {
            Some(0.0) => {
                let why = "a profile homes twice: the distance is above 0";
                let why = if once { "a profile homes twice, here at one speed: the distance is above 0" } else { why };
                self.lose(section, "homing_retract_dist", why);
            }
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
            if is_probe && axis != "z" {
                self.gap(&homing("sensor"), section, "endstop_pin", "only Z homes by a probe");
            }
            let driver = format!("tmc2209 {section}");
            if is_stall && self.section(&driver).is_none() {
                let what = format!("a profile homes by the stall signal of a TMC2209, and there is no [{driver}]");
                self.gap(&homing("sensor"), section, "endstop_pin", &what);
            }
            if text.contains('!') && !is_stall && !is_probe {
                self.keep(section, "endstop_pin", &[&homing("triggers_low")], true, "its pin is the board's");
            }
        }
    }

    pub(super) fn probe(&mut self) {
        let home = self.entry("safe_z_home", "home_xy_position").and_then(|entry| two_numbers(&entry.value));
        if let Some([x, y]) = home {
            self.keep("safe_z_home", "home_xy_position", &["homing.home_at_mm.x"], x, "");
            self.keep("safe_z_home", "home_xy_position", &["homing.home_at_mm.y"], y, "");
        }
        self.keep_number("safe_z_home", "z_hop", &["homing.raise_mm"], |height| height);
        let is_probe =
            self.entry("stepper_z", "endstop_pin").is_some_and(|pin| pin.value.contains("z_virtual_endstop"));
        let Some(section) = self.probe_section() else {
            if is_probe {
                let what = "Z homes by a probe, and no section describes one ([probe] or [bltouch])";
                self.gap("homing.z.sensor", "stepper_z", "endstop_pin", what);
            }
            return;
        };
        if !is_probe {
            for axis in ["x", "y", "z"] {
                let why = "Z homes by a switch: a profile's probe is what Z homes by";
                self.lose(section, &format!("{axis}_offset"), why);
            }
            return;
        }
        if section == "bltouch" {
            let is_low = self.entry(section, "sensor_pin").is_some_and(|pin| pin.value.contains('!'));
            self.keep(section, "sensor_pin", &["homing.z.triggers_low"], is_low, "its pin is the board's");
        } else if SWITCHES.contains(&section) {
            let is_low = self.entry(section, "pin").is_some_and(|pin| pin.value.contains('!'));
            self.keep(section, "pin", &["homing.z.triggers_low"], is_low, "its pin is the board's");
            for key in ["activate_gcode", "deactivate_gcode"] {
                if self.entry(section, key).is_some_and(|entry| !entry.value.trim().is_empty()) {
                    self.lose(
                        section,
                        key,
                        "a profile's probe is there all the time, or goes out by itself: it runs no lines",
                    );
                }
            }
        } else {
            let what = format!(
                "[{section}] is a probe of another kind: a profile's is a switch ([probe]) or a BLTouch ([bltouch])"
            );
            self.gap("homing.z.sensor", "stepper_z", "endstop_pin", &what);
        }
        for (axis, sign) in [("x", 1.0), ("y", 1.0), ("z", -1.0)] {
            let path = format!("homing.probe_offset_mm.{axis}");
            let key = format!("{axis}_offset");
            if self.keep_number(section, &key, &[&path], |offset| sign * offset).is_none() {
                self.draft.put(&path, 0.0);
                if axis == "z" || self.entry(section, &key).is_some() {
                    self.gap(&path, section, &key, "expected where the probe triggers, beside the nozzle's tip, mm");
                }
            }
        }
        if section == "bltouch" {
            self.bltouch();
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

    /// The section of the probe that Z may home by.
    fn probe_section(&self) -> Option<&'a str> {
        let names = || self.config.sections.iter().map(|section| section.name.as_str());
        let kind = |name: &str| name.split(' ').next().unwrap_or_default().to_ascii_lowercase();
        let known = SWITCHES.into_iter().find(|name| self.section(name).is_some());
        known.or_else(|| names().find(|name| OTHER_PROBES.contains(&kind(name).as_str())))
    }

    /// A probe with a pin: the profile gets its table even if Klipper's section has only pins.
    fn bltouch(&mut self) {
        const SECTION: &str = "bltouch";
        self.draft.put("bltouch.move_ms", PIN_MOVE_MS);
        self.keep_number(SECTION, "pin_move_time", &["bltouch.move_ms"], |seconds| seconds * 1000.0);
        for (key, path) in [
            ("stow_on_each_sample", "bltouch.stow_each_touch"),
            ("pin_up_touch_mode_reports_triggered", "bltouch.test_signal"),
        ] {
            if let Some(entry) = self.entry(SECTION, key) {
                let is_on = !["false", "no", "off", "0"].contains(&entry.value.to_ascii_lowercase().as_str());
                self.keep(SECTION, key, &[path], is_on, "");
            }
        }
    }

    pub(super) fn driver(&mut self, section: &str, axis: &str) {
        self.driver_of(section, axis, &format!("drivers.{axis}"), &format!("steps_per_mm.{axis}"));
    }

    /// A driver as the table of this name; its motor has the steps of another key.
    pub(super) fn driver_as(&mut self, section: &str, table: &str, steps: &str) {
        self.driver_of(section, "e", table, steps);
    }

    fn driver_of(&mut self, section: &str, axis: &str, table: &str, steps: &str) {
        let name = format!("tmc2209 {section}");
        let Some(milliamperes) = self.number(&name, "run_current").map(|amperes| (amperes * 1000.0).round()) else {
            return;
        };
        let path = |key: &str| format!("{table}.{key}");
        self.keep(&name, "run_current", &[&path("current_ma")], milliamperes as i64, "");
        let hold = self.number(&name, "hold_current").filter(|_| milliamperes > 0.0);
        let percent = hold.map_or(100.0, |amperes| (amperes * 100_000.0 / milliamperes).round());
        self.draft.put(&path("hold_current_percent"), percent as i64);
        self.keep(&name, "hold_current", &[&path("hold_current_percent")], percent as i64, "");
        let microsteps =
            self.number(section, "microsteps").or_else(|| self.number(&name, "microsteps")).unwrap_or(MICROSTEPS);
        self.draft.put(&path("microsteps"), microsteps as i64);
        for said in [section, &name] {
            self.keep(said, "microsteps", &[&path("microsteps")], microsteps as i64, "");
        }
        let full_steps = self.number(section, "full_steps_per_rotation").unwrap_or(FULL_STEPS);
        if let Some(steps_per_mm) = self.draft.number(steps).filter(|steps| *steps > 0.0) {
            let mm_per_turn = full_steps * microsteps / steps_per_mm;
            self.draft.put(&path("full_steps_per_turn"), full_steps);
            self.draft.put(&path("mm_per_turn"), mm_per_turn);
            self.keep(section, "full_steps_per_rotation", &[&path("full_steps_per_turn")], full_steps, "");
            self.keep(section, "rotation_distance", &[&path("mm_per_turn")], mm_per_turn, "");
        }
        let interpolates =
            self.entry(&name, "interpolate").is_none_or(|entry| !entry.value.eq_ignore_ascii_case("false"));
        self.draft.put(&path("interpolate"), interpolates);
        self.keep(&name, "interpolate", &[&path("interpolate")], interpolates, "");
        // Below the threshold's speed the driver is quiet; 0 means never, 999999 always.
        let threshold = self.number(&name, "stealthchop_threshold").unwrap_or(0.0);
        let by_stall = self.draft.word(&format!("homing.{axis}.sensor")) == Some("stall");
        let fast = self.draft.number(&format!("homing.{axis}.fast_mm_per_s")).unwrap_or(0.0);
        let (quiet, above, why) = if threshold > ANY_SPEED {
            (true, 0, "")
        } else if by_stall && threshold <= fast {
            let why = "Klipper homes in stealthChop, whatever it prints in; a profile changes over by the speed";
            (true, (fast * QUIET_UNTIL).ceil() as i64, why)
        } else {
            // Between 0 and 1 mm/s, 0 would mean the opposite.
            (threshold > 0.0, threshold.ceil() as i64, "")
        };
        self.draft.put(&path("stealth_chop"), quiet);
        self.draft.put(&path("spread_cycle_above_mm_per_s"), above);
        self.keep(&name, "stealthchop_threshold", &[&path("stealth_chop")], quiet, why);
        self.keep(&name, "stealthchop_threshold", &[&path("spread_cycle_above_mm_per_s")], above, why);
        let stall = self.number(&name, "driver_sgthrs").unwrap_or(0.0) as i64;
        self.draft.put(&path("stall_threshold"), stall);
        self.keep(&name, "driver_sgthrs", &[&path("stall_threshold")], stall, "");
    }

    /// Motors whose direction pin has a `!`.
    pub(super) fn inverted(&mut self) {
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
}

/// The product of ratios such as `50:17, 3:1`.
fn gear_ratio(text: &str) -> Option<f64> {
    text.split(',').try_fold(1.0, |product, pair| {
        let (driven, driving) = pair.split_once(':')?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| *number > 0.0 && number.is_finite());
        Some(product * number(driven)? / number(driving)?)
    })
}

/// Numbers of X and Y, with a comma between.
pub(super) fn two_numbers(text: &str) -> Option<[f64; 2]> {
    let (x, y) = text.split_once(',')?;
    Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
}
