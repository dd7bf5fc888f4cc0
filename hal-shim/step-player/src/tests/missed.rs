//! Comparison of the update count with the events played: it yields exactly the updates that the
//! interrupt has missed.

use super::model::{Interrupt, SIGNALS};
use crate::*;
use ferrostep_planner::StepEntry;

type Board<M> = Interrupt<M, 1, 64>;

/// A board whose second timer counts the updates, and has counted some already.
fn board<M: Stepping + 'static>(updates_before: u32) -> (&'static Board<M>, StepFeeder<'static, M, 1, 64>) {
    let board = Board::<M>::leaked();
    board.timer.wire_update_count(true);
    for _ in 0..updates_before {
        board.timer.next_update();
        // The interrupt is not called, because no slot is played.
        board.timer.forget_served();
        board.timer.clear_update();
    }
    (board, board.feeder(SIGNALS))
}

fn stair(interval_ticks: u32, count: u16) -> StepEntry {
    StepEntry::stair(interval_ticks, count, 0b1, 0).unwrap()
}

/// Plays everything that was pushed, on time; returns the largest number of missed updates seen on
/// the way.
fn play<M: Stepping>(board: &Board<M>, feeder: &mut StepFeeder<'_, M, 1, 64>) -> u16 {
    let mut most = 0;
    while feeder.waiting() > 0 {
        board.update();
        most = most.max(feeder.missed_updates(board.timer.update_count()));
    }
    most
}

/// Checks that nothing counts as missed while on time, whatever the count was before, over several
/// motions and past the wrap of the count.
fn assert_none_missed_on_time<M: Stepping + 'static>() {
    for updates_before in [0, 1, 5, 1_000] {
        let (board, mut feeder) = board::<M>(updates_before);
        // Before the first slot no update was missed, whatever the count is.
        assert_eq!(feeder.missed_updates(board.timer.update_count()), 0);
        for motion in 0..6 {
            for _ in 0..3 {
                feeder.push(stair(200 + motion, 2_000)).unwrap();
                feeder.push(stair(180, 1)).unwrap();
            }
            feeder.seal();
            assert!(board.start(&mut feeder));
            assert_eq!(feeder.missed_updates(board.timer.update_count()), 0, "at the start of motion {motion}");
            assert_eq!(play(board, &mut feeder), 0, "in motion {motion}");
        }
    }
}

#[test]
fn on_time_nothing_is_missed() {
    assert_none_missed_on_time::<BothEdges>();
    assert_none_missed_on_time::<Pulses>();
}

/// Holds the interrupt up for some intervals: the timer keeps one update pending, the others are
/// missed. No event is lost.
fn assert_missed_are_counted<M: Stepping + 'static>() {
    for held_up in [1, 2, 7, 40] {
        let (board, mut feeder) = board::<M>(3);
        feeder.push(stair(200, 200)).unwrap();
        feeder.seal();
        assert!(board.start(&mut feeder));
        for _ in 0..10 {
            board.update();
        }
        for _ in 0..held_up {
            board.timer.pass_to(board.timer.next_at());
        }
        assert_eq!(feeder.missed_updates(board.timer.update_count()), held_up);
        board.call();
        // One update stayed pending in the timer.
        assert_eq!(feeder.missed_updates(board.timer.update_count()), held_up - 1);
        assert_eq!(play(board, &mut feeder), held_up - 1);
        assert_eq!(board.ports[0].changes().len(), 200 * M::EVENTS_A_STEP as usize);
    }
}

#[test]
fn missed_updates_are_counted_and_lose_no_event() {
    assert_missed_are_counted::<BothEdges>();
    assert_missed_are_counted::<Pulses>();
}

/// A count below the number of events played is not a fault: no timer counts, or the interrupt came
/// between the two reads.
#[test]
fn a_count_behind_the_events_is_nothing_missed() {
    let (board, mut feeder) = board::<BothEdges>(0);
    feeder.push(stair(200, 100)).unwrap();
    feeder.seal();
    assert!(board.start(&mut feeder));
    for _ in 0..10 {
        board.update();
    }
    let count = board.timer.update_count();
    let at = |ahead: i32| feeder.missed_updates((i32::from(count) + ahead) as u16 & MAX_EVENTS);
    assert_eq!([at(0), at(1), at(200)], [0, 1, 200]);
    assert_eq!([at(-1), at(-9), at(-1_000)], [0; 3]);
    // The bound between the two, modulo 2^15.
    let half = i32::from(MAX_EVENTS / 2);
    assert_eq!((at(half), at(half + 1)), (MAX_EVENTS / 2, 0));
}

/// No update counts as missed once all events were played, though the count continues.
#[test]
fn after_the_last_event_nothing_is_missed() {
    let (board, mut feeder) = board::<BothEdges>(0);
    feeder.push(stair(200, 5)).unwrap();
    feeder.seal();
    assert!(board.start(&mut feeder));
    play(board, &mut feeder);
    for _ in 0..10 {
        board.timer.pass_to(board.timer.next_at());
        assert_eq!(feeder.missed_updates(board.timer.update_count()), 0);
    }
}

/// A second timer that exists but does not count: the difference shows at half the count's range,
/// all at once, and far beyond what the planner task tolerates.
#[test]
fn a_count_that_stands_still_shows_as_many_missed_updates() {
    let (board, mut feeder) = board::<BothEdges>(0);
    feeder.push(stair(200, 20_000)).unwrap();
    feeder.seal();
    assert!(board.start(&mut feeder));
    let stuck = board.timer.update_count();
    let mut missed = Vec::new();
    while feeder.waiting() > 0 {
        board.update();
        missed.push(feeder.missed_updates(stuck));
    }
    let first = missed.iter().position(|missed| *missed > 0).unwrap();
    assert!((16_380..16_390).contains(&first) && missed[first] > 16_000, "{first}: {}", missed[first]);
}
