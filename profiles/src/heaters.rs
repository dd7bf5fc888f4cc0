//! Range, control and checks of the heaters, and what they heat on the virtual board.

use ferrostep_checked_toml::{Checker, Range, range};
use ferrostep_hal_shim::thermistor::{Thermistor, ThermistorType};
use ferrostep_hal_shim::virtual_board::HeatedMass;
use ferrostep_printer::{HeaterSettings, HeaterWatch};

use crate::ProfileError;
use crate::file::{HeaterTable, ModelTable, Number, ThermistorName, ThermistorValue};

const HEATER_MIN: Range = range(-50.0, 50.0, "degrees Celsius");
const NOZZLE_MAX: Range = range(60.0, 500.0, "degrees Celsius");
const BED_MAX: Range = range(60.0, 200.0, "degrees Celsius");
const PROPORTIONAL: Range = range(0.000_1, 10.0, "per degree");
const INTEGRAL: Range = range(0.0, 10.0, "per degree and second");
const DERIVATIVE: Range = range(0.0, 100.0, "seconds per degree");
const RESIDENCY_WINDOW: Range = range(0.1, 20.0, "degrees");
const RESIDENCY: Range = range(0.0, 600.0, "s");
const R25: Range = range(1_000.0, 1_000_000.0, "ohms");
const BETA: Range = range(2_000.0, 6_000.0, "K");
const PULL_UP: Range = range(100.0, 100_000.0, "ohms");
// No time so long, no rise so small that a failed heater goes unnoticed until something melts; none so short or so
// large that a sound heater trips. A weak bed gains a degree a minute, and melts nothing in five.
const WATCH: Range = range(5.0, 120.0, "s");
const BED_WATCH: Range = range(5.0, 300.0, "s");
const WATCH_RISE: Range = range(1.0, 20.0, "degrees");
const RUNAWAY: Range = range(5.0, 120.0, "s");
const RUNAWAY_HYSTERESIS: Range = range(1.0, 20.0, "degrees");
const BED_RUNAWAY_HYSTERESIS: Range = range(1.0, 30.0, "degrees");
const POWER: Range = range(1.0, 3_000.0, "W");
const CAPACITY: Range = range(1.0, 20_000.0, "J/K");
const LOSS: Range = range(0.001, 100.0, "W/K");
const FAN_LOSS: Range = range(0.0, 100.0, "W/K");
const DEAD_TIME: Range = range(0.0, 30.0, "s");

/// Nozzle and bed.
pub fn heaters(
    nozzle: &HeaterTable,
    bed: &HeaterTable,
    check: &Checker<'_>,
) -> Result<[HeaterSettings; 2], ProfileError> {
    Ok([
        heater("nozzle", nozzle, NOZZLE_MAX, (HeaterWatch::NOZZLE, HeatedMass::NOZZLE), check)?,
        heater("bed", bed, BED_MAX, (HeaterWatch::BED, HeatedMass::BED), check)?,
    ])
}

/// Range and control of one heater.
fn heater(
    name: &str,
    table: &HeaterTable,
    max_celsius: Range,
    (default_watch, default_mass): (HeaterWatch, HeatedMass),
    check: &Checker<'_>,
) -> Result<HeaterSettings, ProfileError> {
    let number = |key: &str, value: &Number, range| check.number(&format!("{name}.{key}"), value, range);
    let thermistor = thermistor(name, table, check)?;
    let readable = |key: &str, value: &Number, range| {
        let celsius = number(key, value, range)? as f32;
        if thermistor.can_tell(celsius) {
            return Ok(celsius);
        }
        let [lowest, highest] = readable_celsius(&thermistor);
        let expected = format!(
            "{lowest} to {highest} degrees Celsius, what {name}.sensor can read with pull_up_ohm = {}",
            thermistor.pull_up_ohm
        );
        Err(check.refuse(&format!("{name}.{key}"), value, expected))
    };
    let min_celsius = readable("min_celsius", &table.min_celsius, HEATER_MIN)?;
    let max_celsius = readable("max_celsius", &table.max_celsius, max_celsius)?;
    let max_target_celsius = match &table.max_target_celsius {
        Some(value) => {
            let key = format!("{name}.max_target_celsius");
            let highest = range(HEATER_MIN.high, f64::from(max_celsius), "degrees Celsius, at most max_celsius");
            check.number(&key, value, highest)? as f32
        }
        None => max_celsius,
    };
    let watch = watch(name, table, default_watch, check)?;
    let window_value = &table.residency_window_celsius;
    let residency_window_celsius = number("residency_window_celsius", window_value, RESIDENCY_WINDOW)? as f32;
    if residency_window_celsius > watch.runaway_celsius {
        // What M109 takes for reached would be a runaway.
        let expected = format!("at most {name}.runaway_celsius = {}", watch.runaway_celsius);
        return Err(check.refuse(&format!("{name}.residency_window_celsius"), window_value, expected));
    }
    Ok(HeaterSettings {
        thermistor,
        min_celsius,
        max_celsius,
        max_target_celsius,
        watch,
        proportional: number("proportional", &table.proportional, PROPORTIONAL)? as f32,
        integral: number("integral", &table.integral, INTEGRAL)? as f32,
        derivative: number("derivative", &table.derivative, DERIVATIVE)? as f32,
        residency_window_celsius,
        residency_ms: (number("residency_s", &table.residency_s, RESIDENCY)? * 1e3).round() as u32,
        mass: table.model.as_ref().map_or(Ok(default_mass), |model| mass(name, model, check))?,
    })
}

/// What the virtual board's heater heats.
fn mass(name: &str, table: &ModelTable, check: &Checker<'_>) -> Result<HeatedMass, ProfileError> {
    let number = |key: &str, value: &Number, range| {
        check.number(&format!("{name}.model.{key}"), value, range).map(|number| number as f32)
    };
    let optional =
        |key: &str, value: &Option<Number>, range| value.as_ref().map_or(Ok(0.0), |value| number(key, value, range));
    Ok(HeatedMass {
        heater_w: number("power_w", &table.power_w, POWER)?,
        capacity_j_per_k: number("capacity_j_per_k", &table.capacity_j_per_k, CAPACITY)?,
        loss_w_per_k: number("loss_w_per_k", &table.loss_w_per_k, LOSS)?,
        fan_loss_w_per_k: optional("fan_loss_w_per_k", &table.fan_loss_w_per_k, FAN_LOSS)?,
        dead_time_s: optional("dead_time_s", &table.dead_time_s, DEAD_TIME)?,
    })
}

/// What measures a heater.
fn thermistor(name: &str, table: &HeaterTable, check: &Checker<'_>) -> Result<Thermistor, ProfileError> {
    let kind = match &table.sensor {
        ThermistorValue::Named(ThermistorName::Semitec104Gt2) => ThermistorType::Semitec104Gt2,
        ThermistorValue::Named(ThermistorName::Epcos100k) => ThermistorType::Epcos100k,
        ThermistorValue::Beta(beta) => ThermistorType::Beta {
            r25_ohm: check.number(&format!("{name}.sensor.r25_ohm"), &beta.r25_ohm, R25)? as f32,
            beta_k: check.number(&format!("{name}.sensor.beta_k"), &beta.beta_k, BETA)? as f32,
        },
    };
    let pull_up_ohm = match &table.pull_up_ohm {
        Some(value) => check.number(&format!("{name}.pull_up_ohm"), value, PULL_UP)? as f32,
        None => Thermistor::USUAL_PULL_UP_OHM,
    };
    Ok(Thermistor { kind, pull_up_ohm })
}

/// The lowest and the highest whole degree that a thermistor can read; the range is nowhere interrupted.
fn readable_celsius(thermistor: &Thermistor) -> [i16; 2] {
    let mut readable = (-100..=500_i16).filter(|celsius| thermistor.can_tell(f32::from(*celsius)));
    let lowest = readable.next().unwrap_or_default();
    [lowest, readable.next_back().unwrap_or(lowest)]
}

/// When a heater counts as failed.
fn watch(
    name: &str,
    table: &HeaterTable,
    default: HeaterWatch,
    check: &Checker<'_>,
) -> Result<HeaterWatch, ProfileError> {
    let number = |key: &str, value: &Option<Number>, range| match value {
        Some(value) => check.number(&format!("{name}.{key}"), value, range).map(Some),
        None => Ok(None),
    };
    let (watch_s, hysteresis) =
        if name == "bed" { (BED_WATCH, BED_RUNAWAY_HYSTERESIS) } else { (WATCH, RUNAWAY_HYSTERESIS) };
    let milliseconds = |seconds: f64| (seconds * 1e3).round() as u32;
    let degrees = |degrees: f64| degrees as f32;
    Ok(HeaterWatch {
        watch_ms: number("watch_s", &table.watch_s, watch_s)?.map_or(default.watch_ms, milliseconds),
        watch_celsius: number("watch_celsius", &table.watch_celsius, WATCH_RISE)?
            .map_or(default.watch_celsius, degrees),
        runaway_ms: number("runaway_s", &table.runaway_s, RUNAWAY)?.map_or(default.runaway_ms, milliseconds),
        runaway_celsius: number("runaway_celsius", &table.runaway_celsius, hysteresis)?
            .map_or(default.runaway_celsius, degrees),
    })
}
