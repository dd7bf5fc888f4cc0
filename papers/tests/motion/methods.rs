//! The papers' other methods of interpolation: exact ends, spacing, time laws, stops.

use ferrostep_papers::plane::{CoreXyLine, PlaneMethod};
use ferrostep_planner::extruder::rounded_steps;
use ferrostep_planner::{
    ChoiceError, DualRatePeriods, Geometry, Interpolation, Kinematics, MotionChoice, Move, Notice, PlannedBlock,
    Progress, TICKS_PER_SECOND,
};
use proptest::prelude::*;

use crate::motion::checks;
use crate::motion::law::Law;
use crate::motion::machine::{MINIMUM_INTERVAL, advance, blocks, geometry, machines_with, planner, play, usual_steps};
use crate::motion::moves::{moves_up_to, request};
use crate::motion::player::Player;

/// The methods that are not the default.
const METHODS: [Interpolation; 4] =
    [Interpolation::Bresenham, Interpolation::PointByPoint, Interpolation::MinimumDeviation, Interpolation::DualRate];

/// The usual ones, and some whose events come as near as they may.
fn machines() -> impl Strategy<Value = Geometry> {
    machines_with(prop_oneof![3 => usual_steps(), 1 => Just([2_000.0, 2_000.0, 4_000.0, 3_000.0])])
}

/// A method, with a wide and a narrow range of periods for dual-rate.
fn choices() -> impl Strategy<Value = MotionChoice> {
    (0usize..METHODS.len(), any::<bool>()).prop_map(|(index, wide)| choice(METHODS[index], wide))
}

fn choice(interpolation: Interpolation, wide: bool) -> MotionChoice {
    let dual_rate = DualRatePeriods { shortest_ns: 2_000, longest_ns: if wide { 3_000_000 } else { 8_000 } };
    MotionChoice { interpolation, dual_rate, ..MotionChoice::DEFAULT }
}

fn moves() -> impl Strategy<Value = Vec<Move>> {
    moves_up_to(2_000_000, 30)
}

/// Moves that each end at their line, and are blocks each; moves that displace
/// nothing are left out.
fn ended(moves: impl Strategy<Value = Vec<Move>>) -> impl Strategy<Value = Vec<Move>> {
    moves.prop_map(|mut moves| {
        let mut position = [0; 3];
        moves.retain_mut(|each| {
            each.ends_move = true;
            let goes_on = core::mem::replace(&mut position, each.target_10nm) != each.target_10nm;
            goes_on || each.filament_100pm != 0
        });
        moves
    })
}

/// Pulses along X and Y, in halves, of motor steps.
fn half_pulses(kinematics: Kinematics, [first, second]: [f64; 2]) -> [f64; 2] {
    match kinematics {
        Kinematics::Cartesian | Kinematics::CoreXz => [2.0 * first, 2.0 * second],
        Kinematics::CoreXy => [first + second, first - second],
    }
}

/// Largest distance of X and Y from the block's line, and from their place along it by
/// its law, in pulses.
///
/// Across, point-by-point is off by less than a pulse and minimum deviation by half a one. Along, a
/// point with k of N pulses is beside the line's point k of N: with e pulses too many along one
/// axis and too few along the other that is e (X - Y)/S, e < max(X, Y)/(X + Y), so less than 1;
/// with e <= 1/2 along the shorter axis alone at most 1/2 sin 45. Half a part more, as pulses are
/// in the middle of theirs: S/2N, at most 1/2 and 1/2 sqrt 2. The line that leads to an odd step at
/// the end is off by what that step will mend: sqrt 2 / 2 along, and across sin 45 of it.
fn plane_bounds(method: Interpolation, odd: bool) -> (f64, f64) {
    let (across, along) = if method == Interpolation::PointByPoint { (1.0, 1.5) } else { (0.5, 0.354 + 0.708) };
    if odd { (across + 0.5, along + 0.708) } else { (across, along) }
}

fn check_block(
    machine: &Geometry,
    choice: &MotionChoice,
    planned: &PlannedBlock,
    law: &Law,
    from: ([i64; 4], i64),
    motors: &[i64; 4],
    ticks: u64,
) -> Result<(), TestCaseError> {
    let (start, filament) = from;
    let share = law.share(ticks as f64 / f64::from(TICKS_PER_SECOND));
    // An event that joins another, or keeps its distance from one, is up to two intervals off.
    let slack =
        planned.block.nominal.mm_per_s() / law.length * 2.0 * f64::from(MINIMUM_INTERVAL) / f64::from(TICKS_PER_SECOND);
    let mut off = [0.0; 4];
    let mut deltas = [0.0; 4];
    for motor in 0..4 {
        let (from, delta) = match motor {
            3 => (filament as f64 / 256.0, f64::from(planned.block.extruder_256ths) / 256.0),
            _ => (start[motor] as f64, f64::from(planned.block.steps[motor])),
        };
        off[motor] = motors[motor] as f64 - (from + delta * share);
        deltas[motor] = delta;
    }
    for motor in [2, 3] {
        let bound = 1.0 + 1e-3 + deltas[motor].abs() * slack;
        prop_assert!(off[motor].abs() <= bound, "motor {} is {} off, {}", motor, off[motor], bound);
    }
    let [x, y] = half_pulses(machine.kinematics, [deltas[0], deltas[1]]).map(|halves| halves / 2.0);
    let [off_x, off_y] = half_pulses(machine.kinematics, [off[0], off[1]]).map(|halves| halves / 2.0);
    let length = x.hypot(y);
    if choice.interpolation == Interpolation::DualRate || length == 0.0 {
        let is_dead = {
            let [a, b] = [deltas[0].abs(), deltas[1].abs()];
            a.max(b) * f64::from(choice.dual_rate.shortest_ns) > a.min(b) * f64::from(choice.dual_rate.longest_ns)
        };
        if !is_dead || length == 0.0 {
            for motor in [0, 1] {
                let bound = 0.5 + 1e-2 + deltas[motor].abs() * slack;
                prop_assert!(off[motor].abs() <= bound, "motor {} is {} off, {}", motor, off[motor], bound);
            }
            return Ok(());
        }
    }
    if choice.interpolation == Interpolation::Bresenham {
        for motor in [0, 1] {
            let bound = 1.0 + 1e-3 + deltas[motor].abs() * slack;
            prop_assert!(off[motor].abs() <= bound, "motor {} is {} off, {}", motor, off[motor], bound);
        }
        return Ok(());
    }
    let across = (off_x * y - off_y * x).abs() / length;
    let along = (off_x * x + off_y * y).abs() / length;
    let odd = machine.kinematics == Kinematics::CoreXy && (planned.block.steps[0] ^ planned.block.steps[1]) & 1 == 1;
    let (across_bound, along_bound) = plane_bounds(choice.interpolation, odd);
    prop_assert!(across <= across_bound + 1e-6, "{} pulses from the line", across);
    prop_assert!(along <= along_bound + 1e-2 + length * slack, "{} pulses from the law", along);
    Ok(())
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(300))]

    #[test]
    fn motors_end_every_move_exactly_where_it_ends(machine in machines(), choice in choices(), moves in moves(), ring in 2usize..40) {
        checks::motors_end_every_move_exactly_where_it_ends(machine, &choice, &moves, ring)?;
    }

    #[test]
    fn events_keep_their_distance(machine in machines(), choice in choices(), moves in moves()) {
        checks::events_keep_their_distance(machine, &choice, &moves)?;
    }

    #[test]
    fn every_block_follows_its_law_and_its_line(machine in machines(), choice in choices(), moves in ended(moves())) {
        let player = play(machine, &choice, 24, &moves, || 0);
        let mut events = player.events.iter().peekable();
        let mut motors = [0i64; 4];
        let (mut start_tick, mut filament) = (0u64, 0i64);
        let blocks = blocks(machine, &choice, 24, &moves);
        prop_assert_eq!(blocks.len(), player.notices.len());
        for (planned, notice) in blocks.into_iter().zip(&player.notices) {
            let law = Law::new(&planned);
            let end_tick = start_tick + (law.duration() * f64::from(TICKS_PER_SECOND)).round() as u64;
            let start = motors;
            let filament_end = filament + i64::from(planned.block.extruder_256ths);
            while let Some(event) = events.next_if(|event| event.tick <= notice.tick()) {
                let ticks = event.tick.saturating_sub(start_tick);
                check_block(&machine, &choice, &planned, &law, (start, filament), &motors, ticks)?;
                event.apply(&mut motors);
                check_block(&machine, &choice, &planned, &law, (start, filament), &motors, ticks)?;
            }
            let [x, y, z] = planned.block.steps.map(i64::from);
            prop_assert_eq!(motors, [start[0] + x, start[1] + y, start[2] + z, rounded_steps(filament_end)]);
            filament = filament_end;
            start_tick = end_tick;
        }
        prop_assert!(events.next().is_none());
    }

    #[test]
    fn the_plan_does_not_depend_on_when_moves_come(
        machine in machines(), choice in choices(), moves in moves(), ring in 2usize..40, seed in any::<u64>(),
    ) {
        checks::the_plan_does_not_depend_on_when_moves_come(machine, &choice, &moves, ring, seed)?;
    }

    #[test]
    fn motors_make_as_many_steps_as_the_method_says(machine in machines(), choice in choices(), x in -40_000i64..40_000, y in -40_000i64..40_000) {
        let target = Move { target_10nm: [x, y, 0], filament_100pm: 0, feed_mm_per_s: 50.0, line: 1, ends_move: true };
        let player = play(machine, &choice, 8, &[target], || 0);
        let [a, b, _] = machine.motor_steps([x, y, 0]).map(|steps| u64::from(steps.unsigned_abs()));
        let made = [1, 2].map(|bit| player.events.iter().filter(|event| event.axes & bit != 0).count() as u64);
        if choice.interpolation == Interpolation::PointByPoint && machine.kinematics == Kinematics::CoreXy {
            let odd = (a + b) & 1;
            prop_assert_eq!(made[0] + made[1], 2 * a.max(b) - odd);
            prop_assert_eq!(made[0].max(made[1]), a.max(b));
        } else {
            prop_assert_eq!(made, [a, b]);
        }
        if choice.interpolation == Interpolation::PointByPoint && machine.kinematics == Kinematics::Cartesian {
            prop_assert_eq!(player.events.len() as u64, a + b);
        }
    }

    #[test]
    fn after_a_stop_motion_goes_on_from_where_the_motors_stand(machine in machines(), choice in choices(), moves in moves(), work in 1usize..600) {
        let mut planner = planner(machine, &choice, 40);
        let mut player = Player::default();
        for each in &moves {
            planner.add(each).unwrap();
        }
        planner.flush();
        for _ in 0..work {
            advance(&mut planner, &mut player);
        }
        let motors = Player::motors_after(&player.events);
        planner.reset_to(motors, player.tick, player.directions);
        prop_assert!(planner.is_idle());
        planner.add(&Move { target_10nm: [0; 3], filament_100pm: 1_000_000, feed_mm_per_s: 100.0, line: 99, ends_move: true }).unwrap();
        planner.flush();
        while advance(&mut planner, &mut player) == Progress::Worked {}
        prop_assert_eq!(&Player::motors_after(&player.events)[..3], &[0, 0, 0]);
    }

    #[test]
    fn classic_bresenham_makes_the_default_s_steps(machine in machines(), moves in moves()) {
        // Each move is a separate block with both; only the times of stairs differ,
        // by up to 32 ticks.
        let apart: Vec<_> = moves.iter().map(|each| Move { filament_100pm: 0, ..*each }).collect();
        let classic = play(machine, &choice(Interpolation::Bresenham, true), 24, &apart, || 0);
        let mut planner = planner(machine, &MotionChoice::DEFAULT, 1_000);
        let mut step = Player::default();
        for each in &apart {
            planner.add(each).unwrap();
            prop_assert!(planner.add_fan_power(0, 1));
        }
        planner.flush();
        while planner.advance(&mut step) == Progress::Worked {}
        let order = |player: &Player| player.events.iter().map(|event| (event.axes, event.directions)).collect::<Vec<_>>();
        prop_assert_eq!(order(&classic), order(&step));
    }

    #[test]
    fn no_block_is_faster_than_its_events_allow(machine in machines(), choice in choices(), moves in ended(moves())) {
        let machine = Geometry { event_cost_ticks: 2_100, move_cost_ticks: 84_000, ..machine };
        let player = play(machine, &choice, 24, &moves, || 0);
        let mut events = player.events.iter().peekable();
        for (planned, notice) in blocks(machine, &choice, 24, &moves).into_iter().zip(&player.notices) {
            let ticks = Law::new(&planned).duration() * f64::from(TICKS_PER_SECOND);
            let mut count = 0;
            while events.next_if(|event| event.tick <= notice.tick()).is_some() {
                count += 1;
            }
            let cost_ticks = count * 2_100 + 84_000;
            prop_assert!(ticks >= cost_ticks as f64 * (1.0 - 1e-6), "{} {}", ticks, cost_ticks);
        }
    }
}

#[test]
fn blocks_with_little_or_nothing_in_them() {
    for kinematics in [Kinematics::Cartesian, Kinematics::CoreXy] {
        let machine = geometry(kinematics, [80.0, 80.0, 400.0, 95.0]);
        for method in METHODS {
            let choice = choice(method, true);
            // Z alone, the filament alone, both, less than a step, a step of one motor, nothing in
            // X and Y but a step of Z.
            for (target, filament, steps) in [
                ([0, 0, 10_000], 0, [0, 0, 40, 0]),
                ([0, 0, 0], 10_000_000, [0, 0, 0, 95]),
                ([0, 0, -10_000], -10_000_000, [0, 0, 40, 95]),
                ([500, 0, 0], 0, [0; 4]),
                ([400, 400, 100], 0, [if kinematics == Kinematics::CoreXy { 1 } else { 0 }, 0, 0, 0]),
                ([200, 0, 250], 0, [0, 0, 1, 0]),
            ] {
                let player = play(machine, &choice, 4, &[request(target, filament, 20.0)], || 0);
                let made =
                    [0, 1, 2, 3].map(|bit| player.events.iter().filter(|event| event.axes >> bit & 1 == 1).count());
                assert_eq!(made, steps, "{method:?} {target:?}");
                assert!(matches!(player.notices[..], [Notice::MoveEnded { tick, line: 7 }] if tick > 0));
            }
        }
    }
}

#[test]
fn a_slow_move_s_intervals_are_longer_than_32_bits() {
    let machine = geometry(Kinematics::CoreXy, [80.0, 80.0, 400.0, 95.0]);
    for method in METHODS {
        let player = play(machine, &choice(method, true), 4, &[request([20_000, 10_000, 0], 0, 0.000_01)], || 0);
        assert_eq!(Player::motors_after(&player.events), [24, 8, 0, 0]);
        assert!(player.tick > 20 * u64::from(TICKS_PER_SECOND));
    }
}

/// The machine's pulses are those that the methods' own lines have.
#[test]
fn a_move_is_the_method_s_line() {
    let machine = geometry(Kinematics::CoreXy, [80.0, 80.0, 400.0, 95.0]);
    for (interpolation, method) in [
        (Interpolation::PointByPoint, PlaneMethod::PointByPoint),
        (Interpolation::MinimumDeviation, PlaneMethod::MinimumDeviation),
        (Interpolation::DualRate, PlaneMethod::DualRate),
    ] {
        let choice = choice(interpolation, false);
        for target in
            [[97_500, 31_250, 0], [-20_000, 61_250, 0], [-47_500, -46_250, 0], [53_750, -23_750, 0], [0, 7_500, 0]]
        {
            let player = play(machine, &choice, 4, &[request(target, 0, 5.0)], || 0);
            let [first, second, _] = machine.motor_steps(target).map(i64::from);
            let made = player.events.iter().map(|event| {
                let step = |bit: u8| match (event.axes & bit != 0, event.directions & bit != 0) {
                    (false, _) => 0i8,
                    (true, false) => 1,
                    (true, true) => -1,
                };
                [step(1), step(2)]
            });
            let line = CoreXyLine::new(method, first, second, &choice.dual_rate).unwrap();
            assert_eq!(
                made.collect::<Vec<_>>(),
                line.map(|event| event.steps).collect::<Vec<_>>(),
                "{method:?} {target:?}"
            );
        }
    }
}

#[test]
fn a_method_changes_at_standstill_only() {
    let machine = geometry(Kinematics::CoreXy, [80.0, 80.0, 400.0, 95.0]);
    let mut planner = planner(machine, &MotionChoice::DEFAULT, 8);
    let mut player = Player::default();
    planner.add(&request([500_000, 300_000, 0], 0, 20.0)).unwrap();
    let chosen = choice(Interpolation::PointByPoint, true);
    assert_eq!(planner.set_motion_choice(&chosen), Err(ChoiceError::InMotion));
    planner.flush();
    while advance(&mut planner, &mut player) == Progress::Worked {}
    assert_eq!(player.events.len(), 640);
    planner.set_motion_choice(&chosen).unwrap();
    planner.add(&request([0; 3], 0, 20.0)).unwrap();
    planner.flush();
    while advance(&mut planner, &mut player) == Progress::Worked {}
    // Both motors step in each of as many pulses.
    assert_eq!(player.events.len(), 1_280);
    assert!(player.events[640..].iter().all(|event| event.axes == 3));
}

#[test]
fn dual_rate_runs_no_motor_faster_than_t_min() {
    let machine = geometry(Kinematics::CoreXy, [160.0, 160.0, 800.0, 400.0]);
    let dual_rate = DualRatePeriods { shortest_ns: 50_000, longest_ns: 1_000_000 };
    let choice = MotionChoice { interpolation: Interpolation::DualRate, dual_rate, ..MotionChoice::DEFAULT };
    // A turns at most: 20 000 steps/s, 125 mm/s. In the dead zone likewise.
    for target in [[5_000_000, 1_000_000, 0], [5_000_000, 5_000_000, 0]] {
        let player = play(machine, &choice, 4, &[request(target, 0, 300.0)], || 0);
        let steps: Vec<_> = player.events.iter().filter(|event| event.axes & 1 != 0).collect();
        let shortest = steps.windows(2).map(|pair| pair[1].tick - pair[0].tick).min().unwrap();
        // 50 us are 4200 ticks; times are rounded.
        assert!((4_190..4_300).contains(&shortest), "{shortest}");
    }
}
