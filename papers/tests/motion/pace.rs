//! Limits of a machine's processor: the budget of a block, and the pace of the blocks that leave.

use ferrostep_papers::Papers;
use ferrostep_planner::extruder::rounded_steps;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{Geometry, MotionChoice, MoveError, Pace, Planner, Speed, TICKS_PER_SECOND};
use proptest::prelude::*;

use crate::motion::law::Law;
use crate::motion::machine::{blocks, machines, planner};
use crate::motion::moves::{moves, short_moves};

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(500))]

    #[test]
    fn no_block_is_faster_than_the_budget(machine in machines(), moves in prop_oneof![moves(), short_moves()]) {
        let machine = Geometry { event_cost_ticks: 2_100, move_cost_ticks: 84_000, ..machine };
        let mut extruder = 0i64;
        for planned in blocks(machine, &MotionChoice::DEFAULT, 24, &moves) {
            let block = planned.block;
            let extruder_steps = rounded_steps(extruder + i64::from(block.extruder_256ths)).abs_diff(rounded_steps(extruder));
            extruder += i64::from(block.extruder_256ths);
            let master = block.steps.iter().map(|steps| u64::from(steps.unsigned_abs())).max().unwrap();
            let lines = 1 + block.inner_ends.iter(block.line).count() as u64;
            let cost_ticks = (master + extruder_steps) * 2_100 + lines * 84_000;
            let ticks = Law::new(&planned).duration() * f64::from(TICKS_PER_SECOND);
            prop_assert!(ticks >= cost_ticks as f64 * (1.0 - 1e-6), "{} {}", ticks, cost_ticks);
        }
    }

    #[test]
    fn any_pace_keeps_the_limits(machine in machines(), moves in moves(), ring in 2usize..40, paces in proptest::collection::vec(0u16..300, 1..40)) {
        let mut planner = planner(machine, &MotionChoice::DEFAULT, ring);
        let mut planned = Vec::new();
        let mut paces = paces.into_iter().cycle();
        let mut next = |planner: &mut Planner<Vec<Slot>, Papers>| {
            let pace = Pace::from_256ths(paces.next().unwrap());
            planner.set_pace(pace);
            planner.next_planned().map(|block| (pace, block))
        };
        for each in &moves {
            while let Err(MoveError::NoRoom) = planner.add(each) {
                planned.extend(next(&mut planner));
            }
        }
        planner.flush();
        while let Some(one) = next(&mut planner) {
            planned.push(one);
        }
        let full = blocks(machine, &MotionChoice::DEFAULT, ring, &moves);
        prop_assert_eq!(planned.len(), full.len());
        let mut speed = Speed::ZERO;
        for ((pace, planned), full) in planned.into_iter().zip(full) {
            prop_assert_eq!(planned.entry, speed);
            speed = planned.exit;
            let reach = 2.0 * planned.block.acceleration.mm_per_s2() * planned.block.length_mm();
            let change = planned.exit.squared() - planned.entry.squared();
            prop_assert!(change.abs() <= reach * (1.0 + 1e-9) + 0.05, "{} > {}", change, reach);
            let capped = pace.of(full.block.nominal);
            prop_assert_eq!(planned.block.nominal, capped.max(planned.entry).max(planned.exit));
            prop_assert!(planned.block.nominal <= full.block.nominal && planned.exit <= full.exit);
            // Above the pace only what the length cannot take away.
            let least = (planned.entry.squared() - reach).max(0.0).sqrt();
            prop_assert!(planned.exit <= capped || planned.exit.mm_per_s() <= least * (1.0 + 1e-6) + 1e-3);
        }
        prop_assert_eq!(speed, Speed::ZERO);
    }
}
