//! Reads a profile and checks it against what machines have.

use std::path::Path;

use super::printer::{DriverSignals, HeaterSettings, Homing, Printer, ThermistorKind};
use super::printer_file::{RawPrinter, Xyz};
use super::refusal::Refusal;

impl Printer {
    /// Reads a profile.
    ///
    /// # Errors
    /// The file cannot be read, or [`Printer::parse`] refuses it.
    pub fn read(path: &Path) -> Result<Self, Refusal> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| Refusal::unreadable(&file, &error))?;
        Self::parse(&file, &text)
    }

    /// Reads a profile from its text; `file` is its name in errors.
    ///
    /// # Errors
    /// A key of the printer is missing or malformed, or has a value that no machine has.
    pub fn parse(file: &str, text: &str) -> Result<Self, Refusal> {
        let raw: RawPrinter = toml::from_str(text).map_err(|error| Refusal::toml(file, &error))?;
        let lower_end_mm = raw.lower_end_mm.unwrap_or(Xyz { x: 0.0, y: 0.0, z: 0.0 }).array();
        let size_mm = raw.size_mm.array();
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            let (lower, upper) = (lower_end_mm[axis], size_mm[axis]);
            if !(lower.is_finite() && upper.is_finite() && lower <= 0.0 && upper > 0.0) {
                let problem = format!("a travel from {lower} to {upper} mm is impossible");
                return Err(Refusal::new(
                    file,
                    format!("size_mm.{name}"),
                    problem,
                    "write size_mm above 0 and lower_end_mm at most 0",
                ));
            }
        }
        let steps = raw.steps_per_mm;
        let steps_per_mm = [steps.x, steps.y, steps.z, steps.e];
        if !steps_per_mm.iter().all(|steps| steps.is_finite() && *steps > 0.0) {
            return Err(Refusal::new(
                file,
                "steps_per_mm",
                "every motor needs a number above 0",
                "write the steps per mm of x, y, z and e",
            ));
        }
        let driver = raw.driver;
        for (key, us) in [("pulse_width_us", driver.pulse_width_us), ("direction_setup_us", driver.direction_setup_us)]
        {
            if !(us.is_finite() && us >= 0.0) {
                return Err(Refusal::new(
                    file,
                    format!("driver.{key}"),
                    format!("{us} us is not a duration"),
                    "write 0 or more microseconds",
                ));
            }
        }
        let nozzle = heater(file, "nozzle", raw.nozzle)?;
        let bed = raw.bed.map(|bed| heater(file, "bed", bed)).transpose()?;
        if let Some(chamber) = &raw.chamber {
            heater(file, "chamber", chamber.settings)?;
        }
        let homing = raw.homing;
        let travel = [[lower_end_mm[0], size_mm[0]], [lower_end_mm[1], size_mm[1]]];
        let drivers = [raw.drivers.x, raw.drivers.y, raw.drivers.z, raw.drivers.e];
        for (settings, name) in drivers.iter().zip(["x", "y", "z", "e"]) {
            if let Some(settings) = settings.filter(|it| !it.microsteps.is_power_of_two() || it.microsteps > 256) {
                let problem = format!("no driver makes {} microsteps", settings.microsteps);
                let mend = "write 1, 2, 4, 8, 16, 32, 64, 128 or 256";
                return Err(Refusal::new(file, format!("drivers.{name}.microsteps"), problem, mend));
            }
        }
        let frame = [raw.frame.x, raw.frame.y];
        for (mode, axis) in frame.iter().zip(["x", "y"]) {
            if let Some(mode) = mode
                .filter(|mode| !((1.0..=1000.0).contains(&mode.frequency_hz) && (0.0..=0.95).contains(&mode.damping)))
            {
                let problem = format!("no frame rings at {} Hz with a damping of {}", mode.frequency_hz, mode.damping);
                let mend = "write 1 to 1000 Hz, and a damping of 0 to 0.95";
                return Err(Refusal::new(file, format!("frame.{axis}"), problem, mend));
            }
        }
        Ok(Self {
            name: raw.name,
            kinematics: raw.kinematics,
            size_mm,
            lower_end_mm,
            steps_per_mm,
            homing: Homing {
                home_at_mm: homing.home_at_mm.map(|place| [place.x, place.y]),
                probe_offset_mm: homing.probe_offset_mm.map(Xyz::array),
                bed_mm: homing.bed_mm.map_or(travel, |bed| [bed.x, bed.y]),
                axes: [homing.x, homing.y, homing.z],
            },
            nozzle,
            bed,
            chamber: raw.chamber,
            tool_thermistor: raw.tools.and_then(|tools| tools.t1.thermistor(nozzle.sensor)),
            signals: DriverSignals {
                pulse_width_us: driver.pulse_width_us,
                direction_setup_us: driver.direction_setup_us,
                both_edges: driver.both_edges,
                inverted: inverted(file, &driver.inverted)?,
            },
            drivers,
            z_motors: raw.z_motors.all(),
            frame,
            power_supply: raw.power_supply,
            has_bltouch: raw.bltouch.is_some(),
            sees_filament_move: raw.filament_sensor.is_some_and(|sensor| sensor.kind.as_deref() == Some("motion")),
        })
    }
}

fn inverted(file: &str, names: &[String]) -> Result<[bool; 4], Refusal> {
    let mut inverted = [false; 4];
    for name in names {
        match ["x", "y", "z", "e"].iter().position(|axis| axis == name) {
            Some(motor) => inverted[motor] = true,
            None => {
                let problem = format!("unknown motor \"{name}\"");
                return Err(Refusal::new(file, "driver.inverted", problem, "write \"x\", \"y\", \"z\" or \"e\""));
            }
        }
    }
    Ok(inverted)
}

fn heater(file: &str, key: &str, heater: HeaterSettings) -> Result<HeaterSettings, Refusal> {
    if let Some(problem) = thermistor_fault(heater.sensor) {
        return Err(Refusal::new(file, format!("{key}.sensor"), problem, THERMISTOR_CURE));
    }
    if !(heater.pull_up_ohm.is_finite() && heater.pull_up_ohm > 0.0) {
        return Err(Refusal::new(
            file,
            format!("{key}.pull_up_ohm"),
            format!("{} ohm is not a pull-up resistor", heater.pull_up_ohm),
            "write the resistor in ohm, such as 4700",
        ));
    }
    let fault = heater.model.is_some_and(|model| {
        let not_above_zero = [model.power_w, model.capacity_j_per_k].iter().any(|it| !(it.is_finite() && *it > 0.0));
        let below_zero = [model.loss_w_per_k, model.fan_loss_w_per_k, model.dead_time_s];
        not_above_zero || below_zero.iter().any(|it| !(it.is_finite() && *it >= 0.0))
    });
    if fault {
        let problem = "power and capacity must be above 0, losses and dead time at least 0";
        let mend = "copy the values of a similar printer from config/profiles/";
        return Err(Refusal::new(file, format!("{key}.model"), problem, mend));
    }
    Ok(heater)
}

/// Cure for a thermistor that [`thermistor_fault`] rejects.
pub(super) const THERMISTOR_CURE: &str = "copy R25 and B, or three points, from its data sheet";

/// The problem of a thermistor with impossible values, if any.
pub(super) fn thermistor_fault(kind: ThermistorKind) -> Option<&'static str> {
    match kind {
        ThermistorKind::Beta { r25_ohm, beta_k }
            if !(r25_ohm.is_finite() && r25_ohm > 0.0 && beta_k.is_finite() && beta_k > 0.0) =>
        {
            Some("r25_ohm and beta_k must be above 0")
        }
        ThermistorKind::Points { celsius, ohm }
            if !(celsius.is_sorted_by(|low, high| low < high)
                && ohm.is_sorted_by(|high, low| high > low)
                && ohm.iter().all(|ohm| *ohm > 0.0)) =>
        {
            Some("three temperatures must rise and their resistances fall")
        }
        _ => None,
    }
}
