//! Two motors on one axis, and the second one alone.

use super::model::{Interrupt, SIGNALS, any_stair, pins};
use crate::*;
use ferrostep_planner::{StepEntry, StepLedger};
use proptest::prelude::*;

/// Z's second motor: inverted.
const SECOND: MotorPins = MotorPins { step: Pin { port: 0, number: 8 }, direction: Pin { port: 0, number: 9 } };

/// Steps shown by the pins of Z's two motors; backward steps count down.
fn made<M: Stepping>(board: &Interrupt<M, 1, 512>) -> [i64; 2] {
    let mut made = [0; 2];
    let mut before = 0;
    for (_, level) in board.ports[0].levels() {
        let changed = level ^ before;
        before = level;
        let stepped = if M::EVENTS_A_STEP == 1 { changed } else { changed & level };
        let backwards = [level >> 6 & 1, 1 - (level >> 9 & 1)];
        for ((made, step), backwards) in made.iter_mut().zip([2, 8]).zip(backwards) {
            *made += i64::from(stepped >> step & 1) * (1 - 2 * i64::from(backwards));
        }
    }
    made
}

fn any_entry() -> impl Strategy<Value = StepEntry> {
    prop_oneof![6 => any_stair(168..1_000), 2 => (0u8..16).prop_map(StepEntry::directions)]
}

/// Runs both motors through `together`, the second alone through `alone` with a stop after
/// `updates`, and then both through `together` again.
fn assert_counted<M: Stepping + 'static>(together: &[StepEntry], alone: &[StepEntry], updates: usize) {
    let board = Interrupt::<M, 1, 512>::leaked();
    let both = pins::<1>().with_further(2, SECOND, true).unwrap();
    let mut feeder = StepFeeder::new(&board.player, both, SIGNALS);
    board.ports[0].put_out(feeder.direction_words()[0]);
    let mut ledger = StepLedger::default();
    let play =
        |feeder: &mut StepFeeder<'_, M, 1, 512>, ledger: &mut StepLedger, entries: &[StepEntry], updates: usize| {
            let before = ledger.motor_steps()[2];
            for entry in entries {
                feeder.push(*entry).unwrap();
                ledger.play(*entry, &mut ());
            }
            feeder.seal();
            board.start(feeder);
            for _ in 0..updates {
                board.update();
            }
            if feeder.waiting() > 0 {
                board.stop();
                let dropped = feeder.drop_all();
                ledger.take_back(dropped.signed, dropped.issued);
                board.ports[0].put_out(feeder.rest_words()[0]);
            }
            ledger.motor_steps()[2] - before
        };
    let first = play(&mut feeder, &mut ledger, together, 20_000);
    assert_eq!(made(board), [first; 2]);
    feeder.step_without([Pin { port: 0, number: 2 }].into_iter());
    let second = play(&mut feeder, &mut ledger, alone, updates);
    assert_eq!(made(board), [first, first + second]);
    feeder.step_without([].into_iter());
    let third = play(&mut feeder, &mut ledger, together, 20_000);
    assert_eq!(made(board), [first + third, first + second + third]);
}

proptest! {
    #[test]
    fn a_motor_moves_alone_and_a_stop_counts_it(
        together in prop::collection::vec(any_entry(), 1..30),
        alone in prop::collection::vec(any_entry(), 1..30),
        updates in 0usize..1_500,
    ) {
        assert_counted::<BothEdges>(&together, &alone, updates);
        assert_counted::<Pulses>(&together, &alone, updates);
    }
}
