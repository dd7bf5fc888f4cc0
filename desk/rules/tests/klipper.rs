//! Tests Klipper's rules against an oracle from its documentation, and against figures in it.

use crate::two_pass::{self, Limited};
use crate::{assert_same, plan, print};
use ferrostep_random_cases::cases;
use ferrostep_rules::klipper::{FlushTimes, Klipper, KlipperSettings};
use ferrostep_rules::{Axis, Limit, Move, PlannedMove, Planner};
use proptest::prelude::*;

fn settings() -> KlipperSettings {
    KlipperSettings {
        max_z_velocity_mm_per_s: 15.0,
        max_z_accel_mm_per_s2: 350.0,
        ..KlipperSettings::with_defaults(300.0, 3000.0, 0.4, 1.75)
    }
}

fn planned(settings: KlipperSettings, moves: &[Move]) -> Vec<PlannedMove> {
    plan(&mut Planner::Klipper(Klipper::new(settings).unwrap()), moves, &[])
}

fn square(feed: f64, size: f64) -> Vec<Move> {
    [[size, 0.0], [0.0, size], [-size, 0.0], [0.0, -size]]
        .into_iter()
        .enumerate()
        .map(|(tag, [x, y])| Move::straight(tag as u64, [x, y, 0.0, 0.03 * size], feed))
        .collect()
}

#[test]
fn a_corner_of_90_degrees_is_taken_at_the_square_corner_velocity() {
    let ours = planned(settings(), &square(100.0, 20.0));
    assert!(ours[1..].iter().all(|one| (one.start_mm_per_s - 5.0).abs() < 1e-9), "{ours:?}");
    assert_eq!(ours[1].start_limit, Limit::Corner);
    assert_eq!(ours[1].cruise_limit, Limit::AskedSpeed);
}

#[test]
fn a_short_move_reaches_what_the_slower_acceleration_reaches() {
    let ours = planned(settings(), &square(200.0, 4.0)[..1]);
    // 2 mm of braking at half of 3000 mm/s^2.
    assert!((ours[0].cruise_mm_per_s - (3000.0f64 * 0.5 * 4.0).sqrt()).abs() < 1e-9);
    assert_eq!(ours[0].cruise_limit, Limit::CruiseRatio);
    let without = KlipperSettings { minimum_cruise_ratio: 0.0, ..settings() };
    let ours = planned(without, &square(200.0, 4.0)[..1]);
    assert!((ours[0].cruise_mm_per_s - (3000.0f64 * 4.0).sqrt()).abs() < 1e-9);
    assert_eq!(ours[0].cruise_limit, Limit::ShortMove);
}

#[test]
fn limits_have_their_names() {
    let moves = [
        Move::straight(0, [200.0, 0.0, 0.0, 0.0], 500.0),
        Move::straight(1, [0.0, 0.0, 20.0, 0.0], 100.0),
        Move::straight(2, [0.0, 0.0, 0.0, -30.0], 500.0),
        Move::straight(3, [50.0, 0.0, 0.0, 1.0], 100.0),
        Move::straight(4, [50.0, 0.0, 0.0, 8.0], 100.0),
    ];
    let ours = planned(settings(), &moves);
    let cruise: Vec<Limit> = ours.iter().map(|one| one.cruise_limit).collect();
    let asked = Limit::AskedSpeed;
    assert_eq!(cruise[..4], [Limit::MachineSpeed, Limit::AxisSpeed(Axis::Z), Limit::AxisSpeed(Axis::E), asked]);
    assert_eq!(ours[4].start_limit, Limit::FilamentCorner);
    assert!((ours[4].start_mm_per_s - 1.0 / (8.0 / 50.0 - 1.0 / 50.0)).abs() < 1e-9);
    assert_eq!(ours[1].acceleration_limit, Limit::AxisAcceleration(Axis::Z));
}

/// Computes limits by the documented rules, without a minimum cruise ratio.
fn oracle(moves: &[Move], settings: &KlipperSettings) -> Vec<Limited> {
    let mut all: Vec<Limited> = Vec::new();
    for (index, one) in moves.iter().enumerate() {
        let [x, y, z, e] = one.displacement_mm;
        let path = (x * x + y * y + z * z).sqrt();
        let length = if path > 0.0 { path } else { e.abs() };
        let (mut nominal, mut acceleration) = if path > 0.0 {
            (one.feed_mm_per_s.min(settings.max_velocity_mm_per_s), settings.max_accel_mm_per_s2)
        } else {
            (one.feed_mm_per_s, f64::INFINITY)
        };
        if z != 0.0 {
            nominal = nominal.min(settings.max_z_velocity_mm_per_s * length / z.abs());
            acceleration = acceleration.min(settings.max_z_accel_mm_per_s2 * length / z.abs());
        }
        if e < 0.0 || (e > 0.0 && x == 0.0 && y == 0.0) {
            nominal = nominal.min(settings.max_extrude_only_velocity_mm_per_s * length / e.abs());
            acceleration = acceleration.min(settings.max_extrude_only_accel_mm_per_s2 * length / e.abs());
        }
        let mut corner = 0.0;
        if let Some((before, last)) = index.checked_sub(1).map(|before| (&moves[before], all[before])) {
            let [x_before, y_before, z_before, e_before] = before.displacement_mm;
            if path > 0.0 && before.path_mm() > 0.0 {
                corner = nominal.min(last.nominal);
                let flow = (e / length - e_before / last.length).abs();
                corner = corner.min(settings.instantaneous_corner_velocity_mm_per_s / flow);
                let cosine = -(x * x_before + y * y_before + z * z_before) / (length * last.length);
                let [sine, cosine] = [0.5 * (1.0 - cosine), 0.5 * (1.0 + cosine)].map(|square| square.max(0.0).sqrt());
                if sine < 1.0 && cosine > 0.0 {
                    let deviation = settings.square_corner_velocity_mm_per_s.powi(2) * (2f64.sqrt() - 1.0)
                        / settings.max_accel_mm_per_s2;
                    for (acceleration, length) in [(acceleration, length), (last.acceleration, last.length)] {
                        let by_deviation = deviation * sine / (1.0 - sine);
                        let by_length = 0.5 * length * sine / cosine;
                        corner = corner.min((acceleration * by_deviation.min(by_length)).sqrt());
                    }
                }
            }
        }
        all.push(Limited { length, nominal, acceleration, corner, slowest: 0.0 });
    }
    all
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn moves_are_planned_as_by_the_documents(moves in print(80), scv in 0.5f64..15.0) {
        let settings = KlipperSettings {
            minimum_cruise_ratio: 0.0,
            square_corner_velocity_mm_per_s: scv,
            flush_times: FlushTimes::NEVER,
            ..settings()
        };
        assert_same(&planned(settings, &moves), &two_pass::plan(&oracle(&moves, &settings), usize::MAX));
    }

    #[test]
    fn what_is_released_early_is_planned_as_with_all_known(moves in print(400), ratio in 0.0f64..0.95) {
        let early = KlipperSettings { minimum_cruise_ratio: ratio, ..settings() };
        let late = KlipperSettings { flush_times: FlushTimes::NEVER, ..early };
        let [early, late] = [early, late].map(|settings| planned(settings, &moves));
        let total = |moves: &[PlannedMove]| moves.iter().map(PlannedMove::duration_s).sum::<f64>();
        prop_assert_eq!(early.len(), late.len());
        prop_assert!((total(&early) - total(&late)).abs() < 1e-3 * total(&late));
    }
}
