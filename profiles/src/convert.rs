//! From the checked text to the machine: ranges, units, and the values that must fit each other.

use ferrostep_checked_toml::{Checker, Range, range};
use ferrostep_hal_shim::thermistor::{Thermistor, ThermistorType};
use ferrostep_hal_shim::tmc2209::{DriverSettings, chopper_threshold};
use ferrostep_planner::s_curve::FrequencyTable;
use ferrostep_planner::{
    AccelerationProfile, DualRatePeriods, Interpolation, Kinematics, Limits, MotionChoice, SCurveTableSettings,
    StepsPerMm, TICKS_PER_SECOND,
};
use ferrostep_printer::{
    DEFAULT_EVENTS_PER_S, DEFAULT_MOVES_PER_S, DriverTiming, ExtrusionSettings, FirmwareRetraction, HeaterSettings,
    HeaterWatch, Profile,
};

use crate::ProfileError;
use crate::check::CheckAxes;
use crate::file::{
    AccelerationName, CornerVelocityTable, DriverSettingsTable, DriverTable, DualRateTable, ExtrusionName,
    ExtrusionTable, HeaterTable, InterpolationName, KinematicsName, Number, ProfileFile, RetractionTable, SCurveTable,
    ThermistorName, ThermistorValue, Xyze,
};
use crate::homing;

/// Units of 10 nm in a mm.
const UNITS_PER_MM: f64 = 100_000.0;
/// Ticks of the nominal time base in a microsecond.
const TICKS_PER_US: f64 = TICKS_PER_SECOND as f64 / 1e6;

const STEPS_PER_MM: Range = range(1.0, 10_000.0, "steps/mm");
pub const FEED: Range = range(0.01, 2_000.0, "mm/s");
const ACCELERATION: Range = range(0.1, 100_000.0, "mm/s^2");
const JUNCTION_DEVIATION: Range = range(0.000_1, 1.0, "mm");
const CORNER_VELOCITY: Range = range(0.001, 1_000.0, "mm/s");
const JERK: Range = range(1.0, 10_000_000.0, "mm/s^3");
const EVENT_INTERVAL: Range = range(0.5, 100.0, "us");
const MIN_EXTRUSION: Range = range(0.0, 400.0, "degrees Celsius");
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
// large that a sound heater trips.
const WATCH: Range = range(5.0, 120.0, "s");
const WATCH_RISE: Range = range(1.0, 20.0, "degrees");
const RUNAWAY: Range = range(5.0, 120.0, "s");
const RUNAWAY_HYSTERESIS: Range = range(1.0, 20.0, "degrees");
const RETRACTION: Range = range(0.0, 100.0, "mm");
const EXTRA_RECOVER: Range = range(-100.0, 100.0, "mm");
const LIFT: Range = range(0.0, 50.0, "mm");
const PULSE_WIDTH: Range = range(0.01, 50.0, "us");
const EVENTS_PER_S: Range = range(1_000.0, 10_000_000.0, "events/s");
const MOVES_PER_S: Range = range(10.0, 1_000_000.0, "moves/s");
const PERIOD: Range = range(1.0, 1_000_000.0, "us");
const FREQUENCY: Range = range(1.0, 1_000_000.0, "steps/s");
const TABLE_JERK: Range = range(1.0, 1_000_000_000.0, "steps/s^3");
const DRIVER_CURRENT: Range = range(20.0, 3_000.0, "mA");
const HOLD_CURRENT: Range = range(0.0, 100.0, "percent");
const MICROSTEPS: Range = range(1.0, 256.0, "microsteps");
const STALL_THRESHOLD: Range = range(0.0, 255.0, "");
const CHOPPER_SPEED: Range = range(0.0, 2_000.0, "mm/s");
const DIRECTION_SETUP: Range = range(0.0, 100.0, "us");

/// Longest name, bytes.
const MAX_NAME: usize = 32;

/// Checks every value of a profile and converts it to the machine's units.
pub fn profile(file: &ProfileFile, check: &Checker<'_>) -> Result<Profile, ProfileError> {
    let name = checked_name(file, check)?;
    let kinematics = match file.kinematics {
        KinematicsName::Cartesian => Kinematics::Cartesian,
        KinematicsName::CoreXy => Kinematics::CoreXy,
    };
    let travel = homing::Travel::new(file, check)?;
    let steps = check.four("steps_per_mm", &file.steps_per_mm, STEPS_PER_MM)?;
    let steps_per_mm = fixed_point_steps(steps, file, check)?;
    let limits = limits(file, check)?;
    let motion = motion(file, check)?;
    let interval_us = check.number("minimum_event_interval_us", &file.minimum_event_interval_us, EVENT_INTERVAL)?;
    motor_rates(kinematics, steps, &limits, interval_us, file, check)?;
    let min_extrusion = check.number("min_extrusion_celsius", &file.min_extrusion_celsius, MIN_EXTRUSION)?;
    let drivers = drivers(file, steps, check)?;
    let homing = homing::axes(file, &travel, steps, &limits, &drivers, check)?;
    let safe_homing = homing::safe(file, &travel, &homing[2], check)?;
    let nozzle = heater("nozzle", &file.nozzle, NOZZLE_MAX, HeaterWatch::NOZZLE, check)?;
    let bed = heater("bed", &file.bed, BED_MAX, HeaterWatch::BED, check)?;
    if min_extrusion as f32 >= nozzle.max_celsius {
        let expected = format!("less than nozzle.max_celsius = {}", nozzle.max_celsius);
        return Err(check.refuse("min_extrusion_celsius", &file.min_extrusion_celsius, expected));
    }
    let budget = &file.budget;
    let event_cost_ticks = cost_ticks("events_per_s", &budget.events_per_s, DEFAULT_EVENTS_PER_S, EVENTS_PER_S, check)?;
    let move_cost_ticks = cost_ticks("moves_per_s", &budget.moves_per_s, DEFAULT_MOVES_PER_S, MOVES_PER_S, check)?;
    Ok(Profile {
        kinematics,
        size_10nm: travel.upper_mm.map(units_10nm),
        lower_end_10nm: travel.lower_mm.map(units_10nm),
        steps_per_mm,
        limits,
        motion,
        minimum_event_interval_ticks: (interval_us * TICKS_PER_US).round() as u32,
        event_cost_ticks,
        move_cost_ticks,
        homing,
        safe_homing,
        min_extrusion_celsius: min_extrusion as f32,
        nozzle,
        bed,
        retraction: retraction(&file.firmware_retraction, check)?,
        driver: driver(&file.driver, interval_us, check)?,
        extrusion: extrusion(&file.extrusion, check)?,
        drivers,
        // Leaked last, so that only profiles without a fault leave something behind.
        name: Box::leak(name.to_owned().into_boxed_str()),
    })
}

/// A name that M115 can put into its line.
fn checked_name<'a>(file: &'a ProfileFile, check: &Checker<'_>) -> Result<&'a str, ProfileError> {
    let name = file.name.get_ref();
    let printable = name.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic());
    if printable && !name.trim().is_empty() && name.len() <= MAX_NAME {
        return Ok(name);
    }
    let expected = format!("1 to {MAX_NAME} printable ASCII characters, not all blank");
    let shown = toml::Spanned::new(file.name.span(), format!("{name:?}"));
    Err(check.refuse("name", &shown, expected))
}

/// Steps/mm in the planner's fixed-point form.
fn fixed_point_steps(
    steps: [f64; 4],
    file: &ProfileFile,
    check: &Checker<'_>,
) -> Result<[StepsPerMm; 4], ProfileError> {
    let convert = |index: usize, key: &str, value: &Number| {
        StepsPerMm::from_f64(steps[index]).ok_or_else(|| check.refuse(key, value, STEPS_PER_MM))
    };
    let values = &file.steps_per_mm;
    Ok([
        convert(0, "steps_per_mm.x", &values.x)?,
        convert(1, "steps_per_mm.y", &values.y)?,
        convert(2, "steps_per_mm.z", &values.z)?,
        convert(3, "steps_per_mm.e", &values.e)?,
    ])
}

/// Speeds, accelerations and the junction deviation.
fn limits(file: &ProfileFile, check: &Checker<'_>) -> Result<Limits, ProfileError> {
    let moves = &file.acceleration_mm_per_s2;
    let acceleration = |name: &str, value| check.number(&format!("acceleration_mm_per_s2.{name}"), value, ACCELERATION);
    Ok(Limits {
        max_feed_mm_per_s: check.four("max_feed_mm_per_s", &file.max_feed_mm_per_s, FEED)?,
        max_acceleration_mm_per_s2: check.four(
            "max_acceleration_mm_per_s2",
            &file.max_acceleration_mm_per_s2,
            ACCELERATION,
        )?,
        print_acceleration_mm_per_s2: acceleration("print", &moves.print)?,
        travel_acceleration_mm_per_s2: acceleration("travel", &moves.travel)?,
        retract_acceleration_mm_per_s2: acceleration("retract", &moves.retract)?,
        junction_deviation_mm: check.number(
            "junction_deviation_mm",
            &file.junction_deviation_mm,
            JUNCTION_DEVIATION,
        )?,
        instantaneous_corner_velocity_mm_per_s: corner_velocities(file, check)?,
    })
}

/// By how much a corner may change an axis's speed. Where the file says nothing, 10 mm/s for the extruder, as the makers of
/// printers with such a limit have it, half of that for Z, and no limit but the arc's for X and Y.
fn corner_velocities(file: &ProfileFile, check: &Checker<'_>) -> Result<[f64; 4], ProfileError> {
    let CornerVelocityTable { x, y, z, e } = &file.instantaneous_corner_velocity_mm_per_s;
    let of = |axis: &str, value: &Option<Number>, absent| match value {
        Some(value) => check.number(&format!("instantaneous_corner_velocity_mm_per_s.{axis}"), value, CORNER_VELOCITY),
        None => Ok(absent),
    };
    Ok([of("x", x, f64::INFINITY)?, of("y", y, f64::INFINITY)?, of("z", z, 5.0)?, of("e", e, 10.0)?])
}

/// The methods that make the steps.
fn motion(file: &ProfileFile, check: &Checker<'_>) -> Result<MotionChoice, ProfileError> {
    let default = MotionChoice::DEFAULT;
    Ok(MotionChoice {
        interpolation: match file.interpolation {
            InterpolationName::StepBresenham => Interpolation::StepBresenham,
            InterpolationName::Bresenham => Interpolation::Bresenham,
            InterpolationName::PointByPoint => Interpolation::PointByPoint,
            InterpolationName::MinimumDeviation => Interpolation::MinimumDeviation,
            InterpolationName::DualRate => Interpolation::DualRate,
        },
        acceleration: match file.acceleration {
            AccelerationName::Trapezoid => AccelerationProfile::Trapezoid,
            AccelerationName::SCurve => AccelerationProfile::SCurve,
            AccelerationName::SCurveTable => AccelerationProfile::SCurveTable,
        },
        jerk_mm_per_s3: check.number("jerk_mm_per_s3", &file.jerk_mm_per_s3, JERK)?,
        dual_rate: match &file.dual_rate {
            Some(table) => dual_rate(table, check)?,
            None => default.dual_rate,
        },
        s_curve_table: match &file.s_curve_table {
            Some(table) => s_curve_table(table, check)?,
            None => default.s_curve_table,
        },
    })
}

/// Periods, the longest not below the shortest.
fn dual_rate(table: &DualRateTable, check: &Checker<'_>) -> Result<DualRatePeriods, ProfileError> {
    let shortest_us = check.number("dual_rate.min_period_us", &table.min_period_us, PERIOD)?;
    let longest = range(shortest_us, PERIOD.high, "us, at least min_period_us");
    let longest_us = check.number("dual_rate.max_period_us", &table.max_period_us, longest)?;
    let [shortest_ns, longest_ns] = [shortest_us, longest_us].map(|us| (us * 1e3).round() as u32);
    Ok(DualRatePeriods { shortest_ns, longest_ns })
}

/// What the table of frequencies is made of; it ends above where it starts.
fn s_curve_table(table: &SCurveTable, check: &Checker<'_>) -> Result<SCurveTableSettings, ProfileError> {
    let lower = range(FREQUENCY.low, FREQUENCY.high - 1.0, "steps/s");
    let start_hz = check.number("s_curve_table.start_hz", &table.start_hz, lower)?.round();
    let top = range(start_hz + 1.0, FREQUENCY.high, "steps/s, above start_hz");
    let top_hz = check.number("s_curve_table.top_hz", &table.top_hz, top)?.round();
    let jerk = check.number("s_curve_table.jerk_hz_per_s2", &table.jerk_hz_per_s2, TABLE_JERK)?.round();
    if FrequencyTable::new(start_hz, top_hz, jerk).is_err() {
        let expected = "a table of at most 65536 slices of 2/start_hz: a larger jerk or a lower start_hz";
        return Err(check.refuse("s_curve_table.jerk_hz_per_s2", &table.jerk_hz_per_s2, expected));
    }
    Ok(SCurveTableSettings { start_hz: start_hz as u32, top_hz: top_hz as u32, jerk_hz_per_s2: jerk as u32 })
}

/// No motor may have to step more often than events may follow each other.
fn motor_rates(
    kinematics: Kinematics,
    steps: [f64; 4],
    limits: &Limits,
    interval_us: f64,
    file: &ProfileFile,
    check: &Checker<'_>,
) -> Result<(), ProfileError> {
    let [x, y, z, e] = limits.max_feed_mm_per_s;
    // Both motors of a CoreXY machine turn fastest on a diagonal, by the sum of the speeds.
    let motor_feeds_mm_per_s = match kinematics {
        Kinematics::Cartesian => [x, y, z, e],
        Kinematics::CoreXy => [x + y, x + y, z, e],
    };
    let Xyze { x, y, z, e } = &file.max_feed_mm_per_s;
    for (index, (axis, value)) in [("x", x), ("y", y), ("z", z), ("e", e)].into_iter().enumerate() {
        let steps_per_s = motor_feeds_mm_per_s[index] * steps[index];
        let highest_per_s = 1e6 / interval_us;
        if steps_per_s > highest_per_s {
            let expected = format!(
                "a motor rate of at most {highest_per_s:.0} steps/s (minimum_event_interval_us = {interval_us}), \
                 not {steps_per_s:.0}"
            );
            return Err(check.refuse(&format!("max_feed_mm_per_s.{axis}"), value, expected));
        }
    }
    Ok(())
}

/// Range and control of one heater.
fn heater(
    name: &str,
    table: &HeaterTable,
    max_celsius: Range,
    default_watch: HeaterWatch,
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
        watch,
        proportional: number("proportional", &table.proportional, PROPORTIONAL)? as f32,
        integral: number("integral", &table.integral, INTEGRAL)? as f32,
        derivative: number("derivative", &table.derivative, DERIVATIVE)? as f32,
        residency_window_celsius,
        residency_ms: (number("residency_s", &table.residency_s, RESIDENCY)? * 1e3).round() as u32,
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
    let milliseconds = |seconds: f64| (seconds * 1e3).round() as u32;
    let degrees = |degrees: f64| degrees as f32;
    Ok(HeaterWatch {
        watch_ms: number("watch_s", &table.watch_s, WATCH)?.map_or(default.watch_ms, milliseconds),
        watch_celsius: number("watch_celsius", &table.watch_celsius, WATCH_RISE)?
            .map_or(default.watch_celsius, degrees),
        runaway_ms: number("runaway_s", &table.runaway_s, RUNAWAY)?.map_or(default.runaway_ms, milliseconds),
        runaway_celsius: number("runaway_celsius", &table.runaway_celsius, RUNAWAY_HYSTERESIS)?
            .map_or(default.runaway_celsius, degrees),
    })
}

/// Firmware retraction at start-up.
fn retraction(table: &RetractionTable, check: &Checker<'_>) -> Result<FirmwareRetraction, ProfileError> {
    let units = |key: &str, value: &Number, range| {
        check.number(&format!("firmware_retraction.{key}"), value, range).map(units_10nm)
    };
    Ok(FirmwareRetraction {
        length_10nm: units("length_mm", &table.length_mm, RETRACTION)?,
        retract_10nm_per_s: units("retract_mm_per_s", &table.retract_mm_per_s, FEED)?,
        extra_recover_10nm: units("extra_recover_mm", &table.extra_recover_mm, EXTRA_RECOVER)?,
        recover_10nm_per_s: units("recover_mm_per_s", &table.recover_mm_per_s, FEED)?,
        lift_10nm: units("lift_mm", &table.lift_mm, LIFT)?,
    })
}

/// Filament for moves that tell none.
fn extrusion(table: &ExtrusionTable, check: &Checker<'_>) -> Result<ExtrusionSettings, ProfileError> {
    let default = ExtrusionSettings::DEFAULT;
    let [height, width, diameter] = ExtrusionSettings::RANGES_10NM
        .map(|(least, most)| range(least as f64 / UNITS_PER_MM, most as f64 / UNITS_PER_MM, "mm"));
    let size = |key: &str, value: &Option<Number>, range, default| match value {
        Some(value) => check.number(&format!("extrusion.{key}"), value, range).map(units_10nm),
        None => Ok(default),
    };
    let diameter_mm = &table.filament_diameter_mm;
    Ok(ExtrusionSettings {
        adaptive: table.mode == ExtrusionName::Adaptive,
        layer_height_10nm: size("layer_height_mm", &table.layer_height_mm, height, default.layer_height_10nm)?,
        line_width_10nm: size("line_width_mm", &table.line_width_mm, width, default.line_width_10nm)?,
        filament_diameter_10nm: size("filament_diameter_mm", diameter_mm, diameter, default.filament_diameter_10nm)?,
    })
}

/// Step and direction signals, fast enough for the event interval.
fn driver(table: &DriverTable, interval_us: f64, check: &Checker<'_>) -> Result<DriverTiming, ProfileError> {
    let pulse_us = check.number("driver.pulse_width_us", &table.pulse_width_us, PULSE_WIDTH)?;
    // A step is a high and a low time, or only one of them where both edges step.
    let levels = if table.both_edges { 1.0 } else { 2.0 };
    if pulse_us * levels > interval_us {
        let longest = interval_us / levels;
        let expected = format!("at most {longest} us (minimum_event_interval_us = {interval_us})");
        return Err(check.refuse("driver.pulse_width_us", &table.pulse_width_us, expected));
    }
    let setup_us = check.number("driver.direction_setup_us", &table.direction_setup_us, DIRECTION_SETUP)?;
    // A direction changes at the end of a pulse, or right after an edge that was a step.
    let before_us = if table.both_edges { 0.1 } else { pulse_us };
    if before_us + setup_us > interval_us {
        let longest = interval_us - before_us;
        let expected = format!("at most {longest} us (minimum_event_interval_us = {interval_us}, after a pulse)");
        return Err(check.refuse("driver.direction_setup_us", &table.direction_setup_us, expected));
    }
    Ok(DriverTiming {
        pulse_width_ns: (pulse_us * 1e3).round() as u32,
        direction_setup_ns: (setup_us * 1e3).round() as u32,
        both_edges: table.both_edges,
        inverted: table.inverted.iter().fold(0, |motors, motor| motors | 1 << *motor as u8),
    })
}

/// Drivers that can be set.
fn drivers(
    file: &ProfileFile,
    steps_per_mm: [f64; 4],
    check: &Checker<'_>,
) -> Result<[Option<DriverSettings>; 4], ProfileError> {
    let [x, y, z, e] = steps_per_mm;
    let one = |motor: &str, table: &Option<DriverSettingsTable>, steps_per_mm| {
        table
            .as_ref()
            .map(|table| driver_settings(motor, table, steps_per_mm, file.driver.both_edges, check))
            .transpose()
    };
    let tables = &file.drivers;
    Ok([one("x", &tables.x, x)?, one("y", &tables.y, y)?, one("z", &tables.z, z)?, one("e", &tables.e, e)?])
}

/// What the driver of a motor is set to. Whether it can make the current is for the board's sense resistors to say.
fn driver_settings(
    motor: &str,
    table: &DriverSettingsTable,
    steps_per_mm: f64,
    both_edges: bool,
    check: &Checker<'_>,
) -> Result<DriverSettings, ProfileError> {
    let whole = |key: &str, value: &Number, range| {
        let key = format!("drivers.{motor}.{key}");
        let number = check.number(&key, value, range)?;
        let expected = format!("a whole number from {range}");
        if number.fract() == 0.0 { Ok(number as u16) } else { Err(check.refuse(&key, value, expected)) }
    };
    let microsteps = whole("microsteps", &table.microsteps, MICROSTEPS)?;
    if !microsteps.is_power_of_two() {
        let key = format!("drivers.{motor}.microsteps");
        return Err(check.refuse(&key, &table.microsteps, "1, 2, 4, 8, 16, 32, 64, 128 or 256"));
    }
    let key = format!("drivers.{motor}.spread_cycle_above_mm_per_s");
    let above_mm_per_s = check.number(&key, &table.spread_cycle_above_mm_per_s, CHOPPER_SPEED)?;
    Ok(DriverSettings {
        current_ma: whole("current_ma", &table.current_ma, DRIVER_CURRENT)?,
        hold_percent: whole("hold_current_percent", &table.hold_current_percent, HOLD_CURRENT)? as u8,
        microsteps,
        interpolate: table.interpolate,
        stealth_chop: table.stealth_chop,
        stealth_until: chopper_threshold(above_mm_per_s, steps_per_mm, microsteps),
        stall_threshold: whole("stall_threshold", &table.stall_threshold, STALL_THRESHOLD)? as u8,
        both_edges,
    })
}

/// Ticks that each of so many things a second costs, rounded up.
fn cost_ticks(
    key: &str,
    value: &Option<Number>,
    default_per_s: u32,
    range: Range,
    check: &Checker<'_>,
) -> Result<u32, ProfileError> {
    let per_s = match value {
        Some(value) => check.number(&format!("budget.{key}"), value, range)?,
        None => f64::from(default_per_s),
    };
    Ok((f64::from(TICKS_PER_SECOND) / per_s).ceil() as u32)
}

/// Millimetres to units of 10 nm. The ranges above keep the product far within both types.
pub fn units_10nm(length_mm: f64) -> i64 {
    (length_mm * UNITS_PER_MM).round() as i64
}
