//! Properties of every method under every law.

use ferrostep_planner::extruder::{Extruder, rounded_steps};
use ferrostep_planner::{Geometry, MotionChoice, Move, Notice};
use proptest::prelude::*;

use crate::motion::machine::{MINIMUM_INTERVAL, play};

pub fn motors_end_every_move_exactly_where_it_ends(
    machine: Geometry,
    choice: &MotionChoice,
    moves: &[Move],
    ring: usize,
) -> Result<(), TestCaseError> {
    let player = play(machine, choice, ring, moves, || 0);
    let mut extruder = Extruder::new(machine.steps_per_mm[3]);
    let mut motors = [0i64; 4];
    let mut events = player.events.iter().peekable();
    let mut ends = player.notices.iter();
    let mut position = [0; 3];
    for each in moves {
        extruder.advance(each.filament_100pm);
        let nothing = each.target_10nm == position && each.filament_100pm == 0;
        position = each.target_10nm;
        if !each.ends_move || nothing {
            continue;
        }
        let Some(&Notice::MoveEnded { tick, line }) = ends.next() else {
            panic!("move of line {} has no end", each.line)
        };
        prop_assert_eq!(line, each.line);
        while let Some(event) = events.next_if(|event| event.tick <= tick) {
            event.apply(&mut motors);
        }
        let [x, y, z] = machine.motor_steps(each.target_10nm).map(i64::from);
        prop_assert_eq!(motors, [x, y, z, rounded_steps(extruder.position_256ths())], "line {}", line);
    }
    prop_assert!(ends.next().is_none());
    Ok(())
}

pub fn events_keep_their_distance(
    machine: Geometry,
    choice: &MotionChoice,
    moves: &[Move],
) -> Result<(), TestCaseError> {
    let player = play(machine, choice, 16, moves, || 0);
    for pair in player.events.windows(2) {
        prop_assert!(pair[1].tick - pair[0].tick >= u64::from(MINIMUM_INTERVAL));
    }
    prop_assert!(player.events.iter().all(|event| event.axes != 0 && event.axes < 16));
    Ok(())
}

pub fn the_plan_does_not_depend_on_when_moves_come(
    machine: Geometry,
    choice: &MotionChoice,
    moves: &[Move],
    ring: usize,
    seed: u64,
) -> Result<(), TestCaseError> {
    let mut state = seed | 1;
    let random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % 400) as usize
    };
    let prompt = play(machine, choice, ring, moves, || 0);
    let halting = play(machine, choice, ring, moves, random);
    prop_assert_eq!(prompt.digest(), halting.digest());
    prop_assert_eq!(prompt.events, halting.events);
    prop_assert_eq!(prompt.notices, halting.notices);
    Ok(())
}
