//! How fast events may follow each other, with the interrupt's own time, its latency, and whatever masks it.
//!
//! The model: 12 cycles to enter, 10 to leave, 6 from one interrupt straight into the next, 1.4 cycles an instruction, of which there are as many as
//! `cargo xtask bench` counts. It is a model until silicon confirms it.

use super::model::{CYCLES_A_TICK, Interrupt};
use crate::stepping::*;
use ferrostep_planner::StepEntry;

const ENTER_CYCLES: u64 = 12;
const LEAVE_CYCLES: u64 = 10;
/// From one interrupt straight into the next (tail-chaining).
const CHAIN_CYCLES: u64 = 6;

/// A small generator, seeded.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % bound
    }
}

struct Outcome {
    /// By how many ticks each edge was late, the smallest first.
    late_ticks: Vec<u64>,
    /// Of the last event.
    last_late_ticks: u64,
    made_up: u32,
}

type Board = Interrupt<BothEdges, 1, 2048>;

/// What the planner task does about missed updates: in the middle of an interval it calls the interrupt.
fn make_up(board: &Board, feeder: &StepFeeder<'_, BothEdges, 1, 2048>) -> u32 {
    // Whatever is due comes first.
    while board.timer.is_called() {
        board.call();
    }
    let missed = feeder.missed_updates(board.timer.update_count());
    for _ in 0..missed {
        board.timer.pass(10);
        board.player.link().owe();
        board.stay();
    }
    u32::from(missed)
}

/// Plays `steps` steps at one interval; now and then something masks the interrupt for up to `most_masked` cycles.
fn run(interval_ticks: u32, steps: u32, most_latency: u64, most_masked: u64, is_counter_wired: bool) -> Outcome {
    let board = Board::leaked();
    let timer = &board.timer;
    timer.wire_update_count(is_counter_wired);
    // An event within a stair takes 15 instructions or so in two accesses, a new stair twice as many in three.
    timer.set_access_cycles(9);
    let mut feeder = board.feeder(Signals { pulse_ticks: 8, direction_setup_ticks: 8 });
    let mut random = Random(1);
    let mut left = steps;
    let (mut unmasked_at, mut visit_at, mut made_up) = (0, 0, 0);
    let (mut started, mut chained) = (false, false);
    while left > 0 || feeder.waiting() > 0 {
        while left > 0 && feeder.room() > 0 {
            let count = (1 + random.below(64) as u32).min(left);
            feeder
                .push(StepEntry::stair(interval_ticks, count as u16, 1 + random.below(15) as u8, 0).unwrap())
                .unwrap();
            left -= count;
        }
        if left == 0 {
            feeder.seal();
        }
        if !started {
            board.start(&mut feeder);
            started = true;
        }
        timer.next_update();
        // The planner task comes every millisecond.
        if is_counter_wired && timer.now_cycles() >= visit_at {
            visit_at = timer.now_cycles() + 168_000;
            made_up += make_up(board, &feeder);
            continue;
        }
        // The end shows what is left of it all.
        let is_near_end = left == 0 && feeder.waiting() < 400;
        if random.below(50) == 0 && !is_near_end {
            unmasked_at = timer.now_cycles() + random.below(most_masked + 1);
        }
        timer.pass_to(unmasked_at.max(timer.now_cycles()));
        timer.pass(if chained { CHAIN_CYCLES } else { ENTER_CYCLES + random.below(most_latency + 1) });
        board.call();
        chained = timer.is_called();
        timer.pass(if chained { 0 } else { LEAVE_CYCLES });
    }
    let changes = board.ports[0].changes();
    assert_eq!(changes.len() as u32, steps, "steps were lost, or joined");
    // The clock is the updates': all of one interval after the first step's.
    let interval = u64::from(interval_ticks) * CYCLES_A_TICK;
    let start = changes.iter().enumerate().map(|(k, (now, ..))| now - k as u64 * interval).min().unwrap();
    let mut late_ticks: Vec<_> =
        changes.iter().enumerate().map(|(k, (now, ..))| (now - start - k as u64 * interval) / CYCLES_A_TICK).collect();
    let last_late_ticks = *late_ticks.last().unwrap();
    late_ticks.sort_unstable();
    Outcome { late_ticks, last_late_ticks, made_up }
}

/// The most ticks that an edge is late at four million events a second by the interrupt's own work alone.
const OWN_LATENESS_TICKS: u64 = 14;

#[test]
fn sixty_thousand_steps_at_four_million_a_second_end_on_their_tick() {
    // 21 ticks of 84 MHz.
    let outcome = run(21, 60_000, 6, 0, true);
    assert_eq!((outcome.made_up, outcome.last_late_ticks <= OWN_LATENESS_TICKS), (0, true));
    assert!(outcome.late_ticks.last() <= Some(&OWN_LATENESS_TICKS), "{:?}", outcome.late_ticks.last());
    // Masked for up to three intervals, far longer than anything in the image does.
    let outcome = run(21, 60_000, 6, 120, true);
    assert!(outcome.made_up > 100, "{}", outcome.made_up);
    assert!(outcome.last_late_ticks <= OWN_LATENESS_TICKS, "{}", outcome.last_late_ticks);
}

#[test]
fn a_mask_shorter_than_an_interval_delays_edges_and_loses_nothing() {
    let outcome = run(42, 60_000, 6, 50, true);
    assert_eq!(outcome.made_up, 0);
    assert!(outcome.last_late_ticks <= OWN_LATENESS_TICKS, "{}", outcome.last_late_ticks);
    assert!(outcome.late_ticks.last() <= Some(&42), "{:?}", outcome.late_ticks.last());
}

#[test]
fn updates_that_were_missed_are_made_up() {
    // Masked for up to six intervals.
    let outcome = run(84, 60_000, 6, 1_000, true);
    assert!(outcome.made_up > 100, "{}", outcome.made_up);
    assert!(outcome.last_late_ticks <= OWN_LATENESS_TICKS, "{}", outcome.last_late_ticks);
}

#[test]
fn without_the_hardware_s_count_they_cannot_be() {
    let outcome = run(84, 60_000, 6, 1_000, false);
    assert_eq!(outcome.made_up, 0);
    assert!(outcome.last_late_ticks > 84, "the test above could not fail");
}
