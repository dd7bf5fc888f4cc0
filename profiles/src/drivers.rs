//! Motor drivers: their signals, and what those are set to that can be set.

use ferrostep_checked_toml::{Checker, Range, range};
use ferrostep_hal_shim::stepping::MIN_GAP_TICKS;
use ferrostep_hal_shim::tmc2209::{DriverSettings, chopper_threshold};
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::DriverTiming;

use crate::ProfileError;
use crate::file::{DriverSettingsTable, DriverTable, Number, ProfileFile};

/// The shortest time between two events that the step interrupt keeps, us.
pub(crate) const MIN_GAP_US: f64 = MIN_GAP_TICKS as f64 * 1e6 / TICKS_PER_SECOND as f64;

/// A motor's full steps a turn where a profile does not say: 1.8 degrees each.
const USUAL_FULL_STEPS_PER_TURN: f64 = 200.0;

/// By how much the steps a mm may be off what the screw says: a calibrated extruder is, a slip is at least a factor of 1.2.
const SCREW_TOLERANCE: f64 = 0.05;

const PULSE_WIDTH: Range = range(0.01, 50.0, "us");
const DIRECTION_SETUP: Range = range(0.0, 100.0, "us");
const DRIVER_CURRENT: Range = range(20.0, 3_000.0, "mA");
const HOLD_CURRENT: Range = range(0.0, 100.0, "percent");
const MICROSTEPS: Range = range(1.0, 256.0, "microsteps");
const STALL_THRESHOLD: Range = range(0.0, 255.0, "");
const CHOPPER_SPEED: Range = range(0.0, 2_000.0, "mm/s");
const FULL_STEPS_PER_TURN: Range = range(20.0, 1_000.0, "full steps");
const MM_PER_TURN: Range = range(0.1, 500.0, "mm");

/// Step and direction signals, fast enough for the event interval.
pub(crate) fn driver(table: &DriverTable, interval_us: f64, check: &Checker<'_>) -> Result<DriverTiming, ProfileError> {
    let pulse_us = check.number("driver.pulse_width_us", &table.pulse_width_us, PULSE_WIDTH)?;
    if !table.both_edges && pulse_us < MIN_GAP_US {
        let expected = format!(
            "at least {MIN_GAP_US} us, for the step interrupt of a board takes that long to end a pulse at its worst; or \
             driver.both_edges = true, if the drivers step at both edges (TMC2209 with a table [drivers])"
        );
        return Err(check.refuse("driver.pulse_width_us", &table.pulse_width_us, expected));
    }
    // A step is a high and a low time, or only one of them where both edges step.
    let levels = if table.both_edges { 1.0 } else { 2.0 };
    if pulse_us * levels > interval_us {
        let longest = interval_us / levels;
        let expected = format!("at most {longest} us (minimum_event_interval_us = {interval_us})");
        return Err(check.refuse("driver.pulse_width_us", &table.pulse_width_us, expected));
    }
    let setup_us = check.number("driver.direction_setup_us", &table.direction_setup_us, DIRECTION_SETUP)?;
    // A direction changes at the end of a pulse or, where both edges step, in an event of its own.
    let before_us = if table.both_edges { MIN_GAP_US } else { pulse_us };
    if before_us + setup_us > interval_us {
        let longest = interval_us - before_us;
        let expected =
            format!("at most {longest} us (minimum_event_interval_us = {interval_us}, less {before_us} us before it)");
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
pub(crate) fn drivers(
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
    steps_follow_from_the_screw(motor, table, steps_per_mm, microsteps, check)?;
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

/// Steps a mm, microsteps and what a turn moves are three ways to say two things: a slip in one of them shows. A Z screw
/// with the wrong microsteps halves every layer.
fn steps_follow_from_the_screw(
    motor: &str,
    table: &DriverSettingsTable,
    steps_per_mm: f64,
    microsteps: u16,
    check: &Checker<'_>,
) -> Result<(), ProfileError> {
    let key = |name: &str| format!("drivers.{motor}.{name}");
    let full_steps = match &table.full_steps_per_turn {
        Some(value) => check.number(&key("full_steps_per_turn"), value, FULL_STEPS_PER_TURN)?,
        None => USUAL_FULL_STEPS_PER_TURN,
    };
    let Some(mm_per_turn) = &table.mm_per_turn else {
        return match &table.full_steps_per_turn {
            Some(value) => {
                let expected = format!("{} beside it: alone it says nothing", key("mm_per_turn"));
                Err(check.refuse(&key("full_steps_per_turn"), value, expected))
            }
            None => Ok(()),
        };
    };
    let mm = check.number(&key("mm_per_turn"), mm_per_turn, MM_PER_TURN)?;
    let by_screw = full_steps * f64::from(microsteps) / mm;
    if (steps_per_mm / by_screw - 1.0).abs() <= SCREW_TOLERANCE {
        return Ok(());
    }
    let expected = format!(
        "{:.3} mm, or steps_per_mm.{motor} = {by_screw:.2} instead of {steps_per_mm}, or microsteps = {:.0} instead of \
         {microsteps}: {full_steps} full steps a turn, {microsteps} microsteps",
        full_steps * f64::from(microsteps) / steps_per_mm,
        steps_per_mm * mm / full_steps,
    );
    Err(check.refuse(&key("mm_per_turn"), mm_per_turn, expected))
}
