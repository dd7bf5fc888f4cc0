//! The step interrupt, event by event.

use ferrostep_planner::{StepEntry, StepSink};
use ferrostep_step_player::Stepping;

use crate::figures::{Events, StepEvents};
use crate::queue::BenchQueue;
use crate::span::Counter;

/// Events of a stair.
pub const STAIR_EVENTS: u16 = 5;

/// Stairs of a run.
const STAIRS: usize = 16;

/// One motor.
const ONE_AXIS: u8 = 0b0001;

/// All motors.
pub const FOUR_AXES: u8 = 0b1111;

/// Fetches until the run is counted.
const WARM_UP_FETCHES: usize = 4;

/// Slots that are left in a queue that is played for a while: without one to fetch
/// it would run dry.
const LEFT_SLOTS: usize = 2;

/// Ticks between events: the handler has long returned when the next one is due.
const INTERVAL_TICKS: u32 = 84_000;

/// Events of made-up stairs, and the two ends of a motion.
pub fn synthetic<M: Stepping, const PORTS: usize, const N: usize>(
    counter: &Counter,
    queue: &mut BenchQueue<M, PORTS, N>,
) -> Result<StepEvents, &'static str> {
    let one_axis = stairs(counter, queue, ONE_AXIS, STAIR_EVENTS)?;
    let four_axes = stairs(counter, queue, FOUR_AXES, STAIR_EVENTS)?;
    let single = stairs(counter, queue, FOUR_AXES, 1)?.new;
    let (start_of_motion, end_of_motion) = ends(counter, queue)?;
    Ok(StepEvents { one_axis, four_axes, single, start_of_motion, end_of_motion, ..StepEvents::default() })
}

/// Stairs of one kind, once the run is under way. If the events inside a stair do not all cost the
/// same, the least of them is taken as that of most.
pub fn stairs<M: Stepping, const PORTS: usize, const N: usize>(
    counter: &Counter,
    queue: &mut BenchQueue<M, PORTS, N>,
    axes: u8,
    events: u16,
) -> Result<Events, &'static str> {
    for _ in 0..STAIRS {
        push(queue, events, axes)?;
    }
    queue.start(counter);
    let mut events = Events::default();
    let mut fetches = 0;
    while queue.is_running() {
        let event = queue.play(counter);
        fetches += usize::from(event.is_new);
        if fetches >= WARM_UP_FETCHES && queue.waiting() > LEFT_SLOTS {
            let count = Some(event.instructions);
            if event.is_new {
                events.new = events.new.max(count);
            } else {
                events.within = events.within.map(|least| least.min(event.instructions)).or(count);
                events.most_within = events.most_within.max(count);
            }
        }
    }
    queue.empty();
    Ok(events)
}

/// Instructions of a motion's start and end: both are interrupts that do more than play an event.
fn ends<M: Stepping, const PORTS: usize, const N: usize>(
    counter: &Counter,
    queue: &mut BenchQueue<M, PORTS, N>,
) -> Result<(u32, u32), &'static str> {
    push(queue, STAIR_EVENTS, ONE_AXIS)?;
    push(queue, STAIR_EVENTS, ONE_AXIS)?;
    let start = queue.start(counter);
    let mut end = 0;
    while queue.is_running() {
        end = queue.play(counter).instructions;
    }
    queue.empty();
    Ok((start, end))
}

fn push<M: Stepping, const PORTS: usize, const N: usize>(
    queue: &mut BenchQueue<M, PORTS, N>,
    events: u16,
    axes: u8,
) -> Result<(), &'static str> {
    queue.entry(StepEntry::stair(INTERVAL_TICKS, events, axes, 0).ok_or("a stair without events")?);
    Ok(())
}

/// Plays the slots that wait in the queue, except for the last ones.
pub fn play_waiting<M: Stepping, const PORTS: usize, const N: usize>(
    counter: &Counter,
    queue: &mut BenchQueue<M, PORTS, N>,
    report: &mut StepEvents,
) {
    // Starting a motion that plays already would end it.
    if !queue.is_running() {
        queue.start(counter);
    }
    while queue.waiting() > LEFT_SLOTS {
        let event = queue.play(counter);
        report.mean.add(event.instructions, 1);
        report.worst = report.worst.max(event.instructions);
    }
}
