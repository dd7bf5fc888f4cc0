//! Short moves that become one block.

use ferrostep_papers::Papers;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{Geometry, MotionChoice, Move, Planner, Progress};
use proptest::prelude::*;

use crate::motion::machine::{MINIMUM_INTERVAL, advance, blocks, cartesian, machines, planner};
use crate::motion::moves::{request, short_moves};
use crate::motion::player::Player;

/// A job and its plan, with a fan change after each move that keeps it from merging with the
/// next, or without.
fn plan(geometry: Geometry, moves: &[Move], apart: bool) -> (Planner<Vec<Slot>, Papers>, Player) {
    let mut planner = planner(geometry, &MotionChoice::DEFAULT, 1_000);
    let mut player = Player::default();
    for each in moves {
        planner.add(each).unwrap();
        assert!(!apart || planner.add_fan_power(0, 1));
        while !planner.has_room() {
            assert_eq!(advance(&mut planner, &mut player), Progress::Worked);
        }
    }
    planner.flush();
    while advance(&mut planner, &mut player) == Progress::Worked {}
    (planner, player)
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(500))]

    #[test]
    fn merging_changes_no_end_and_no_time(machine in machines(), moves in short_moves()) {
        let (merged_planner, merged) = plan(machine, &moves, false);
        let (apart_planner, apart) = plan(machine, &moves, true);
        prop_assert_eq!(apart_planner.merged_moves(), 0);
        let (ends, expected) = (merged.ends(), apart.ends());
        prop_assert_eq!(ends.len(), expected.len());
        let count = |player: &Player, tick: u64| {
            Player::motors_after(player.events.iter().take_while(|event| event.tick <= tick))
        };
        for (&(tick, line), &(expected_tick, expected_line)) in ends.iter().zip(&expected) {
            prop_assert_eq!(line, expected_line);
            prop_assert_eq!(count(&merged, tick), count(&apart, expected_tick), "line {}", line);
            // A speed is cut to 2^-16 mm/s and a duration rounded to a tick at each end of a block;
            // an event that keeps its distance may put an end off.
            let slack = 1e-6 * tick as f64 + 4.0 * f64::from(MINIMUM_INTERVAL) + 200.0;
            prop_assert!((tick as f64 - expected_tick as f64).abs() < slack, "{} {} {}", line, tick, expected_tick);
        }
        prop_assert_eq!(merged_planner.position_10nm(), apart_planner.position_10nm());
    }
}

/// A straight line in pieces of 0.05 mm, four steps each.
fn pieces_of_a_line(filament_100pm: i64) -> Vec<Move> {
    (1..=800).map(|line| Move { line, ..request([i64::from(line) * 5_000, 0, 0], filament_100pm, 60.0) }).collect()
}

#[test]
fn a_line_in_short_pieces_takes_an_eighth_of_the_places() {
    let machine = cartesian();
    assert_eq!(blocks(machine, &MotionChoice::DEFAULT, 128, &pieces_of_a_line(0)).len(), 100);
    let (planner, player) = plan(machine, &pieces_of_a_line(0), false);
    assert_eq!(planner.merged_moves(), 700);
    assert_eq!(player.ends().iter().map(|end| end.1).collect::<Vec<_>>(), (1..=800).collect::<Vec<_>>());
    assert_eq!(blocks(machine, &MotionChoice::DEFAULT, 128, &pieces_of_a_line(40_000)).len(), 100);
}

#[test]
fn a_circle_in_short_pieces_takes_an_eighth_of_the_places() {
    // 50 mm radius, 0.05 mm a piece; every motor turns round twice.
    let machine = cartesian();
    let pieces = 6_283;
    let moves: Vec<_> = (1..=pieces)
        .map(|line| {
            let angle = f64::from(line) / f64::from(pieces) * core::f64::consts::TAU;
            let [x, y] = [angle.cos() - 1.0, angle.sin()].map(|share| (share * 5_000_000.0).round() as i64);
            Move { line, ..request([x, y, 0], 20_000, 60.0) }
        })
        .collect();
    let count = blocks(machine, &MotionChoice::DEFAULT, 128, &moves).len();
    assert!(count <= 790, "{count}");
}
