//! Blocks: their speeds, their law, their limits, and their events.

use ferrostep_planner::extruder::rounded_steps;
use ferrostep_planner::stretches::Stretches;
use ferrostep_planner::{Geometry, MotionChoice, MoveError, PlannedBlock, Progress, Speed, TICKS_PER_SECOND};
use proptest::prelude::*;

use crate::motion::checks;
use crate::motion::law::Law;
use crate::motion::machine::{
    MINIMUM_INTERVAL, accelerations, advance, blocks, cartesian, limits, machines, planner, play,
};
use crate::motion::moves::moves;
use crate::motion::player::Player;

/// Steps of each motor in a block, in both directions; the block begins with the extruder at
/// `filament`, 1/256 steps, and the extruder may reverse inside.
fn issued(planned: &PlannedBlock, mut filament: i64) -> [i64; 4] {
    let mut issued = [0; 4];
    for stretch in Stretches::of(&planned.block) {
        let [x, y, z] = stretch.steps.map(|steps| i64::from(steps).abs());
        let before = rounded_steps(filament);
        filament += i64::from(stretch.extruder_256ths);
        let steps = [x, y, z, (rounded_steps(filament) - before).abs()];
        issued.iter_mut().zip(steps).for_each(|(sum, steps)| *sum += steps);
    }
    issued
}

/// Position of each motor according to the law after a share of a block, and the number of steps
/// that it would have in the whole block at the highest density.
fn ideals(planned: &PlannedBlock, from: [f64; 4], share: f64) -> [(f64, f64); 4] {
    let whole = f64::from(planned.block.length_10nm);
    let mut ideals = from.map(|from| (from, 0.0f64));
    for stretch in Stretches::of(&planned.block) {
        let (before, length) = (f64::from(stretch.before_10nm), f64::from(stretch.length_10nm));
        let part = ((share * whole - before) / length).clamp(0.0, 1.0);
        let [x, y, z] = stretch.steps.map(f64::from);
        let deltas = [x, y, z, f64::from(stretch.extruder_256ths) / 256.0];
        for ((ideal, densest), delta) in ideals.iter_mut().zip(deltas) {
            *ideal += delta * part;
            *densest = densest.max(delta.abs() / length * whole);
        }
    }
    ideals
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(300))]

    #[test]
    fn motors_end_every_move_exactly_where_it_ends(
        machine in machines(), moves in moves(), ring in 2usize..40, law in accelerations(),
    ) {
        checks::motors_end_every_move_exactly_where_it_ends(machine, &law, &moves, ring)?;
    }

    #[test]
    fn events_keep_their_distance(machine in machines(), moves in moves(), law in accelerations()) {
        checks::events_keep_their_distance(machine, &law, &moves)?;
    }

    #[test]
    fn no_motor_is_more_than_a_step_from_its_law(machine in machines(), moves in moves()) {
        let player = play(machine, &MotionChoice::DEFAULT, 24, &moves, || 0);
        let mut events = player.events.iter().peekable();
        let mut motors = [0i64; 4];
        let (mut start_tick, mut start, mut filament) = (0u64, [0i64; 3], 0i64);
        for planned in blocks(machine, &MotionChoice::DEFAULT, 24, &moves) {
            let law = Law::new(&planned);
            let duration = (law.duration() * f64::from(TICKS_PER_SECOND)).round() as u64;
            let end_tick = start_tick + duration;
            let steps = planned.block.steps.map(i64::from);
            let filament_end = filament + i64::from(planned.block.extruder_256ths);
            let mut left = issued(&planned, filament);
            let fastest = planned.block.nominal.mm_per_s() / law.length;
            // The last events of a block may be late by the minimum interval where the next begins.
            let latest = end_tick + 2 * u64::from(MINIMUM_INTERVAL);
            while let Some(event) = events.next_if(|event| left != [0; 4] && event.tick <= latest) {
                let check = |motors: &[i64; 4], tick: u64| -> Result<(), TestCaseError> {
                    let share = law.share((tick.saturating_sub(start_tick)) as f64 / f64::from(TICKS_PER_SECOND));
                    let [x, y, z] = start.map(|steps| steps as f64);
                    let from = [x, y, z, filament as f64 / 256.0];
                    let ideals = ideals(&planned, from, share);
                    for motor in 0..4 {
                        let (ideal, densest) = ideals[motor];
                        // An event that joins another, or keeps its distance from one, is off by up
                        // to two intervals.
                        let joined = densest * fastest * 2.0 * f64::from(MINIMUM_INTERVAL) / f64::from(TICKS_PER_SECOND);
                        let off = (motors[motor] as f64 - ideal).abs();
                        prop_assert!(off <= 1.0 + 1e-3 + joined, "motor {} is {} off", motor, off);
                    }
                    Ok(())
                };
                check(&motors, event.tick)?;
                for (motor, steps) in motors.iter_mut().enumerate() {
                    if event.axes >> motor & 1 == 1 {
                        *steps += if event.directions >> motor & 1 == 1 { -1 } else { 1 };
                        left[motor] -= 1;
                    }
                }
                check(&motors, event.tick)?;
            }
            prop_assert_eq!(left, [0; 4]);
            for axis in 0..3 {
                start[axis] += steps[axis];
                prop_assert_eq!(motors[axis], start[axis]);
            }
            filament = filament_end;
            start_tick = end_tick;
        }
        prop_assert!(events.next().is_none());
    }

    #[test]
    fn speeds_join_and_limits_hold(machine in machines(), moves in moves(), ring in 2usize..40) {
        let mut speed = 0.0;
        for planned in blocks(machine, &MotionChoice::DEFAULT, ring, &moves) {
            prop_assert_eq!(planned.entry.mm_per_s(), speed);
            speed = planned.exit.mm_per_s();
            let nominal = planned.block.nominal.mm_per_s();
            prop_assert!(planned.entry <= planned.block.nominal && planned.exit <= planned.block.nominal);
            let change = (planned.exit.squared() - planned.entry.squared()).abs();
            let reach = 2.0 * planned.block.acceleration.mm_per_s2() * planned.block.length_mm();
            prop_assert!(change <= reach * (1.0 + 1e-9) + 0.05, "{} > {}", change, reach);
            prop_assert!(nominal <= 400.0 * (1.0 + 1e-9));
        }
        prop_assert_eq!(speed, 0.0);
    }

    #[test]
    fn the_plan_does_not_depend_on_when_moves_come(
        machine in machines(), moves in moves(), ring in 2usize..40, seed in any::<u64>(), law in accelerations(),
    ) {
        checks::the_plan_does_not_depend_on_when_moves_come(machine, &law, &moves, ring, seed)?;
    }

    #[test]
    fn an_estimate_takes_as_long_as_the_motion(
        machine in machines(), moves in moves(), ring in 2usize..40, law in accelerations(),
    ) {
        let mut player = Player::default();
        let mut planned = planner(machine, &law, ring);
        let mut played = planner(machine, &law, ring);
        let mut speed = Speed::ZERO;
        for each in &moves {
            while let Err(MoveError::NoRoom) = planned.add(each) {
                let block = planned.next_planned().unwrap();
                prop_assert_eq!(block.entry, speed);
                speed = block.exit;
            }
            while let Err(MoveError::NoRoom) = played.add(each) {
                advance(&mut played, &mut player);
            }
        }
        planned.flush();
        played.flush();
        while let Some(block) = planned.next_planned() {
            prop_assert_eq!(block.entry, speed);
            speed = block.exit;
        }
        while advance(&mut played, &mut player) == Progress::Worked {}
        prop_assert_eq!(speed, Speed::ZERO);
        prop_assert_eq!(planned.motion_ticks(), played.motion_ticks());
        prop_assert!(!played.is_in_motion());
    }

    /// Immediate room yields the same plan as a move that is refused and offered again.
    #[test]
    fn a_plan_does_not_depend_on_how_room_is_made(
        machine in machines(), moves in moves(), ring in 2usize..40, law in accelerations(),
    ) {
        let waited = blocks(machine, &law, ring, &moves);
        let mut planner = planner(machine, &law, ring);
        let mut made = Vec::new();
        for each in &moves {
            let outcome = planner.add_making_room(each, |planner| {
                let block = planner.next_planned();
                made.extend(block);
                block.is_some()
            });
            prop_assert!(outcome.is_ok(), "{:?}", outcome);
        }
        planner.flush();
        made.extend(std::iter::from_fn(|| planner.next_planned()));
        prop_assert_eq!(format!("{made:?}"), format!("{waited:?}"));
    }

    #[test]
    fn extruder_speed_and_acceleration_keep_their_limits(moves in moves()) {
        let machine = cartesian();
        for planned in blocks(machine, &MotionChoice::DEFAULT, 24, &moves) {
            let limits = limits();
            for (axis, per_mm) in machine_share(&machine, &planned).into_iter().enumerate() {
                // Rounding may shift a step end by half a step at each side.
                let slack = 1.0 / (machine.steps_per_mm[axis].to_f64() * planned.block.length_mm());
                let share = (per_mm - slack).max(0.0);
                prop_assert!(planned.block.nominal.mm_per_s() * share <= limits.max_feed_mm_per_s[axis] * (1.0 + 1e-6));
                prop_assert!(planned.block.acceleration.mm_per_s2() * share <= limits.max_acceleration_mm_per_s2[axis] * (1.0 + 1e-6));
            }
        }
    }
}

/// Travel of each axis per millimetre of path.
fn machine_share(machine: &Geometry, planned: &PlannedBlock) -> [f64; 4] {
    let [x, y, z] = planned.block.steps.map(|steps| f64::from(steps.abs()));
    let e = f64::from(planned.block.extruder_256ths.abs()) / 256.0;
    let travel = [x, y, z, e];
    [0, 1, 2, 3].map(|axis| travel[axis] / machine.steps_per_mm[axis].to_f64() / planned.block.length_mm())
}
