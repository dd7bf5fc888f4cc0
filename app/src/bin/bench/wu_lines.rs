//! The lines of Wu 2024, tables 1 to 5, from end point to entries in the step queue, three ways.

use core::hint::black_box;

use ferrostep_planner::bresenham::StepBresenham;
use ferrostep_planner::{StepEntry, StepSink};

use crate::counter::Counter;
use crate::queue::PrintQueue;
use crate::report::Line;

/// Name and steps of X and Y, from (0, 0).
const LINES: [(&str, u32, u32); 5] =
    [("x3", 30, 10), ("x10", 100, 10), ("x50", 500, 10), ("x100", 1000, 10), ("x1", 30, 30)];

const X: u8 = 1;
const Y: u8 = 2;

/// Ticks between steps; any number would do.
const INTERVAL_TICKS: u32 = 8400;

/// All lines, all three ways. The queue is empty before and after.
pub fn measure(counter: &Counter, queue: &mut PrintQueue) -> Result<heapless::Vec<Line, 5>, &'static str> {
    let mut lines = heapless::Vec::new();
    for (name, dx, dy) in LINES {
        let mut count = |draw: fn(u32, u32, &mut PrintQueue)| {
            let (dx, dy) = (black_box(dx), black_box(dy));
            let instructions = counter.count(|| draw(dx, dy, queue)).0;
            queue.empty();
            // Entries are told by one build of this program only.
            let is_whole = queue.take_tally().events == dx || !cfg!(feature = "tally");
            if is_whole { Ok(instructions) } else { Err("a line has lost steps") }
        };
        let (classic, classic_coalesced) = (count(classic)?, count(classic_coalesced)?);
        let line = Line { name, classic, classic_coalesced, step: count(step)? };
        lines.push(line).map_err(|_| "too many lines")?;
    }
    Ok(lines)
}

#[inline]
fn push(queue: &mut PrintQueue, count: u32, axes: u8, added: u8) {
    if let Some(entry) = StepEntry::stair(INTERVAL_TICKS, count as u16, axes, added) {
        queue.entry(entry);
    }
}

/// The axes that step next by Wu 2024 eq. 3, `decision` going with them.
#[inline]
fn next_axes(decision: &mut i32, dx: i32, dy: i32) -> u8 {
    if *decision > 0 {
        *decision += 2 * (dy - dx);
        X | Y
    } else {
        *decision += 2 * dy;
        X
    }
}

/// An entry a step.
#[inline(never)]
fn classic(dx: u32, dy: u32, queue: &mut PrintQueue) {
    let (dx, dy) = (dx as i32, dy as i32);
    let mut decision = 2 * dy - dx;
    for _ in 0..dx {
        push(queue, 1, next_axes(&mut decision, dx, dy), 0);
    }
}

/// An entry a run of equal steps.
#[inline(never)]
fn classic_coalesced(dx: u32, dy: u32, queue: &mut PrintQueue) {
    let (dx, dy) = (dx as i32, dy as i32);
    let mut decision = 2 * dy - dx;
    let (mut run_axes, mut run) = (X, 0);
    for _ in 0..dx {
        let axes = next_axes(&mut decision, dx, dy);
        if axes != run_axes {
            push(queue, run, run_axes, 0);
            (run_axes, run) = (axes, 0);
        }
        run += 1;
    }
    push(queue, run, run_axes, 0);
}

/// An entry a stair.
#[inline(never)]
fn step(dx: u32, dy: u32, queue: &mut PrintQueue) {
    let Some(line) = StepBresenham::new(dx, dy) else { return };
    let mut left = dx;
    for width in line.stairs() {
        push(queue, width, X, Y);
        left -= width;
    }
    push(queue, left, X, 0);
}
