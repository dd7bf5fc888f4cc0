//! Motion through filters: costs of a step, a breakpoint, and a line.

use core::fmt;

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, ShaperKind, StepsPerMm};
use ferrostep_printer::Profile;

use crate::figures::Mean;
use crate::machine::BenchPlanner;
use crate::pieces::{Goal, Outcome, advance};
use crate::queue::PrintQueue;
use crate::span::Counter;

/// Frequencies of the filters: X at 50 Hz, Y at 40 Hz. Three impulses each; Z and the extruder,
/// late by their mean, make a seventh delay.
const FREQUENCIES_HZ: [f64; 2] = [50.0, 40.0];

/// Delays of these filters.
const DELAYS: u32 = 7;

/// Pieces of a line's plan: ramp, cruise, ramp, and the rest at its end.
const PIECES: u32 = 4;

/// A window lies between two breakpoints, and every delay has one for each piece. The line is short
/// enough that none of its windows is divided, and turns no motor.
const WINDOWS: u32 = DELAYS * PIECES - 1;

/// The line: 20 mm, X, Y, and filament.
const X_MM: i64 = 16;
const Y_MM: i64 = 12;
const FILAMENT_MM: f64 = 0.5;

/// Steps/mm of X and Y, and of the filament; both are doubled for a second count. Twice the steps
/// in the same windows tell the costs of steps and windows apart.
const STEPS_PER_MM: f64 = 80.0;
const FILAMENT_STEPS_PER_MM: f64 = 100.0;

/// Steps of all motors at these.
const STEPS: u32 = 16 * 80 + 12 * 80 + 50;

/// Instructions of shaped motion.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shaped {
    /// A motor's step: to solve for its time and to merge it with the others.
    pub per_step: Mean,
    /// A breakpoint: where a filter comes to another piece of the plan.
    pub per_breakpoint: Mean,
    /// A block to pieces of the plan.
    pub begin_line: u32,
    /// A line at 160 steps/mm, all of it.
    pub line: u32,
    /// The same on CoreXY.
    pub line_core_xy: u32,
}

/// A line's instructions.
#[derive(Clone, Copy, Debug, Default)]
struct Line {
    /// Instructions that take its block.
    begin: u32,
    /// Instructions that make its events and come to rest.
    rest: u32,
}

/// Lines at 300 mm/s and 10,000 mm/s^2, from their blocks to entries in the queue.
///
/// # Errors
/// The line was refused.
#[inline(never)]
pub fn measure(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
) -> Result<Shaped, &'static str> {
    let few = line(counter, profile, ring, queue, Kinematics::Cartesian, 1.0)?;
    let many = line(counter, profile, ring, queue, Kinematics::Cartesian, 2.0)?;
    let core_xy = line(counter, profile, ring, queue, Kinematics::CoreXy, 2.0)?;
    let of_steps = many.rest.saturating_sub(few.rest);
    let (mut per_step, mut per_breakpoint) = (Mean::default(), Mean::default());
    per_step.add(of_steps, STEPS);
    per_breakpoint.add(few.rest.saturating_sub(of_steps), WINDOWS);
    Ok(Shaped {
        per_step,
        per_breakpoint,
        begin_line: many.begin,
        line: many.begin + many.rest,
        line_core_xy: core_xy.begin + core_xy.rest,
    })
}

#[inline(never)]
fn line(
    counter: &Counter,
    profile: &Profile,
    ring: &mut [Slot],
    queue: &mut PrintQueue,
    kinematics: Kinematics,
    factor: f64,
) -> Result<Line, &'static str> {
    let steps_per_mm = StepsPerMm::nearest(STEPS_PER_MM * factor);
    let filament_steps_per_mm = StepsPerMm::nearest(FILAMENT_STEPS_PER_MM * factor);
    let geometry = Geometry {
        kinematics,
        steps_per_mm: [steps_per_mm, steps_per_mm, steps_per_mm, filament_steps_per_mm],
        event_cost_ticks: 0,
        move_cost_ticks: 0,
        ..profile.geometry()
    };
    let limits = Limits {
        max_feed_mm_per_s: [400.0; 4],
        max_acceleration_mm_per_s2: [20_000.0; 4],
        print_acceleration_mm_per_s2: 10_000.0,
        ..profile.limits
    };
    let mut planner = BenchPlanner::new(geometry, limits, ring);
    let shapers = FREQUENCIES_HZ.map(|frequency_hz| AxisShaper { kind: ShaperKind::Mzv, frequency_hz, damping: 0.1 });
    let choice = MotionChoice { shapers, ..MotionChoice::DEFAULT };
    planner.set_motion_choice(&choice).map_err(|_| "the filters were refused")?;
    let request = Move {
        target_10nm: [X_MM * 100_000, Y_MM * 100_000, 0],
        filament_100pm: (FILAMENT_MM * 1e7) as i64,
        feed_mm_per_s: 300.0,
        line: 0,
        ends_move: true,
    };
    planner.add(&request).map_err(|_| "the shaped line was refused")?;
    planner.flush();
    // The first call takes the block, the others make events.
    let (begin, _) = counter.count(|| advance(&mut planner, queue, Goal::OneCall));
    let mut line = Line { begin, rest: 0 };
    loop {
        let (part, outcome) = counter.count(|| advance(&mut planner, queue, Goal::AllBlocks));
        line.rest += part;
        queue.empty();
        if outcome != Outcome::QueueFull {
            return Ok(line);
        }
    }
}

impl fmt::Display for Shaped {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { per_step, per_breakpoint, begin_line, line, line_core_xy } = self;
        write!(
            out,
            "{{\"per_step\": {per_step}, \"per_breakpoint\": {per_breakpoint}, \"begin_line\": {begin_line}, "
        )?;
        write!(out, "\"line\": {line}, \"line_core_xy\": {line_core_xy}}}")
    }
}
