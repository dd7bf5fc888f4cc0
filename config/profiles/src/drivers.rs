//! Motor drivers: their signals, and the settings of those that a serial line reaches.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::DriverTiming;
use ferrostep_step_player::MIN_GAP_TICKS;
use ferrostep_tmc2209::DriverSettings;

use crate::axes::MOTORS;

/// The shortest time between two events that the step interrupt keeps, us.
pub(crate) const MIN_GAP_US: f64 = MIN_GAP_TICKS as f64 * 1e6 / TICKS_PER_SECOND as f64;

/// A motor's full steps a turn if a profile does not say: 1.8 degrees each.
const USUAL_FULL_STEPS_PER_TURN: f64 = 200.0;

/// Tolerance of the steps a mm against those that the screw makes: a calibrated extruder's differ a
/// little, a slip is a factor of 1.2 or more.
const SCREW_TOLERANCE: f64 = 0.05;

const PULSE_WIDTH: Range = range(0.01, 50.0, "us");
const DIRECTION_SETUP: Range = range(0.0, 100.0, "us");
const DRIVER_CURRENT: Range = range(20.0, 3_000.0, "mA");
const HOLD_CURRENT: Range = range(0.0, 100.0, "percent");
const MICROSTEPS: Range = range(1.0, 256.0, "");
const STALL_THRESHOLD: Range = range(0.0, 255.0, "");
const CHOPPER_SPEED: Range = range(0.0, 2_000.0, "mm/s");
const FULL_STEPS_PER_TURN: Range = range(20.0, 1_000.0, "full steps");
const MM_PER_TURN: Range = range(0.1, 500.0, "mm");

/// Step and direction signals, fast enough for the event interval.
pub(crate) fn timing(keys: &Section<'_>, interval_us: f64) -> DriverTiming {
    let table = keys.section("driver", "step and direction signals (A4988: pulses of 1 µs, set-up 0.2 µs)");
    let pulse_us = table.number("pulse_width_us", PULSE_WIDTH).required(
        "minimum high and low time of a step pulse: at least 1 µs unless both edges step \
         ([why](stepping.md#the-reload-value-in-time)); twice this time (once with both edges) must fit the event \
         interval",
    );
    let setup_us = table
        .number("direction_setup_us", DIRECTION_SETUP)
        .required("minimum time from a direction change to the next step");
    let both_edges = table
        .flag("both_edges")
        .required("both edges of the step signal are steps; the driver must be set up for this");
    let inverted = table
        .words("inverted", [("x", 0b0001_u8), ("y", 0b0010), ("z", 0b0100), ("e", 0b1000)])
        .or(Vec::new(), "motors whose direction is inverted");
    if !both_edges && pulse_us < MIN_GAP_US {
        let expected = format!(
            "at least {MIN_GAP_US} us, which a board's step interrupt needs at worst to end a pulse; or \
             driver.both_edges = true, if the drivers step at both edges (TMC2209 with a table [drivers])"
        );
        table.refuse("pulse_width_us", expected);
    }
    // A step is a high and a low time, or only one of them where both edges step.
    let levels = if both_edges { 1.0 } else { 2.0 };
    if pulse_us * levels > interval_us {
        let longest = interval_us / levels;
        table.refuse("pulse_width_us", format!("at most {longest} us (minimum_event_interval_us = {interval_us})"));
    }
    // A direction changes at the end of a pulse or, where both edges step, in a separate event.
    let before_us = if both_edges { MIN_GAP_US } else { pulse_us };
    if before_us + setup_us > interval_us {
        let longest = interval_us - before_us;
        let expected =
            format!("at most {longest} us (minimum_event_interval_us = {interval_us}, less {before_us} us before it)");
        table.refuse("direction_setup_us", expected);
    }
    DriverTiming {
        pulse_width_ns: (pulse_us * 1e3).round() as u32,
        direction_setup_ns: (setup_us * 1e3).round() as u32,
        both_edges,
        inverted: inverted.into_iter().fold(0, |motors, motor| motors | motor),
    }
}

/// Settings of drivers; `None` for those without.
pub(crate) fn drivers(keys: &Section<'_>, steps_per_mm: [f64; 4], both_edges: bool) -> [Option<DriverSettings>; 4] {
    let tables = keys.section_of_defaults(
        "drivers",
        "[motor drivers](drivers.md) configured over a serial line (TMC2209); on CoreXY x and y are motors A and B, \
         on CoreXZ x and z are motors A and C",
    );
    let mut steps = steps_per_mm.into_iter();
    MOTORS.map(|motor| {
        let steps_per_mm = steps.next().unwrap_or_default();
        let table = tables.optional_section(motor, "not set", "")?;
        Some(settings(&table, motor, steps_per_mm, both_edges))
    })
}

/// The driver of a further extruder's motor, in that extruder's table.
pub(crate) fn driver(keys: &Section<'_>, motor: &str, steps_per_mm: f64, both_edges: bool) -> Option<DriverSettings> {
    let table = keys.optional_section("driver", "not set", "driver of its motor")?;
    Some(settings(&table, motor, steps_per_mm, both_edges))
}

/// Settings of one motor's driver. The board's check decides whether its sense resistors
/// allow the current.
fn settings(table: &Section<'_>, motor: &str, steps_per_mm: f64, both_edges: bool) -> DriverSettings {
    let current_ma = table
        .whole("current_ma", DRIVER_CURRENT)
        .required("RMS run current (M906); the board's sense resistors may allow less");
    let hold_percent = table
        .whole("hold_current_percent", HOLD_CURRENT)
        .required("hold current at standstill, as a share of `current_ma`");
    let microsteps = table
        .whole("microsteps", MICROSTEPS)
        .required("microsteps per full step: 1, 2, 4, 8, 16, 32, 64, 128 or 256; `steps_per_mm` counts them")
        as u16;
    if !microsteps.is_power_of_two() {
        table.refuse("microsteps", "1, 2, 4, 8, 16, 32, 64, 128 or 256");
    }
    steps_follow_from_the_screw(table, motor, steps_per_mm, microsteps);
    let interpolate = table.flag("interpolate").required("the driver interpolates to 256 microsteps");
    let stealth_chop =
        table.flag("stealth_chop").required("`true`: stealthChop, which is quiet; `false`: spreadCycle (M569)");
    let above_mm_per_s = table
        .whole("spread_cycle_above_mm_per_s", CHOPPER_SPEED)
        .required("speed from which stealthChop changes to spreadCycle; 0 = never (M913)");
    let stall_threshold = table
        .whole("stall_threshold", STALL_THRESHOLD)
        .required("StallGuard threshold: a higher one triggers earlier; 0 = never (M914)");
    DriverSettings {
        current_ma: current_ma as u16,
        hold_percent: hold_percent as u8,
        microsteps,
        interpolate,
        stealth_chop,
        spread_cycle_above_mm_per_s: above_mm_per_s as u16,
        steps_per_mm: steps_per_mm as f32,
        stall_threshold: stall_threshold as u8,
        both_edges,
    }
}

/// Steps a mm, microsteps and the length of a turn are three ways to say two things: a slip in one
/// of them shows. A Z screw with the wrong microsteps halves every layer.
fn steps_follow_from_the_screw(table: &Section<'_>, motor: &str, steps_per_mm: f64, microsteps: u16) {
    let written = table
        .number("full_steps_per_turn", FULL_STEPS_PER_TURN)
        .optional("200", "full steps per motor turn; only with `mm_per_turn`");
    let mm_per_turn = table.number("mm_per_turn", MM_PER_TURN).optional(
        "not checked",
        "axis travel per motor turn (screw lead, or pulley teeth times belt pitch); `steps_per_mm` must be \
         `full_steps_per_turn` · `microsteps` / `mm_per_turn` within 5 %, which catches a mistake in any of them",
    );
    let full_steps = written.unwrap_or(USUAL_FULL_STEPS_PER_TURN);
    let Some(mm) = mm_per_turn else {
        if written.is_some() {
            let expected = format!("{} with it: alone it has no effect", table.path("mm_per_turn"));
            table.refuse("full_steps_per_turn", expected);
        }
        return;
    };
    let by_screw = full_steps * f64::from(microsteps) / mm;
    if (steps_per_mm / by_screw - 1.0).abs() > SCREW_TOLERANCE {
        let expected = format!(
            "{:.3} mm, or steps_per_mm.{motor} = {by_screw:.2} instead of {steps_per_mm}, or microsteps = {:.0} instead of \
             {microsteps}: {full_steps} full steps a turn, {microsteps} microsteps",
            full_steps * f64::from(microsteps) / steps_per_mm,
            steps_per_mm * mm / full_steps,
        );
        table.refuse("mm_per_turn", expected);
    }
}
