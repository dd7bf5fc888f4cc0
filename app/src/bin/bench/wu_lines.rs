//! The lines of Wu 2024, tables 1 to 5, and lines of every slope, from end point to entries in the step queue, three
//! ways.

use core::hint::black_box;

use ferrostep_hal_shim::stepping::Stepping;
#[cfg(feature = "tally")]
use ferrostep_planner::bresenham::Counted;
#[cfg(not(feature = "tally"))]
use ferrostep_planner::bresenham::Uncounted;
use ferrostep_planner::bresenham::{Classic, FromFirstStair, FromQuotient, Slope, Stairs, StepBresenham, Widths};
use ferrostep_planner::{StepEntry, StepSink};

use crate::counter::Counter;
use crate::queue::{BenchQueue, LINE_QUEUE_SLOTS, LineQueues};
use crate::report::{LineCost, Lines, SlopeLine, WuLine};

/// Name and steps of X and Y, from (0, 0).
const LINES: [(&str, u32, u32); 5] =
    [("x3", 30, 10), ("x10", 100, 10), ("x50", 500, 10), ("x100", 1000, 10), ("x1", 30, 30)];

/// X of the lines of every slope.
const SLOPE_X: u32 = 100;

/// Their Y.
const SLOPES_Y: [u32; 23] = [0, 1, 2, 3, 5, 10, 15, 20, 25, 30, 33, 40, 45, 50, 51, 55, 60, 70, 80, 90, 95, 99, 100];

const X: u8 = 1;
const Y: u8 = 2;

/// Ticks between steps; any number would do.
const INTERVAL_TICKS: u32 = 8400;

/// Entries that go to the queue together.
const BATCH: usize = 32;

/// Entries on their way to a queue, which takes several at once for less than it takes them one by one. All ways to draw
/// a line push like this.
struct Batch<'a, M: 'static> {
    queue: &'a mut BenchQueue<M, 1, LINE_QUEUE_SLOTS>,
    entries: [StepEntry; BATCH],
}

impl<'a, M: Stepping> Batch<'a, M> {
    fn new(queue: &'a mut BenchQueue<M, 1, LINE_QUEUE_SLOTS>) -> Self {
        Self { queue, entries: [StepEntry::wait(0); BATCH] }
    }

    /// Adds an entry to those that wait, of which there are `waiting`. How many there are then.
    #[inline(always)]
    fn push(&mut self, waiting: usize, entry: StepEntry) -> usize {
        self.entries[waiting % BATCH] = entry;
        let waiting = waiting.wrapping_add(1);
        if waiting < BATCH {
            return waiting;
        }
        self.flush_full();
        0
    }

    /// Adds so many entries to none. How many wait then, fewer than [`BATCH`].
    #[inline(always)]
    fn fill(&mut self, mut left: u32, mut next: impl FnMut() -> StepEntry) -> usize {
        loop {
            let mut places = self.entries.iter_mut();
            while let Some(place) = places.next() {
                if left == 0 {
                    return BATCH.wrapping_sub(places.len()).wrapping_sub(1);
                }
                left = left.wrapping_sub(1);
                *place = next();
            }
            self.flush_full();
        }
    }

    /// As [`Self::push`], equal steps, if any.
    #[inline(always)]
    fn push_run(&mut self, waiting: usize, count: u32, axes: u8) -> usize {
        match StepEntry::stair(INTERVAL_TICKS, count as u16, axes, 0) {
            Some(run) => self.push(waiting, run),
            None => waiting,
        }
    }

    /// Takes a whole batch to the queue.
    #[cold]
    #[inline(never)]
    fn flush_full(&mut self) {
        self.flush(BATCH);
    }

    /// Takes those that wait to the queue.
    #[inline(always)]
    fn flush(&mut self, waiting: usize) {
        self.queue.entries(self.entries.get(..waiting).unwrap_or_default());
    }
}

/// The build that counts entries counts decisions as well.
#[cfg(feature = "tally")]
type Told = Counted;
#[cfg(not(feature = "tally"))]
type Told = Uncounted;

/// A way to draw a line; how many decisions it took.
type Draw<M> = fn(Slope, &mut Batch<'_, M>) -> u64;

/// All lines, all ways. The queues are empty before and after.
pub fn measure(counter: &Counter, queues: &mut LineQueues, lines: &mut Lines) -> Result<(), &'static str> {
    wu_lines(counter, &mut Batch::new(&mut queues.edges), &mut lines.wu)?;
    wu_lines(counter, &mut Batch::new(&mut queues.pulses), &mut lines.wu_pulses)?;
    let batch = &mut Batch::new(&mut queues.edges);
    for dy in SLOPES_Y {
        let mut cost = |draw| cost(counter, batch, draw, SLOPE_X, dy);
        let line = SlopeLine {
            dx: SLOPE_X,
            dy,
            classic: cost(classic)?,
            classic_coalesced: cost(classic_coalesced)?,
            step: cost(step::<_, FromQuotient<Told>>)?,
        };
        lines.slopes.push(line).map_err(|_| "too many lines")?;
    }
    Ok(())
}

/// Wu's lines.
fn wu_lines<M: Stepping>(
    counter: &Counter,
    batch: &mut Batch<'_, M>,
    lines: &mut heapless::Vec<WuLine, 5>,
) -> Result<(), &'static str> {
    for (name, dx, dy) in LINES {
        let mut cost = |draw| cost(counter, batch, draw, dx, dy);
        let line = WuLine {
            name,
            classic: cost(classic)?,
            classic_coalesced: cost(classic_coalesced)?,
            step: cost(step::<_, FromQuotient<Told>>)?,
            step_first_stair: cost(step::<_, FromFirstStair<Told>>)?,
            step_division: cost(step::<_, StepBresenham>)?,
        };
        lines.push(line).map_err(|_| "too many lines")?;
    }
    Ok(())
}

/// What a line costs.
fn cost<M: Stepping>(
    counter: &Counter,
    batch: &mut Batch<'_, M>,
    draw: Draw<M>,
    dx: u32,
    dy: u32,
) -> Result<LineCost, &'static str> {
    let slope = Slope::new(dx, dy).map_err(|_| "there is no such line")?;
    let (slope, draw) = (black_box(slope), black_box(draw));
    let (instructions, decisions) = counter.count(|| draw(slope, batch));
    batch.queue.empty();
    let tally = batch.queue.take_tally();
    // Entries are told by one build of this program only.
    if tally.events != dx && cfg!(feature = "tally") {
        return Err("a line has lost steps");
    }
    Ok(LineCost { instructions, entries: tally.entries, decisions: decisions as u32 })
}

/// A stair of one step.
#[inline(always)]
fn single(axes: u8, added: u8) -> StepEntry {
    StepEntry::stair(INTERVAL_TICKS, 1, axes, added).unwrap_or(StepEntry::wait(INTERVAL_TICKS))
}

/// Classic Bresenham, an entry a step.
#[inline(never)]
fn classic<M: Stepping>(slope: Slope, batch: &mut Batch<'_, M>) -> u64 {
    let mut line = Classic::<Told>::new(slope);
    let waiting = batch.fill(slope.major(), || single(if line.pass(1) { X | Y } else { X }, 0));
    batch.flush(waiting);
    line.decisions()
}

/// Classic Bresenham, an entry a run of equal steps.
#[inline(never)]
fn classic_coalesced<M: Stepping>(slope: Slope, batch: &mut Batch<'_, M>) -> u64 {
    let mut line = Classic::<Told>::new(slope);
    let (mut waiting, mut run, mut run_steps) = (0, 0u32, false);
    for _ in 0..slope.major() {
        let steps = line.pass(1);
        if steps != run_steps {
            waiting = batch.push_run(waiting, run, if run_steps { X | Y } else { X });
            (run, run_steps) = (0, steps);
        }
        run = run.wrapping_add(1);
    }
    waiting = batch.push_run(waiting, run, if run_steps { X | Y } else { X });
    batch.flush(waiting);
    line.decisions()
}

/// Step Bresenham, an entry a stair.
#[inline(never)]
fn step<M: Stepping, W: Widths>(slope: Slope, batch: &mut Batch<'_, M>) -> u64 {
    let axes = if slope.is_steep() { X | Y } else { X };
    let stair = single(axes, Y);
    let mut stairs = Stairs::<W>::new(slope);
    let waiting = batch.fill(stairs.whole(), || stair.times(stairs.whole_width()));
    let waiting = batch.push_run(waiting, stairs.rest(), axes);
    batch.flush(waiting);
    stairs.decisions()
}
