//! The lines of Wu 2024, tables 1 to 5, and lines of every slope, from end point to entries in the
//! step queue, three ways.

use core::hint::black_box;

#[cfg(feature = "tally")]
use ferrostep_papers::bresenham::Counted;
#[cfg(not(feature = "tally"))]
use ferrostep_papers::bresenham::Uncounted;
use ferrostep_papers::bresenham::{Classic, FromDivision, FromFirstStair, FromQuotient, Slope, Stairs, Widths};
use ferrostep_planner::StepEntry;
use ferrostep_step_player::Stepping;

use crate::queue::{LineQueue, LineQueues};
use crate::report::{LineCost, Lines, SlopeLine, WuLine};
use crate::span::Counter;

/// Name and steps of X and Y, from (0, 0).
const LINES: [(&str, u32, u32); 5] =
    [("x3", 30, 10), ("x10", 100, 10), ("x50", 500, 10), ("x100", 1000, 10), ("x1", 30, 30)];

/// X of the lines of every slope.
const SLOPE_X: u32 = 100;

/// Y of the slopes.
const SLOPES_Y: [u32; 23] = [0, 1, 2, 3, 5, 10, 15, 20, 25, 30, 33, 40, 45, 50, 51, 55, 60, 70, 80, 90, 95, 99, 100];

const X: u8 = 1;
const Y: u8 = 2;

/// Ticks between steps; any number would do.
const INTERVAL_TICKS: u32 = 8400;

/// The build that counts entries counts decisions as well.
#[cfg(feature = "tally")]
type Told = Counted;
#[cfg(not(feature = "tally"))]
type Told = Uncounted;

/// Function that draws a line; returns the number of its decisions.
type Draw<M> = fn(Slope, &mut LineQueue<M>) -> u64;

/// All lines, all ways. The queues are empty before and after.
pub fn measure(counter: &Counter, queues: &mut LineQueues, lines: &mut Lines) -> Result<(), &'static str> {
    wu_lines(counter, &mut queues.edges, &mut lines.wu)?;
    wu_lines(counter, &mut queues.pulses, &mut lines.wu_pulses)?;
    for dy in SLOPES_Y {
        let mut cost = |draw| cost(counter, &mut queues.edges, draw, SLOPE_X, dy);
        let line = SlopeLine {
            dx: SLOPE_X,
            dy,
            classic: cost(classic)?,
            classic_coalesced: cost(classic_coalesced)?,
            step: cost(step::<_, FromDivision>)?,
        };
        lines.slopes.push(line).map_err(|_| "too many lines")?;
    }
    Ok(())
}

/// Wu's lines.
fn wu_lines<M: Stepping>(
    counter: &Counter,
    queue: &mut LineQueue<M>,
    lines: &mut heapless::Vec<WuLine, 5>,
) -> Result<(), &'static str> {
    for (name, dx, dy) in LINES {
        let mut cost = |draw| cost(counter, queue, draw, dx, dy);
        let line = WuLine {
            name,
            classic: cost(classic)?,
            classic_coalesced: cost(classic_coalesced)?,
            step: cost(step::<_, FromDivision>)?,
            step_first_stair: cost(step::<_, FromFirstStair<Told>>)?,
            step_quotient: cost(step::<_, FromQuotient<Told>>)?,
        };
        lines.push(line).map_err(|_| "too many lines")?;
    }
    Ok(())
}

/// Cost of a line.
fn cost<M: Stepping>(
    counter: &Counter,
    queue: &mut LineQueue<M>,
    draw: Draw<M>,
    dx: u32,
    dy: u32,
) -> Result<LineCost, &'static str> {
    let slope = Slope::new(dx, dy).map_err(|_| "there is no such line")?;
    let (slope, draw) = (black_box(slope), black_box(draw));
    let (instructions, decisions) = counter.count(|| draw(slope, queue));
    queue.empty();
    let tally = queue.take_tally();
    // Only one build of this program reports entries.
    if tally.events != dx && cfg!(feature = "tally") {
        return Err("a line has lost steps");
    }
    Ok(LineCost { instructions, entries: tally.entries, decisions: decisions as u32 })
}

/// Equal steps; `None` for no steps.
#[inline(always)]
fn run(count: u32, axes: u8) -> Option<StepEntry> {
    StepEntry::stair(INTERVAL_TICKS, count as u16, axes, 0)
}

/// A stair of one step.
#[inline(always)]
fn single(axes: u8, added: u8) -> StepEntry {
    StepEntry::stair(INTERVAL_TICKS, 1, axes, added).unwrap_or(StepEntry::wait(INTERVAL_TICKS))
}

/// Classic Bresenham, an entry a step.
#[inline(never)]
fn classic<M: Stepping>(slope: Slope, queue: &mut LineQueue<M>) -> u64 {
    let mut line = Classic::<Told>::new(slope);
    queue.extend((0..slope.major()).map(|_| single(if line.pass(1) { X | Y } else { X }, 0)));
    line.decisions()
}

/// Classic Bresenham, an entry a run of equal steps.
#[inline(never)]
fn classic_coalesced<M: Stepping>(slope: Slope, queue: &mut LineQueue<M>) -> u64 {
    let mut line = Classic::<Told>::new(slope);
    let mut left = slope.major();
    // Part of the run to come that is known.
    let (mut known, mut steps) = (0, false);
    if left > 0 {
        left = left.wrapping_sub(1);
        (known, steps) = (1u32, line.pass(1));
    }
    queue.extend(core::iter::from_fn(|| {
        let (mut count, axes) = (known, if steps { X | Y } else { X });
        while left > 0 {
            left = left.wrapping_sub(1);
            let next = line.pass(1);
            if next != steps {
                (known, steps) = (1, next);
                return run(count, axes);
            }
            count = count.wrapping_add(1);
        }
        known = 0;
        run(count, axes)
    }));
    line.decisions()
}

/// Step Bresenham, an entry a stair.
#[inline(never)]
fn step<M: Stepping, W: Widths>(slope: Slope, queue: &mut LineQueue<M>) -> u64 {
    let axes = if slope.is_steep() { X | Y } else { X };
    let stair = single(axes, Y);
    let mut stairs = Stairs::<W>::new(slope);
    // One more for the run after the last stair.
    let mut left = stairs.whole().wrapping_add(1);
    queue.extend(core::iter::from_fn(|| {
        left = left.checked_sub(1)?;
        if left > 0 { Some(stair.times(stairs.whole_width())) } else { run(stairs.rest(), axes) }
    }));
    stairs.decisions()
}
