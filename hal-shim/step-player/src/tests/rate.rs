//! Minimum distance of events, with the interrupt's own run time, its latency, and hold-ups.
//!
//! A late reload value repeats a gap, so the intervals here change all the time, and every edge is
//! compared with its plan.

use super::model::{CYCLES_A_TICK, Interrupt, SIGNALS};
use crate::*;
use ferrostep_planner::StepEntry;
use ferrostep_planner::{StepLedger, StepObserver};

/// Maximum number of cycles between an update and the end of its interrupt.
const MAX_CYCLES: u64 = MIN_GAP_TICKS as u64 * CYCLES_A_TICK;

/// Cycles from the handler's last instruction to the interrupted code.
const LEAVE_CYCLES: u64 = 10;

/// A small seeded generator.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % bound
    }
}

/// Planned times of the steps, ticks from the start.
#[derive(Default)]
struct Due(Vec<u64>);

impl StepObserver for Due {
    fn stepped(&mut self, tick: u64, _: u8, _: u8) {
        self.0.push(tick);
    }
}

/// Delays of the interrupt.
#[derive(Clone, Copy)]
struct Delays {
    /// Maximum number of cycles from an update to the interrupt's first instruction.
    most_entry: u64,
    /// Cycles before each of its accesses to the timer; the edge comes before the second, the
    /// reload value after it.
    access: u64,
    /// Maximum hold-up, cycles; on average every fiftieth interrupt is held up.
    most_held_up: u64,
}

struct Outcome {
    /// Delays of the steps relative to their planned times, cycles, in order.
    late: Vec<i64>,
    /// Shortest time between two edges of the signal, cycles.
    shortest_level: u64,
    missed: u16,
}

/// Steps with intervals that change from one to the next.
fn changing(random: &mut Random, shortest: u32) -> Vec<StepEntry> {
    let stair = |interval, count| StepEntry::stair(interval, count, 1, 0).unwrap();
    let mut entries = Vec::new();
    for _ in 0..6_000 {
        entries.push(match random.below(4) {
            0 => stair(shortest, 1 + random.below(9) as u16),
            1 => stair(shortest + random.below(30) as u32, 1),
            2 => stair(4_200 + random.below(4_000) as u32, 1),
            _ => stair(4_200, 1 + random.below(9) as u16),
        });
    }
    entries
}

/// Plays entries, and compares the steps with their plan.
fn run<M: Stepping + 'static>(entries: &[StepEntry], signals: Signals, delays: Delays) -> Outcome {
    let board = Interrupt::<M, 1, 2048>::leaked();
    let timer = &board.timer;
    timer.wire_update_count(true);
    timer.set_access_cycles(delays.access);
    let mut feeder = board.feeder(signals);
    let (mut plain, mut due) = (StepLedger::default(), Due::default());
    entries.iter().for_each(|entry| plain.play(*entry, &mut due));
    let mut random = Random(7);
    let mut left = entries.iter();
    let (mut started, mut chained, mut missed) = (false, false, 0);
    while left.len() > 0 || feeder.waiting() > 0 {
        while feeder.room() > 0 && left.len() > 0 {
            feeder.push(*left.next().unwrap()).unwrap();
        }
        if left.len() == 0 {
            feeder.seal();
        }
        started = started || board.start(&mut feeder);
        timer.next_update();
        if random.below(50) == 0 {
            timer.pass(random.below(delays.most_held_up + 1));
        }
        // From one interrupt straight into the next (tail-chaining) takes 6 cycles.
        timer.pass(if chained { 6 } else { 12 + random.below(delays.most_entry - 11) });
        board.call();
        missed = feeder.missed_updates(timer.update_count()).max(missed);
        chained = timer.is_called();
        timer.pass(if chained { 0 } else { LEAVE_CYCLES });
    }
    let changes = board.ports[0].changes();
    let is_step = |(_, level, _): &&(u64, u16, u16)| M::EVENTS_A_STEP == 1 || level & 1 == 1;
    let steps: Vec<u64> = changes.iter().filter(is_step).map(|(now, ..)| *now).collect();
    assert_eq!(steps.len(), due.0.len(), "steps were lost, or doubled");
    let first_due = due.0[0];
    let late = steps.iter().zip(&due.0);
    let late = late.map(|(step, due)| (step - steps[0]) as i64 - ((due - first_due) * CYCLES_A_TICK) as i64).collect();
    let shortest_level = changes.windows(2).map(|pair| pair[1].0 - pair[0].0).min().unwrap();
    Outcome { late, shortest_level, missed }
}

/// Checks that no edge deviates from its plan by more than the latencies of the entries differ,
/// whatever the intervals are.
fn assert_on_time<M: Stepping + 'static>(delays: Delays) {
    let entries = changing(&mut Random(1), 2 * MIN_GAP_TICKS);
    let signals = Signals { pulse_ticks: MIN_GAP_TICKS, direction_setup_ticks: MIN_GAP_TICKS };
    let jitter = delays.most_entry - 12;
    for signals in [signals, Signals { pulse_ticks: 120, ..signals }] {
        let entries = if signals.pulse_ticks == 120 { &changing(&mut Random(2), 240) } else { &entries };
        let outcome = run::<M>(entries, signals, delays);
        let most = outcome.late.iter().map(|late| late.unsigned_abs()).max().unwrap();
        assert!(most <= jitter, "{most} cycles off the plan");
        let shortest = u64::from(if M::EVENTS_A_STEP == 1 { 2 * MIN_GAP_TICKS } else { signals.pulse_ticks });
        let kept = shortest * CYCLES_A_TICK - jitter;
        assert!(outcome.shortest_level >= kept, "a level of {} cycles", outcome.shortest_level);
        assert_eq!(outcome.missed, 0);
    }
}

#[test]
fn with_any_latency_up_to_the_bound_every_edge_is_on_time() {
    for (most_entry, access) in [(12, 0), (12, 14), (16, 22), (30, 22), (MAX_CYCLES - 2 * 22 - LEAVE_CYCLES, 22)] {
        let delays = Delays { most_entry, access, most_held_up: 0 };
        assert_on_time::<BothEdges>(delays);
        assert_on_time::<Pulses>(delays);
    }
}

#[test]
fn a_reload_value_beyond_the_bound_is_late() {
    let entries = changing(&mut Random(1), 2 * MIN_GAP_TICKS);
    let signals = Signals { pulse_ticks: MIN_GAP_TICKS, direction_setup_ticks: MIN_GAP_TICKS };
    // The same for every event: all edges would be on time if their reload values were.
    let delays = Delays { most_entry: 12, access: MAX_CYCLES / 2, most_held_up: 0 };
    let outcome = run::<Pulses>(&entries, signals, delays);
    let most = outcome.late.iter().map(|late| late.unsigned_abs()).max().unwrap();
    assert!(most > MAX_CYCLES, "the test above could not fail");
}

#[test]
fn one_event_a_gap_is_sustained_at_the_bound() {
    // A million events a second.
    let entries = vec![StepEntry::stair(MIN_GAP_TICKS, 30_000, 1, 0).unwrap(); 2];
    let signals = Signals { pulse_ticks: MIN_GAP_TICKS, direction_setup_ticks: MIN_GAP_TICKS };
    let delays = Delays { most_entry: MAX_CYCLES - 2 * 30 - LEAVE_CYCLES, access: 30, most_held_up: 0 };
    let outcome = run::<BothEdges>(&entries, signals, delays);
    assert_eq!((outcome.late.len(), outcome.missed), (60_000, 0));
    assert!(outcome.late.iter().all(|late| late.unsigned_abs() <= delays.most_entry - 12));
}

/// Holds the interrupt up for as many as ten intervals. Every missed update delays all later steps
/// by the gap that the timer repeats; no step is lost, and apart from latency none comes closer to
/// the one before than planned.
#[test]
fn an_interrupt_that_is_held_up_delays_steps_and_never_hurries_them() {
    let delays = Delays { most_entry: 16, access: 14, most_held_up: 3_000 };
    for outcome in [
        run::<BothEdges>(&[StepEntry::stair(168, 30_000, 1, 0).unwrap()], SIGNALS, delays),
        run::<Pulses>(&[StepEntry::stair(168, 30_000, 1, 0).unwrap()], SIGNALS, delays),
    ] {
        assert!(outcome.missed > 100, "{}", outcome.missed);
        assert!(outcome.late.iter().all(|late| *late >= -4), "a step came early");
        assert!(outcome.late.last() > Some(&(100 * 168)), "{:?}", outcome.late.last());
    }
}
