//! Stops at any moment.

use super::model::{Edges, Interrupt, SIGNALS, any_stair};
use crate::*;
use ferrostep_planner::StepEntry;
use ferrostep_planner::StepLedger;
use proptest::prelude::*;

fn any_entry() -> impl Strategy<Value = StepEntry> {
    prop_oneof![
        6 => any_stair(168..1_000),
        1 => (168u32..1_000_000).prop_map(StepEntry::wait),
        2 => (0u8..16).prop_map(StepEntry::directions),
    ]
}

fn assert_stopped<M: Stepping + 'static>(entries: &[StepEntry], updates: usize) {
    let board = Interrupt::<M, 1, 512>::leaked();
    let mut feeder = board.feeder(SIGNALS);
    let mut all = StepLedger::default();
    for entry in entries {
        feeder.push(*entry).unwrap();
        all.play(*entry, &mut ());
    }
    if updates.is_multiple_of(3) {
        feeder.seal();
    }
    board.start(&mut feeder);
    let made = |ports: &[Edges; 1]| {
        let mut made = [0i64; 4];
        for (_, level, changed) in ports[0].changes() {
            let stepped = if M::EVENTS_A_STEP == 1 { changed } else { changed & level };
            for (motor, made) in made.iter_mut().enumerate() {
                *made += i64::from(stepped >> motor & 1) * (1 - 2 * i64::from(level >> (motor + 4) & 1));
            }
        }
        made
    };
    for update in 0..updates {
        board.update();
        if update % 64 == 0 {
            let [queued, unplayed] = [all.motor_steps(), feeder.unplayed_steps().map(i64::from)];
            let made_so_far: [i64; 4] = std::array::from_fn(|motor| queued[motor] - unplayed[motor]);
            assert_eq!(made_so_far, made(&board.ports), "while it plays");
        }
    }
    board.stop();
    assert!(board.player.link().is_stopping());
    let dropped = feeder.drop_all();
    assert!(!board.player.link().is_stopping());
    all.take_back(dropped.signed, dropped.issued);
    assert_eq!(all.motor_steps(), made(&board.ports));
    assert_eq!(feeder.waiting(), 0);
    for (port, word) in board.ports.iter().zip(feeder.rest_words()) {
        port.put_out(word);
    }
    assert_eq!(made(&board.ports), all.motor_steps(), "putting the signals to rest stepped a motor");
    // The interrupt runs again, in the directions requested last.
    let before = made(&board.ports);
    feeder.push(StepEntry::stair(200, 3, 0b101, 0b010).unwrap()).unwrap();
    feeder.seal();
    board.start(&mut feeder);
    for _ in 0..12 {
        board.update();
    }
    let after = made(&board.ports);
    for (motor, count) in [3, 1, 3, 0].into_iter().enumerate() {
        let sign = 1 - 2 * i64::from(all.directions() >> motor & 1);
        assert_eq!(after[motor] - before[motor], sign * count, "motor {motor}");
    }
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(3_000))]
    #[test]
    fn counts_every_step_that_was_not_made(
        entries in proptest::collection::vec(any_entry(), 1..120), updates in 0usize..1_500,
    ) {
        assert_stopped::<BothEdges>(&entries, updates);
        assert_stopped::<Pulses>(&entries, updates);
    }
}
