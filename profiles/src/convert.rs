//! From the checked text to the machine: ranges, units, and the values that must fit each other.

use ferrostep_checked_toml::{Checker, Range, range};
use ferrostep_planner::s_curve::FrequencyTable;
use ferrostep_planner::{
    AccelerationProfile, DualRatePeriods, Interpolation, Kinematics, Limits, MotionChoice, SCurveTableSettings,
    StepsPerMm, TICKS_PER_SECOND,
};
use ferrostep_printer::{
    DEFAULT_EVENTS_PER_S, DEFAULT_HEATER_TIMEOUT_S, DEFAULT_MOVES_PER_S, ExtrusionSettings, FirmwareRetraction, Profile,
};

use crate::ProfileError;
use crate::check::CheckAxes;
use crate::drivers::{MIN_GAP_US, driver, drivers};
use crate::file::{
    AccelerationName, CornerVelocityTable, DualRateTable, ExtrusionName, ExtrusionTable, InterpolationName,
    KinematicsName, Number, ProfileFile, RetractionTable, SCurveTable, Xyze,
};
use crate::heaters::heaters;
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
// A step has two levels or, at its closest, a direction change before it: each takes a gap of the step interrupt.
const EVENT_INTERVAL: Range = range(2.0 * MIN_GAP_US, 100.0, "us");
const MIN_EXTRUSION: Range = range(0.0, 400.0, "degrees Celsius");
const HEATER_TIMEOUT: Range = range(0.0, 65_535.0, "s");
const RETRACTION: Range = range(0.0, 100.0, "mm");
const EXTRA_RECOVER: Range = range(-100.0, 100.0, "mm");
const LIFT: Range = range(0.0, 50.0, "mm");
const EVENTS_PER_S: Range = range(1_000.0, 10_000_000.0, "events/s");
const MOVES_PER_S: Range = range(10.0, 1_000_000.0, "moves/s");
const PERIOD: Range = range(1.0, 1_000_000.0, "us");
const FREQUENCY: Range = range(1.0, 1_000_000.0, "steps/s");
const TABLE_JERK: Range = range(1.0, 1_000_000_000.0, "steps/s^3");

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
    let heater_timeout_s = match &file.heater_timeout_s {
        Some(value) => check.number("heater_timeout_s", value, HEATER_TIMEOUT)?.round() as u16,
        None => DEFAULT_HEATER_TIMEOUT_S,
    };
    let drivers = drivers(file, steps, check)?;
    let homing = homing::axes(file, &travel, steps, &limits, &drivers, check)?;
    let safe_homing = homing::safe(file, &travel, &homing[2], check)?;
    let [nozzle, bed] = heaters(&file.nozzle, &file.bed, check)?;
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
        heater_timeout_s,
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
