//! Klipper's settings of the extruder and of heaters with their sensors.

use toml::{Table, Value};

use super::{FULL_POWER, Reading};

impl Reading<'_> {
    pub(super) fn extruder(&mut self) {
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

    pub(super) fn heater(&mut self, section: &str, heater: &str) {
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
        // As Klipper's temperature_sensors.cfg has them.
        "Honeywell 100K 135-104LAG-J01" => Some(beta_table(100_000.0, 3974.0)),
        "NTC 100K MGB18-104F39050L32" => Some(beta_table(100_000.0, 4100.0)),
        _ => None,
    }
}
