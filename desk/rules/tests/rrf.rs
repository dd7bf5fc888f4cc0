//! Tests RepRapFirmware's rules against an oracle from their definitions.

use crate::two_pass::{self, Limited};
use crate::{assert_same, plan, print};
use ferrostep_random_cases::cases;
use ferrostep_rules::rrf::{JerkPolicy, Rrf, RrfSettings};
use ferrostep_rules::{Limit, Move, Planner};
use proptest::prelude::*;

fn settings() -> RrfSettings {
    RrfSettings {
        max_feed_mm_per_s: [250.0, 200.0, 12.0, 60.0],
        max_acceleration_mm_per_s2: [3000.0, 2500.0, 150.0, 1500.0],
        jerk_mm_per_s: [10.0, 12.0, 0.5, 8.0],
        print_acceleration_mm_per_s2: 1500.0,
        travel_acceleration_mm_per_s2: 2200.0,
        ..RrfSettings::defaults()
    }
}

/// Computes a move's limits without its corner, by the *GCode dictionary* on M201, M203, M204,
/// M572.
fn limited(one: &Move, settings: &RrfSettings) -> Limited {
    let [x, y, z, e] = one.displacement_mm;
    let path = (x * x + y * y + z * z).sqrt();
    let length = if path > 0.0 { path } else { e.abs() };
    let moves_xy = x != 0.0 || y != 0.0;
    let mut acceleration = match (moves_xy, e > 0.0) {
        (true, true) => settings.print_acceleration_mm_per_s2,
        (true, false) => settings.travel_acceleration_mm_per_s2,
        (false, _) => f64::INFINITY,
    };
    let mut nominal = one.feed_mm_per_s.max(settings.min_speed_mm_per_s);
    let mut parts: Vec<(f64, f64, f64)> = (0..4)
        .map(|axis| {
            let mut most = settings.max_acceleration_mm_per_s2[axis];
            if axis == 3 && moves_xy && settings.pressure_advance_s > 0.0 {
                most = most.min(settings.jerk_mm_per_s[3] / settings.pressure_advance_s);
            }
            (one.displacement_mm[axis].abs(), settings.max_feed_mm_per_s[axis], most)
        })
        .collect();
    if settings.is_core_xy {
        let [a, b] = [x.abs() + y.abs(), (x.abs() - y.abs()).abs()];
        parts.push((a, settings.max_feed_mm_per_s[0], settings.max_acceleration_mm_per_s2[0]));
        parts.push((b, settings.max_feed_mm_per_s[1], settings.max_acceleration_mm_per_s2[1]));
    }
    for (distance, speed, most) in parts.into_iter().filter(|(distance, ..)| *distance > 0.0) {
        nominal = nominal.min(speed * length / distance);
        acceleration = acceleration.min(most * length / distance);
    }
    Limited { length, nominal, acceleration, corner: 0.0, slowest: 0.0 }
}

fn oracle(moves: &[Move], settings: &RrfSettings) -> Vec<Limited> {
    let kind = |one: &Move| {
        let [x, y, _, e] = one.displacement_mm;
        let moves_xy = x != 0.0 || y != 0.0;
        (moves_xy, moves_xy && e > 0.0, e != 0.0 && !(moves_xy && e > 0.0))
    };
    let mut all: Vec<Limited> = moves.iter().map(|one| limited(one, settings)).collect();
    for index in 1..moves.len() {
        let [before, one] = [&moves[index - 1], &moves[index]];
        if settings.jerk_policy == JerkPolicy::SameKind && kind(before) != kind(one) {
            continue;
        }
        let mut corner = all[index - 1].nominal.min(all[index].nominal);
        for axis in 0..4 {
            let jump =
                before.displacement_mm[axis] / all[index - 1].length - one.displacement_mm[axis] / all[index].length;
            corner = corner.min(settings.jerk_mm_per_s[axis] / jump.abs());
        }
        all[index].corner = corner;
    }
    all
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn with_a_ring_that_holds_the_print_moves_are_planned_as_by_the_definitions(
        moves in print(80),
        is_core_xy in any::<bool>(),
        joins_all in any::<bool>(),
        advance in prop_oneof![Just(0.0), Just(0.05)],
    ) {
        let settings = RrfSettings {
            is_core_xy,
            jerk_policy: if joins_all { JerkPolicy::Always } else { JerkPolicy::SameKind },
            pressure_advance_s: advance,
            ..settings()
        };
        // Less than half a second is waiting, so all of it is read before anything is fixed.
        let oracle = oracle(&moves, &settings);
        let all = two_pass::plan(&oracle, usize::MAX);
        let mut ring = Planner::Rrf(Rrf::new(RrfSettings { ring_length: 100, ..settings }).unwrap());
        let ours = plan(&mut ring, &moves, &[]);
        let total: f64 = all.iter().map(|one| one.duration_s).sum();
        let total_ours: f64 = ours.iter().map(|one| one.duration_s()).sum();
        if total < 2.0 {
            assert_same(&ours, &all);
        } else {
            // A look-ahead of half a second is nearly enough for all braking.
            prop_assert!(total_ours >= total * (1.0 - 1e-9), "{total_ours} s, {total} s");
            prop_assert!(total_ours < 1.02 * total, "{total_ours} s, {total} s");
        }
    }
}

#[test]
fn prints_and_travels_do_not_join_with_jerk_policy_0() {
    let moves = [[10.0, 0.0, 0.0, 0.3], [10.0, 0.0, 0.0, 0.0]].map(|parts| Move::straight(0, parts, 50.0));
    let mut planner = Planner::Rrf(Rrf::new(settings()).unwrap());
    let ours = plan(&mut planner, &moves, &[]);
    assert_eq!((ours[1].start_mm_per_s, ours[1].start_limit), (0.0, Limit::Rest));
    let always = RrfSettings { jerk_policy: JerkPolicy::Always, ..settings() };
    let ours = plan(&mut Planner::Rrf(Rrf::new(always).unwrap()), &moves, &[]);
    assert!((ours[1].start_mm_per_s - 50.0).abs() < 1e-9, "{ours:?}");
}

#[test]
fn reading_ends_with_two_seconds_of_motion() {
    let mut planner = Rrf::new(settings()).unwrap();
    let mut released = Vec::new();
    for tag in 0..50 {
        planner.push(&Move::straight(tag, [50.0, 0.0, 0.0, 2.0], 50.0), &mut released).unwrap();
        assert!(planner.queued() <= 4, "{} moves of a second wait", planner.queued());
    }
    assert!(released.len() >= 46);
}
