//! The step interrupt, event by event.

use ferrostep_planner::{StepEntry, StepSink};

use crate::counter::Counter;
use crate::queue::BenchQueue;
use crate::report::{Events, Mean, StepEvents};

/// Events of a stair.
const STAIR_EVENTS: u16 = 5;

/// Stairs of a run.
const STAIRS: usize = 16;

/// One motor, and all four.
const ONE_AXIS: u8 = 0b0001;
const FOUR_AXES: u8 = 0b1111;

/// Fetches until the run is counted: the player is ahead of the pins.
const WARM_UP_FETCHES: usize = 4;

/// Ticks between events: too long for the handler to stay for the next one.
const INTERVAL_TICKS: u32 = 84_000;

/// Events of made-up stairs, and a look at the empty queue.
pub fn synthetic(counter: &Counter, queue: &mut BenchQueue) -> Result<StepEvents, &'static str> {
    let one_axis = stairs(counter, queue, ONE_AXIS, STAIR_EVENTS)?;
    let four_axes = stairs(counter, queue, FOUR_AXES, STAIR_EVENTS)?;
    let single = stairs(counter, queue, FOUR_AXES, 1)?.new;
    // The handler leaves after every event and writes one port.
    let none = Events::default();
    let (staying, two_ports, three_ports) = (none, none, none);
    let idle = queue.play(counter).instructions;
    Ok(StepEvents {
        one_axis,
        four_axes,
        staying,
        two_ports,
        three_ports,
        single,
        idle,
        mean: Mean::default(),
        worst: 0,
    })
}

/// Stairs of one kind, once the run is under way. Inside a stair one event may have more to do, to prepare the next
/// stair: the least of the others is that of most.
fn stairs(counter: &Counter, queue: &mut BenchQueue, axes: u8, events: u16) -> Result<Events, &'static str> {
    let entry = StepEntry::stair(INTERVAL_TICKS, events, axes, 0).ok_or("a stair without events")?;
    for _ in 0..STAIRS {
        queue.entry(entry);
    }
    queue.start();
    let mut events = Events::default();
    let mut fetches = 0;
    while queue.is_busy() {
        let event = queue.play(counter);
        fetches += usize::from(event.is_new);
        if fetches >= WARM_UP_FETCHES && queue.waiting() > 0 {
            let count = Some(event.instructions);
            if event.is_new {
                events.new = events.new.max(count);
            } else {
                events.within = events.within.map(|least| least.min(event.instructions)).or(count);
                events.most_within = events.most_within.max(count);
            }
        }
    }
    Ok(events)
}

/// Plays what waits in the queue, all but the last entry's end, so that the queue never runs dry.
pub fn play_waiting(counter: &Counter, queue: &BenchQueue, report: &mut StepEvents) {
    queue.start();
    while queue.waiting() > 0 {
        let event = queue.play(counter);
        report.mean.add(event.instructions, 1);
        report.worst = report.worst.max(event.instructions);
    }
}
