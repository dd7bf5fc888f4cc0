//! Tests properties of every plan, by any rules.

use crate::{plan, print};
use ferrostep_random_cases::cases;
use ferrostep_rules::klipper::{Klipper, KlipperSettings, MAX_QUEUED_MOVES};
use ferrostep_rules::marlin::{Corner, JerkRule, Marlin, MarlinSettings, SlowestSpeed};
use ferrostep_rules::rrf::{Rrf, RrfSettings};
use ferrostep_rules::{Limit, Move, PlannedMove, Planner, Rules};
use proptest::prelude::*;

/// Returns a planner at rest for each of the rules and machines tested.
fn planners() -> Vec<(&'static str, Planner)> {
    let deviation = Corner::JunctionDeviation { deviation_mm: 0.05, handles_small_segments: true };
    let jerk = |rule| Corner::ClassicJerk { jerk_mm_per_s: [8.0, 8.0, 2.0, 10.0], rule };
    let marlin = |corner| Planner::Marlin(Marlin::new(MarlinSettings::example(corner)).unwrap());
    let first_step = MarlinSettings {
        slowest: SlowestSpeed::FirstStep,
        steps_per_mm: Some([80.0, 80.0, 400.0, 93.0]),
        min_steps_per_segment: 1,
        ..MarlinSettings::example(deviation)
    };
    let klipper = KlipperSettings::with_defaults(300.0, 4000.0, 0.4, 1.75);
    vec![
        ("klipper", Planner::Klipper(Klipper::new(klipper).unwrap())),
        ("marlin, deviation", marlin(deviation)),
        ("marlin, jerk", marlin(jerk(JerkRule::SafeSpeed))),
        ("marlin, difference", marlin(jerk(JerkRule::Difference))),
        ("marlin, first step", Planner::Marlin(Marlin::new(first_step).unwrap())),
        ("rrf", Planner::Rrf(Rrf::new(RrfSettings::defaults()).unwrap())),
    ]
}

fn assert_sound(name: &str, moves: &[Move], plan: &[PlannedMove]) {
    let mut before: Option<&PlannedMove> = None;
    for one in plan {
        assert!(one.duration_s().is_finite() && one.duration_s() > 0.0, "{name}: {one:?}");
        let phases = [one.accelerate_s, one.cruise_s, one.decelerate_s];
        assert!(phases.iter().all(|time| *time >= -1e-12), "{name}: {one:?}");
        assert!((one.travelled_mm() - one.length_mm).abs() <= 1e-9 * (1.0 + one.length_mm), "{name}: {one:?}");
        let slack = 1e-9 * (1.0 + one.cruise_mm_per_s);
        assert!(one.start_mm_per_s <= one.cruise_mm_per_s + slack, "{name}: {one:?}");
        assert!(one.end_mm_per_s <= one.cruise_mm_per_s + slack, "{name}: {one:?}");
        let asked = moves[one.tag as usize].feed_mm_per_s;
        assert!(one.cruise_mm_per_s <= asked.max(0.5) + slack, "{name}: {one:?}, asked {asked} mm/s");
        // A first step may be faster than the acceleration allows.
        let gain = 2.0 * one.acceleration_mm_per_s2 * one.length_mm;
        let change = (one.end_mm_per_s.powi(2) - one.start_mm_per_s.powi(2)).abs();
        if name != "marlin, first step" {
            assert!(change <= gain * (1.0 + 1e-9) + 1e-2, "{name}: {one:?}");
        }
        if let Some(before) = before {
            let jump = (before.end_mm_per_s - one.start_mm_per_s).abs();
            assert!(jump <= 1e-9 * (1.0 + one.start_mm_per_s), "{name}: {before:?} and {one:?}");
            assert!(before.tag < one.tag, "{name}: {before:?} and {one:?}");
        }
        before = Some(one);
    }
}

proptest! {
    #![proptest_config(cases(128))]

    #[test]
    fn speeds_join_are_reachable_and_make_the_length(moves in print(200)) {
        for (name, mut planner) in planners() {
            let plan = plan(&mut planner, &moves, &[]);
            if name != "marlin, first step" {
                prop_assert_eq!(plan.len(), moves.len());
            }
            prop_assert_eq!(planner.queued(), 0);
            assert_sound(name, &moves, &plan);
        }
    }

    #[test]
    fn a_speed_asked_for_twice_as_high_never_takes_longer_by_much(moves in print(60)) {
        let faster: Vec<Move> = moves.iter().map(|one| Move { feed_mm_per_s: 2.0 * one.feed_mm_per_s, ..*one }).collect();
        for (name, planner) in planners() {
            let total = |moves: &[Move]| plan(&mut planner.clone(), moves, &[]).iter().map(PlannedMove::duration_s).sum::<f64>();
            let [slow, fast] = [total(&moves), total(&faster)];
            prop_assert!(fast <= slow * 1.1 + 0.01, "{name}: {slow} s, then {fast} s");
        }
    }
}

#[test]
fn queues_do_not_grow_with_the_print() {
    for (name, mut planner) in planners() {
        let mut released = Vec::new();
        let mut most = 0;
        let mut count = 0;
        for tag in 0..60_000u64 {
            let angle = tag as f64 * 0.01;
            let one = Move::straight(tag, [0.3 * angle.cos(), 0.3 * angle.sin(), 0.0, 0.01], 120.0);
            planner.push(&one, &mut released).unwrap();
            most = most.max(planner.queued());
            count += released.len();
            released.clear();
        }
        planner.flush(&mut released);
        assert_eq!(count + released.len(), 60_000, "{name}");
        assert!(most < 1000, "{name}: {most} moves wait");
    }
}

#[test]
fn klipper_s_queue_has_an_end() {
    let settings = KlipperSettings::with_defaults(1e6, 1.0, 0.4, 1.75);
    let mut planner = Klipper::new(settings).unwrap();
    let mut released = Vec::new();
    // Moves of a micrometre, with a speed that would take thousands of kilometres to reach.
    let count = MAX_QUEUED_MOVES as u64 + 10;
    for tag in 0..count {
        planner.push(&Move::straight(tag, [1e-3, 0.0, 0.0, 0.0], 1e5), &mut released).unwrap();
        assert!(planner.queued() <= MAX_QUEUED_MOVES);
    }
    planner.flush(&mut released);
    assert_eq!(released.len() as u64, count);
    assert_eq!(planner.forced_flushes(), 1);
}

#[test]
fn nothing_is_made_of_what_has_no_length_and_bad_numbers_are_refused() {
    for (name, mut planner) in planners() {
        let mut released = Vec::new();
        planner.push(&Move::straight(7, [0.0; 4], 50.0), &mut released).unwrap();
        planner.flush(&mut released);
        assert!(released.is_empty(), "{name}");
        let bad = [([f64::NAN, 0.0, 0.0, 0.0], 50.0), ([1.0, 0.0, 0.0, 0.0], 0.0), ([1.0, 0.0, 0.0, 0.0], -1.0)];
        for (parts, feed) in bad {
            let error = planner.push(&Move::straight(9, parts, feed), &mut released).unwrap_err();
            assert_eq!(error.tag, 9, "{name}: {error}");
        }
        planner.push(&Move::straight(10, [5.0, 0.0, 0.0, 0.0], f64::MIN_POSITIVE.sqrt()), &mut released).unwrap();
        planner.flush(&mut released);
        assert_eq!(released.len(), 1, "{name}");
    }
}

#[test]
fn rules_are_read_by_their_names() {
    for rules in Rules::ALL {
        assert_eq!(rules.name().parse(), Ok(rules));
    }
    let error = "smoothie".parse::<Rules>().unwrap_err().to_string();
    assert!(error.contains("\"smoothie\"") && error.contains("marlin-classic-jerk"), "{error}");
}

#[test]
fn a_plan_names_the_limit_that_takes_most_time() {
    for (name, mut planner) in planners() {
        let plan = plan(&mut planner, &[Move::straight(0, [200.0, 0.0, 0.0, 0.0], 50.0)], &[]);
        assert_eq!(plan[0].limit(), Limit::AskedSpeed, "{name}");
    }
}
