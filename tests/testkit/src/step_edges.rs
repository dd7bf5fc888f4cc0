//! The edges that a trace's steps make on the pins of a board whose step interrupt is as
//! late as it may be.
//!
//! Every step event becomes a separate slot, the slowest case for the interrupt. It is played on
//! the timer's model with preload: the interrupt comes right after the update or as late as it can,
//! by chance, so that neighbouring edges come as near each other as possible.

use std::cell::Cell;

use ferrostep_oracle::trace::StepEvent;
use ferrostep_planner::StepEntry;
use ferrostep_step_player::{
    FeedError, MIN_GAP_TICKS, NextWords, OutputPorts, PinMap, Signals, StepFeeder, StepPlayer, Stepping,
};
use ferrostep_virtual_board::{CYCLES_A_TICK, VirtualPort, VirtualUpdateTimer};

/// Cycles from an update to the interrupt's first instruction, at the least.
pub const FIRST_ENTRY_CYCLES: u64 = 12;

/// Slots of the ring.
const SLOTS: usize = 2048;

/// Step pins of the model's port.
const STEP_PINS: u16 = 0b1111;

/// The delays of the step interrupt.
#[derive(Clone, Copy, Debug)]
pub struct Lateness {
    /// Cycles from an update to the arrival of the reload value, at the most.
    pub reload_cycles: u64,
    /// Part of these cycles from the interrupt's first instruction on.
    pub handler_cycles: u64,
}

/// Measures of the pins' edges. Times are in cycles of the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edges {
    /// Step events in the trace.
    pub events: u64,
    /// Moments at which step pins changed.
    pub edges: u64,
    /// The shortest time for which a step pin kept a level.
    pub smallest_pulse_cycles: u64,
    /// The shortest time between two moments at which any step pins changed.
    pub smallest_gap_cycles: u64,
    /// The greatest delay of a stepping edge after its planned time.
    pub largest_lateness_cycles: u64,
    /// Updates of the timer that the interrupt missed.
    pub missed_updates: u64,
}

/// A port that keeps the times of its pins.
struct Port<'a> {
    timer: &'a VirtualUpdateTimer,
    level: Cell<u16>,
    changed_at: Cell<[Option<u64>; 4]>,
    edges: Cell<u64>,
    last_edge: Cell<Option<u64>>,
    pulse: Cell<u64>,
    gap: Cell<u64>,
    /// Moment of the newest step, not yet compared with its plan.
    step: Cell<Option<u64>>,
    both_edges: bool,
}

impl OutputPorts<1> for Port<'_> {
    fn write(&self, _port: usize, word: u32) {
        let before = self.level.get();
        let level = before & !((word >> 16) as u16) | word as u16;
        self.level.set(level);
        let changed = (level ^ before) & STEP_PINS;
        if changed == 0 {
            return;
        }
        let now = self.timer.now_cycles();
        let mut changed_at = self.changed_at.get();
        for (_, at) in changed_at.iter_mut().enumerate().filter(|(pin, _)| changed >> pin & 1 == 1) {
            if let Some(before) = at.replace(now) {
                self.pulse.set(self.pulse.get().min(now - before));
            }
        }
        self.changed_at.set(changed_at);
        if let Some(last) = self.last_edge.replace(Some(now)) {
            self.gap.set(self.gap.get().min(now - last));
        }
        self.edges.set(self.edges.get() + 1);
        if self.both_edges || level & changed != 0 {
            self.step.set(Some(now));
        }
    }
}

/// A small generator, seeded: the same edges each time.
struct Chance(u64);

impl Chance {
    fn coin(&mut self) -> bool {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 63 == 1
    }
}

/// The entries of a step event, from the tick of the one before on.
fn entries(event: &StepEvent, last_tick: u64, directions: u8, mut take: impl FnMut(StepEntry)) {
    if event.directions != directions {
        take(StepEntry::directions(event.directions));
    }
    let mut interval = event.tick - last_tick;
    // Far below the longest interval of the queue, and far above the shortest.
    const LONG: u64 = 1 << 30;
    while interval > 2 * LONG {
        take(StepEntry::wait(LONG as u32));
        interval -= LONG;
    }
    take(StepEntry::stair(interval as u32, 1, event.axes, 0).unwrap_or(StepEntry::wait(interval as u32)));
}

/// Plays the step events of a trace, in order; `M` is how the profile's drivers step.
///
/// # Errors
/// Two events are nearer to each other than the step interrupt allows.
pub fn play<M: Stepping>(
    events: impl IntoIterator<Item = StepEvent>,
    pulse_ticks: u32,
    lateness: Lateness,
) -> Result<Edges, FeedError> {
    let player = Box::new(StepPlayer::<M, 1, SLOTS>::new());
    let timer = VirtualUpdateTimer::default();
    timer.wire_update_count(true);
    // The edge comes after the first access, the reload value after the second.
    timer.set_access_cycles(lateness.handler_cycles / 2);
    let most_entry = lateness.reload_cycles - lateness.handler_cycles;
    let port = Port {
        timer: &timer,
        level: Cell::new(0),
        changed_at: Cell::default(),
        edges: Cell::new(0),
        last_edge: Cell::new(None),
        pulse: Cell::new(u64::MAX),
        gap: Cell::new(u64::MAX),
        step: Cell::new(None),
        both_edges: M::EVENTS_A_STEP == 1,
    };
    let pins: PinMap<1> = VirtualPort::pins();
    let signals = Signals { pulse_ticks, direction_setup_ticks: MIN_GAP_TICKS };
    let mut feeder = StepFeeder::new(&player, pins, signals);
    let (mut next, mut chance) = (NextWords::NONE, Chance(1));
    let mut events = events.into_iter().peekable();
    // Steps in the queue that have not reached the pins.
    let mut planned = std::collections::VecDeque::new();
    let (mut last_tick, mut directions, mut count) = (0, 0, 0);
    let (mut offset, mut largest, mut missed_updates) = (None, 0, 0);
    let mut sealed = false;
    loop {
        while feeder.room() > 8 && events.peek().is_some() {
            let Some(event) = events.next() else { break };
            let mut refused = None;
            entries(&event, last_tick, directions, |entry| refused = refused.or(feeder.push(entry).err()));
            if let Some(error) = refused {
                return Err(error);
            }
            planned.push_back(event.tick * CYCLES_A_TICK);
            (last_tick, directions) = (event.tick, event.directions);
            count += 1;
        }
        if events.peek().is_none() && !sealed {
            feeder.seal();
            sealed = true;
        }
        if feeder.start() {
            player.start_or_end(&mut next, &timer);
        }
        if sealed && feeder.waiting() == 0 {
            break;
        }
        timer.next_update();
        timer.pass(if chance.coin() { FIRST_ENTRY_CYCLES } else { most_entry });
        if timer.is_called() {
            timer.interrupt(&player, &mut next, &port);
        }
        missed_updates += u64::from(feeder.missed_updates(timer.update_count()));
        if let Some(at) = port.step.take()
            && let Some(due) = planned.pop_front()
        {
            // The first edge sets the clock; it may have been late itself.
            let offset = *offset.get_or_insert(at as i64 - due as i64);
            largest = (at as i64 - due as i64 - offset).unsigned_abs().max(largest);
        }
    }
    Ok(Edges {
        events: count,
        edges: port.edges.get(),
        smallest_pulse_cycles: port.pulse.get(),
        smallest_gap_cycles: port.gap.get(),
        largest_lateness_cycles: largest,
        missed_updates,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use ferrostep_step_player::{BothEdges, Pulses};

    const LATENESS: Lateness = Lateness { reload_cycles: 128, handler_cycles: 56 };

    /// Steps of two motors back and forth at changing intervals.
    fn events(shortest: u64) -> Vec<StepEvent> {
        let mut tick = 1_000_000;
        (0..4_000u64)
            .map(|number| {
                tick += if number % 3 == 0 { shortest } else { shortest + number % 97 * 20 };
                StepEvent { tick, axes: 1 + (number % 3) as u8, directions: (number / 500 % 2) as u8 }
            })
            .collect()
    }

    #[test]
    fn levels_and_gaps_are_those_planned_less_the_latest_entry() {
        let jitter = LATENESS.reload_cycles - LATENESS.handler_cycles - FIRST_ENTRY_CYCLES;
        let pulses = play::<Pulses>(events(168), 84, LATENESS).unwrap();
        assert_eq!((pulses.events, pulses.missed_updates), (4_000, 0));
        assert_eq!(pulses.smallest_pulse_cycles, 168 - jitter);
        assert_eq!(pulses.smallest_gap_cycles, 168 - jitter);
        assert_eq!(pulses.largest_lateness_cycles, jitter);
        let edges = play::<BothEdges>(events(168), 84, LATENESS).unwrap();
        assert_eq!((edges.edges, edges.smallest_gap_cycles), (4_000, 336 - jitter));
        assert_eq!((edges.largest_lateness_cycles, edges.missed_updates), (jitter, 0));
    }

    #[test]
    fn a_reload_value_that_is_too_late_shows() {
        let late = Lateness { reload_cycles: 228, handler_cycles: 56 };
        let pulses = play::<Pulses>(events(168), 84, late).unwrap();
        assert!(pulses.largest_lateness_cycles > 1_000, "{pulses:?}");
    }

    #[test]
    fn steps_that_are_too_near_are_refused() {
        assert_eq!(play::<Pulses>(events(167), 84, LATENESS), Err(FeedError::TooNear));
    }
}
