//! Marlin's settings of nozzle, bed and chamber.

use super::sensor::{NO_SENSOR, is_dummy};
use super::{NO_NUMBER, Reading};
use crate::sensor::CONNECTOR_TAKEN;

/// Marlin's defaults for the difference between highest temperature and highest target,
/// degrees Celsius.
const HOTEND_OVERSHOOT: f64 = 15.0;
const BED_OVERSHOOT: f64 = 10.0;

/// Marlin's PID gains are for a power of 255.
const FULL_POWER: f64 = 255.0;

impl Reading<'_> {
    pub(super) fn heaters(&mut self) {
        let heaters = [
            ("nozzle", "TEMP_SENSOR_0", "HEATER_0", ["DEFAULT_KP", "DEFAULT_KI", "DEFAULT_KD"]),
            ("bed", "TEMP_SENSOR_BED", "BED", ["DEFAULT_BED_KP", "DEFAULT_BED_KI", "DEFAULT_BED_KD"]),
        ];
        for (heater, sensor_name, limits, gains) in heaters {
            let path = |key: &str| format!("{heater}.{key}");
            if let Some(number) = self.number(sensor_name) {
                let of_own = if heater == "nozzle" { "HOTEND0" } else { "BED" };
                if number == 0.0 || is_dummy(number) {
                    let why = "a profile has this heater: do not heat it in jobs";
                    self.lose(sensor_name, why);
                    if heater == "nozzle" {
                        let row = self.get(sensor_name).map(|definition| self.row(definition, why));
                        self.draft.gap("nozzle.sensor", row, "expected a sensor: a profile's nozzle has one");
                    }
                } else {
                    match self.sensor_of(number, of_own, heater) {
                        Some(value) => self.keep(sensor_name, &path("sensor"), value, ""),
                        None => {
                            let row = self.get(sensor_name).map(|definition| self.row(definition, NO_SENSOR));
                            self.draft.gap(&path("sensor"), row, NO_SENSOR);
                        }
                    }
                }
            }
            self.keep_number(&format!("{limits}_MINTEMP"), &path("min_celsius"), |limit| limit);
            let max = self.keep_number(&format!("{limits}_MAXTEMP"), &path("max_celsius"), |limit| limit);
            self.highest_target(heater, max);
            for (name, key) in gains.into_iter().zip(["proportional", "integral", "derivative"]) {
                // Older files write Kp where newer ones write KP.
                let older = name.replace("BED_K", "bedK");
                for name in [name.to_owned(), older.clone(), with_small_last(name), with_small_last(&older)] {
                    if self.get(&name).is_some() && !self.seen.contains(&name) {
                        self.keep_number(&name, &path(key), |gain| gain / FULL_POWER);
                    }
                    // One for each nozzle: the first is the profile's.
                    let each = format!("{name}_LIST");
                    if let Some(gain) = self.list(&each).and_then(|list| list.first().copied().flatten()) {
                        self.keep(&each, &path(key), gain / FULL_POWER, "");
                    }
                }
            }
        }
        self.heater_model();
        self.chamber();
        self.tools();
        for (name, path) in [
            ("EXTRUDE_MINTEMP", "min_extrusion_celsius"),
            ("WATCH_TEMP_PERIOD", "nozzle.watch_s"),
            ("WATCH_TEMP_INCREASE", "nozzle.watch_celsius"),
            ("THERMAL_PROTECTION_PERIOD", "nozzle.runaway_s"),
            ("THERMAL_PROTECTION_HYSTERESIS", "nozzle.runaway_celsius"),
            ("WATCH_BED_TEMP_PERIOD", "bed.watch_s"),
            ("WATCH_BED_TEMP_INCREASE", "bed.watch_celsius"),
            ("THERMAL_PROTECTION_BED_PERIOD", "bed.runaway_s"),
            ("THERMAL_PROTECTION_BED_HYSTERESIS", "bed.runaway_celsius"),
            ("TEMP_RESIDENCY_TIME", "nozzle.residency_s"),
            ("TEMP_BED_RESIDENCY_TIME", "bed.residency_s"),
            ("TEMP_WINDOW", "nozzle.residency_window_celsius"),
            ("TEMP_BED_WINDOW", "bed.residency_window_celsius"),
        ] {
            self.keep_number(name, path, |number| number);
        }
    }

    /// The highest target, which Marlin keeps below the temperature at which it halts.
    fn highest_target(&mut self, heater: &str, max: Option<f64>) {
        let (name, usual) =
            if heater == "nozzle" { ("HOTEND_OVERSHOOT", HOTEND_OVERSHOOT) } else { ("BED_OVERSHOOT", BED_OVERSHOOT) };
        let Some(max) = max else { return };
        let path = format!("{heater}.max_target_celsius");
        self.draft.put(&path, max - usual);
        if let Some(overshoot) = self.number(name) {
            self.keep(name, &path, max - overshoot, "the highest temperature less this");
        }
    }

    /// The nozzle's model (MPC), of which there is one for each nozzle: the first is the profile's.
    fn heater_model(&mut self) {
        if self.get("MPCTEMP").is_none() {
            return;
        }
        let mut power_w = None;
        for (name, key) in [
            ("MPC_HEATER_POWER", "power_w"),
            ("MPC_BLOCK_HEAT_CAPACITY", "capacity_j_per_k"),
            ("MPC_SENSOR_RESPONSIVENESS", "sensor_per_s"),
            ("MPC_AMBIENT_XFER_COEFF", "loss_w_per_k"),
            ("MPC_AMBIENT_XFER_COEFF_FAN255", "fanned_loss_w_per_k"),
            ("FILAMENT_HEAT_CAPACITY_PERMM", "filament_j_per_k_mm"),
        ] {
            match self.list(name).and_then(|list| list.first().copied().flatten()) {
                Some(constant) => {
                    power_w = power_w.or(Some(constant));
                    self.keep(name, &format!("nozzle.control_model.{key}"), constant, "");
                }
                None => self.lose(name, NO_NUMBER),
            }
        }
        if let Some(power_w) = power_w {
            self.keep("MPCTEMP", "nozzle.control_model.power_w", power_w, "");
        }
    }

    /// A chamber's thermometer; its heater is in the board's pins, where no settings are read.
    fn chamber(&mut self) {
        let Some(number) = self.number("TEMP_SENSOR_CHAMBER").filter(|number| *number != 0.0) else { return };
        let Some(value) = self.sensor_of(number, "CHAMBER", "chamber") else {
            return self.lose("TEMP_SENSOR_CHAMBER", "no sensor that a profile knows: set it by hand");
        };
        let has_second =
            self.number("EXTRUDERS").is_some_and(|count| count >= 2.0) && self.get("SINGLENOZZLE").is_none();
        if has_second && self.number("TEMP_SENSOR_1").is_some_and(|number| number != 0.0) {
            return self.lose("TEMP_SENSOR_CHAMBER", CONNECTOR_TAKEN);
        }
        self.keep(
            "TEMP_SENSOR_CHAMBER",
            "chamber.sensor",
            value,
            "name the board's connectors: chamber.thermistor, and chamber.heater if it has one",
        );
        self.draft.put("chamber.thermistor", "nozzle1");
        self.draft.put("chamber.min_celsius", 0.0);
        self.draft.put("chamber.max_celsius", 90.0);
        for (name, path) in [
            ("CHAMBER_MINTEMP", "chamber.min_celsius"),
            ("CHAMBER_MAXTEMP", "chamber.max_celsius"),
            ("TEMP_CHAMBER_HYSTERESIS", "chamber.residency_window_celsius"),
            ("WATCH_CHAMBER_TEMP_PERIOD", "chamber.watch_s"),
            ("WATCH_CHAMBER_TEMP_INCREASE", "chamber.watch_celsius"),
            ("THERMAL_PROTECTION_CHAMBER_PERIOD", "chamber.runaway_s"),
            ("THERMAL_PROTECTION_CHAMBER_HYSTERESIS", "chamber.runaway_celsius"),
        ] {
            self.keep_number(name, path, |number| number);
        }
    }
}

/// `DEFAULT_KP` as `DEFAULT_Kp`.
fn with_small_last(name: &str) -> String {
    let mut chars = name.chars();
    let last = chars.next_back().map(|last| last.to_ascii_lowercase());
    chars.chain(last).collect()
}
