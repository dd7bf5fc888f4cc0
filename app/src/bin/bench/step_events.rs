//! The step interrupt, event by event.

use ferrostep_planner::{StepEntry, StepSink};

use crate::counter::Counter;
use crate::queue::BenchQueue;
use crate::report::{Events, Mean, StepEvents};

/// Events of a stair.
const STAIR_EVENTS: u16 = 5;

/// Stairs of a run.
const STAIRS: usize = 16;

/// Fetches until the run is counted: the player is ahead of the pins.
const WARM_UP_FETCHES: usize = 4;

/// Ticks between events: too long for the handler to stay for the next one.
const INTERVAL_TICKS: u32 = 84_000;

/// Events of made-up stairs, and a look at the empty queue.
pub fn synthetic(counter: &Counter, queue: &mut BenchQueue) -> Result<StepEvents, &'static str> {
    let one_axis = stairs(counter, queue, 0b0001)?;
    let four_axes = stairs(counter, queue, 0b1111)?;
    // The handler leaves after every event and writes one port.
    let none = Events::default();
    let (staying, two_ports, three_ports) = (none, none, none);
    let idle = queue.play(counter).instructions;
    Ok(StepEvents { one_axis, four_axes, staying, two_ports, three_ports, idle, mean: Mean::default(), worst: 0 })
}

/// Stairs of one kind: the most instructions of an event of each sort, once the run is under way.
fn stairs(counter: &Counter, queue: &mut BenchQueue, axes: u8) -> Result<Events, &'static str> {
    let entry = StepEntry::stair(INTERVAL_TICKS, STAIR_EVENTS, axes, 0).ok_or("a stair without events")?;
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
            let most = if event.is_new { &mut events.new } else { &mut events.within };
            *most = (*most).max(Some(event.instructions));
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
