//! Klipper's settings of the extruder, and of heaters with their sensors.

use toml::Value;

use super::{Entry, FULL_POWER, Reading};
use crate::sensor::{CONNECTOR_TAKEN, beta_table, points};

/// Kelvins at 0 degrees Celsius.
const KELVIN: f64 = 273.15;

/// Connector of a chamber's thermistor and heater, until a person names the board's connectors.
const CHAMBER_CONNECTOR: &str = "nozzle1";
const CHECK_CONNECTOR: &str = "name the board's connector that it hangs at";
/// Limit of a chamber's thermometer without one.
const CHAMBER_MAX_CELSIUS: f64 = 90.0;

impl Reading<'_> {
    pub(super) fn extruder(&mut self) {
        let same = |number: f64| number;
        self.keep_number("extruder", "nozzle_diameter", &["nozzle_diameter_mm"], same);
        self.keep_number("extruder", "filament_diameter", &["extrusion.filament_diameter_mm"], same);
        if self.draft.says("extrusion.filament_diameter_mm") {
            self.draft.put("extrusion.mode", "gcode");
        }
        self.keep_number("extruder", "min_extrude_temp", &["min_extrusion_celsius"], same);
        let limits = ["acceleration_mm_per_s2.retract", "max_acceleration_mm_per_s2.e"];
        self.own_limits(limits);
        self.keep_number("extruder", "max_extrude_only_velocity", &["max_feed_mm_per_s.e"], same);
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

    /// The limits that Klipper gives an extruder by itself: those of the head, as filament that a
    /// line of the nozzle's width would take.
    fn own_limits(&mut self, accelerations: [&str; 2]) {
        self.draft.put("instantaneous_corner_velocity_mm_per_s.e", 1.0);
        let (nozzle, filament) =
            (self.number("extruder", "nozzle_diameter"), self.number("extruder", "filament_diameter"));
        let (Some(nozzle), Some(filament)) = (nozzle, filament.filter(|width| *width > 0.0)) else { return };
        let cross_section = std::f64::consts::PI * filament * filament / 4.0;
        let share = 4.0 * nozzle * nozzle / cross_section;
        if let Some(velocity) = self.number("printer", "max_velocity") {
            self.draft.put("max_feed_mm_per_s.e", velocity * share);
        }
        if let Some(acceleration) = self.number("printer", "max_accel") {
            for path in accelerations {
                self.draft.put(path, acceleration * share);
            }
        }
    }

    pub(super) fn heater(&mut self, section: &str, heater: &str) {
        let path = |key: &str| format!("{heater}.{key}");
        let same = |number: f64| number;
        if let Some(entry) = self.entry(section, "sensor_type") {
            match self.own_sensor(&entry.value, &path("sensor")).or_else(|| sensor(&entry.value)) {
                Some(value) => self.keep(section, "sensor_type", &[&path("sensor")], value, ""),
                None if heater == "nozzle" || heater == "bed" || heater.starts_with("tools") => {
                    let what = "no sensor that a profile knows: profiles have thermistors by three points or by beta, and PT1000s";
                    self.gap(&path("sensor"), section, "sensor_type", what);
                }
                None => self.lose(section, "sensor_type", "no sensor that a profile knows"),
            }
        }
        self.keep_number(section, "pullup_resistor", &[&path("pull_up_ohm")], same);
        if self.number(section, "max_power").is_some_and(|power| power < 1.0) {
            let why = "profiles drive a heater at full power: the gains are for this part of it, so a heater that must not have all of its \
                       power needs another supply or fuse, and new gains (M303)";
            self.lose(section, "max_power", why);
        } else {
            self.lose(section, "max_power", "full power, as in a profile");
        }
        self.keep_number(section, "min_temp", &[&path("min_celsius")], same);
        self.keep_number(section, "max_temp", &[&path("max_celsius")], same);
        for (key, name) in [("pid_kp", "proportional"), ("pid_ki", "integral"), ("pid_kd", "derivative")] {
            self.keep_number(section, key, &[&path(name)], |gain| gain / FULL_POWER);
        }
        if self.entry(section, "control").is_some_and(|entry| entry.value == "mpc") {
            self.heater_model(section, heater);
        } else if let Some(entry) = self.entry(section, "control") {
            let why = if entry.value == "pid" {
                "the gains say so"
            } else {
                "profiles know PID and models: set the gains by hand"
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

    /// Kalico's model (`control: mpc`), which its calibration has found.
    fn heater_model(&mut self, section: &str, heater: &str) {
        let path = |key: &str| format!("{heater}.control_model.{key}");
        let same = |number: f64| number;
        if self.entry(section, "block_heat_capacity").is_none() {
            let why = "not calibrated there: write a control_model by hand, and M306 T finds its constants";
            self.lose(section, "heater_power", why);
            return self.lose(section, "control", why);
        }
        let power_w = self.keep_number(section, "heater_power", &[&path("power_w")], same);
        if let Some(power_w) = power_w {
            self.keep(section, "control", &[&path("power_w")], power_w, "");
        }
        for (key, name) in [
            ("block_heat_capacity", "capacity_j_per_k"),
            ("sensor_responsiveness", "sensor_per_s"),
            ("ambient_transfer", "loss_w_per_k"),
        ] {
            self.keep_number(section, key, &[&path(name)], same);
        }
        // The bed has no fan and no filament.
        if heater != "nozzle" {
            return;
        }
        if let Some(entry) = self.entry(section, "fan_ambient_transfer") {
            match entry.value.rsplit(',').next().and_then(|last| last.trim().parse::<f64>().ok()) {
                Some(fanned) => {
                    let why = "the last: at full power; between it and none the loss is taken to be straight";
                    self.keep(section, "fan_ambient_transfer", &[&path("fanned_loss_w_per_k")], fanned, why);
                }
                None => self.lose(section, "fan_ambient_transfer", "not a number"),
            }
        }
        let [density, capacity] = ["filament_density", "filament_heat_capacity"].map(|key| self.number(section, key));
        let diameter_mm = self.number(section, "filament_diameter").unwrap_or(1.75);
        // g/cm^3 times J/(g K) times mm^2, in J/(K mm); Kalico counts none without both.
        let area_mm2 = std::f64::consts::PI / 4.0 * diameter_mm * diameter_mm;
        let per_mm = density.unwrap_or_default() * capacity.unwrap_or_default() * area_mm2 * 1e-3;
        self.draft.put(&path("filament_j_per_k_mm"), (per_mm * 1e7).round() / 1e7);
        for key in ["filament_density", "filament_heat_capacity"] {
            self.keep(section, key, &[&path("filament_j_per_k_mm")], (per_mm * 1e7).round() / 1e7, "");
        }
    }

    /// A chamber that is heated, or whose temperature alone is known. Klipper calls neither a
    /// chamber; people do.
    pub(super) fn chamber(&mut self) {
        let is_chamber = |name: &str| name.to_ascii_lowercase().contains("chamber");
        let find = |kind: &str| {
            let mut names = self.config.sections.iter().map(|section| section.name.as_str());
            names.find(|section| section.split_once(' ').is_some_and(|(of, name)| of == kind && is_chamber(name)))
        };
        let Some(section) = find("heater_generic").or_else(|| find("temperature_sensor")) else { return };
        let known = |entry: &Entry| {
            self.config.section(&format!("thermistor {}", entry.value)).is_some() || sensor(&entry.value).is_some()
        };
        if !self.entry(section, "sensor_type").is_some_and(known) {
            return;
        }
        if self.entry("extruder1", "heater_pin").is_some() {
            for key in ["sensor_type", "sensor_pin", "heater_pin"] {
                self.lose(section, key, CONNECTOR_TAKEN);
            }
            return;
        }
        // Klipper's thermometers need no limits.
        self.draft.put("chamber.min_celsius", 0.0);
        self.draft.put("chamber.max_celsius", CHAMBER_MAX_CELSIUS);
        self.draft.put("chamber.thermistor", CHAMBER_CONNECTOR);
        self.heater(section, "chamber");
        self.keep(section, "sensor_pin", &["chamber.thermistor"], CHAMBER_CONNECTOR, CHECK_CONNECTOR);
        self.keep(section, "heater_pin", &["chamber.heater"], CHAMBER_CONNECTOR, CHECK_CONNECTOR);
    }

    /// The sensor of a section `[thermistor NAME]`: three points, or one and a beta.
    fn own_sensor(&mut self, name: &str, path: &str) -> Option<Value> {
        let section = &*format!("thermistor {name}");
        let [t1, t2, t3] = ["temperature1", "temperature2", "temperature3"].map(|key| self.number(section, key));
        let [r1, r2, r3] = ["resistance1", "resistance2", "resistance3"].map(|key| self.number(section, key));
        let (keys, value): (&[&str], _) = match (t2, r2, t3, r3, self.number(section, "beta")) {
            (Some(t2), Some(r2), Some(t3), Some(r3), None) => {
                let keys =
                    &["temperature1", "resistance1", "temperature2", "resistance2", "temperature3", "resistance3"];
                (keys, three_points([(t1?, r1?), (t2, r2), (t3, r3)]))
            }
            (.., Some(beta)) => {
                // The profile's is at 25 degrees.
                let r25 = r1? * (beta * (1.0 / (25.0 + KELVIN) - 1.0 / (t1? + KELVIN))).exp();
                (&["temperature1", "resistance1", "beta"], beta_table((r25 * 1e3).round() / 1e3, beta))
            }
            _ => return None,
        };
        for key in keys {
            self.keep(section, key, &[path], value.clone(), "");
        }
        Some(value)
    }
}

/// A thermistor by three points. Where no curve of Steinhart and Hart's with a third power goes
/// through them, Klipper takes beta through the first and the third.
fn three_points(three: [(f64, f64); 3]) -> Value {
    let [first, second, third] = three.map(|(celsius, ohm)| (1.0 / (celsius + KELVIN), ohm.ln()));
    let slope = |other: (f64, f64)| (first.0 - other.0) / (first.1 - other.1);
    let cube = |log: f64| log * log * log;
    let bend = |other: (f64, f64)| (cube(first.1) - cube(other.1)) / (first.1 - other.1);
    let of_cube = (slope(second) - slope(third)) / (bend(second) - bend(third));
    if of_cube > 0.0 || !of_cube.is_finite() {
        return points(three);
    }
    let beta = 1.0 / slope(third);
    let r25 = (first.1 + beta * (1.0 / (25.0 + KELVIN) - first.0)).exp();
    beta_table((r25 * 1e3).round() / 1e3, (beta * 10.0).round() / 10.0)
}

/// A sensor by Klipper's name.
fn sensor(name: &str) -> Option<Value> {
    match name {
        "EPCOS 100K B57560G104F" => Some("epcos-100k".into()),
        "ATC Semitec 104GT-2" => Some("semitec-104gt-2".into()),
        "PT1000" => Some("pt1000".into()),
        // Points of Klipper's temperature_sensors.cfg, from makers' tables.
        "ATC Semitec 104NT-4-R025H42G" => Some(points([(25.0, 100_000.0), (160.0, 1074.0), (300.0, 82.78)])),
        "Generic 3950" => Some(points([(25.0, 100_000.0), (150.0, 1770.0), (250.0, 230.0)])),
        "SliceEngineering 450" => Some(points([(25.0, 500_000.0), (200.0, 3734.0), (400.0, 240.0)])),
        "TDK NTCG104LH104JT1" => Some(points([(25.0, 100_000.0), (50.0, 31_230.0), (125.0, 2066.0)])),
        "NTC 100K beta 3950" => Some(beta_table(100_000.0, 3950.0)),
        "Honeywell 100K 135-104LAG-J01" => Some(beta_table(100_000.0, 3974.0)),
        "NTC 100K MGB18-104F39050L32" => Some(beta_table(100_000.0, 4100.0)),
        _ => None,
    }
}
