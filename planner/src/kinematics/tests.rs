//! Exactness of steps and positions.
#![allow(clippy::unwrap_used)]

use super::*;
use proptest::prelude::*;

fn steps(value: f64) -> StepsPerMm {
    StepsPerMm::from_f64(value).unwrap()
}

fn geometry(kinematics: Kinematics) -> Geometry {
    Geometry {
        kinematics,
        steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(95.0)],
        minimum_event_interval_ticks: 168,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    }
}

#[test]
fn halves_round_away_from_zero() {
    // 0.00625 mm is half a step at 80 steps/mm.
    assert_eq!(steps(80.0).steps(625), 1);
    assert_eq!(steps(80.0).steps(-625), -1);
    assert_eq!(steps(80.0).steps(624), 0);
    assert_eq!(steps(80.0).steps(-624), 0);
}

#[test]
fn steps_per_mm_outside_their_range_are_refused() {
    for bad in [0.0, -1.0, 0.000_001, 10_001.0, f64::NAN, f64::INFINITY] {
        assert_eq!(StepsPerMm::from_f64(bad), None, "{bad}");
    }
    assert_eq!(steps(415.305).hundred_thousandths(), 41_530_500);
    assert_eq!(StepsPerMm::clamped(41_530_500), steps(415.305));
    for (outside, end) in [(0, 1), (-1, 1), (i64::MIN, 1), (1_000_000_001, 1_000_000_000), (i64::MAX, 1_000_000_000)] {
        assert_eq!(StepsPerMm::clamped(outside).hundred_thousandths(), end);
    }
    assert_eq!(StepsPerMm::nearest(f64::NAN).hundred_thousandths(), 1);
}

#[test]
fn core_xy_turns_both_motors_for_either_axis() {
    let machine = geometry(Kinematics::CoreXy);
    assert_eq!(machine.motor_steps([1_000_000, 0, 0]), [800, 800, 0]);
    assert_eq!(machine.motor_steps([0, 1_000_000, 0]), [800, -800, 0]);
    // CoreXY paper: X = 120, Y = -30 pulses of 0.01 mm make A = 90, B = 150.
    let paper = Geometry { steps_per_mm: [steps(100.0), steps(100.0), steps(400.0), steps(95.0)], ..machine };
    assert_eq!(paper.motor_steps([120_000, -30_000, 0]), [90, 150, 0]);
}

proptest! {
    #[test]
    fn the_product_is_exact(
        coordinate in prop_oneof![-MAX_COORDINATE_10NM..=MAX_COORDINATE_10NM, (-800_000i64..800_000).prop_map(|steps| steps * 625)],
        scaled in prop_oneof![1i64..=1_000_000_000, (1i64..=10_000).prop_map(|steps| steps * 100_000), Just(8_000_000), Just(41_530_500)],
    ) {
        let value = StepsPerMm::of(scaled);
        let product = i128::from(coordinate) * i128::from(scaled);
        let half = 5_000_000_000i128;
        let expected = if product < 0 { -((-product + half) / (2 * half)) } else { (product + half) / (2 * half) };
        prop_assert_eq!(i128::from(value.steps(coordinate)), expected);
    }

    #[test]
    fn coordinates_are_those_of_double_precision(
        steps in prop_oneof![-50_000_000i64..50_000_000, -200_000i64..200_000, any::<i32>().prop_map(i64::from)],
        scaled in prop_oneof![
            1i64..=1_000_000_000,
            (1i64..=10_000).prop_map(|steps| steps * 100_000),
            (1i64..=10_000).prop_map(|steps| steps * 3_125),
            Just(8_000_000), Just(9_500_000), Just(41_530_500), Just(800_000_000),
        ],
    ) {
        let value = StepsPerMm::of(scaled);
        prop_assert_eq!(value.coordinate_10nm(steps), value.far_coordinate_10nm(steps));
        prop_assert_eq!(value.step_10nm(), 10_000_000_000 / scaled);
    }

    #[test]
    fn positions_come_back_within_half_a_step(
        position in proptest::array::uniform3(-30_000_000i64..30_000_000),
        kinematics in proptest::sample::select(&Kinematics::ALL[..]),
    ) {
        let machine = geometry(kinematics);
        let motors = machine.motor_steps(position);
        let back = machine.position_10nm(motors.map(i64::from));
        for (axis, (back, from)) in back.into_iter().zip(position).enumerate() {
            prop_assert!((back - from).abs() <= 626, "{axis}");
        }
        let from = [0, 0, position[2]].map(|units| units as i32);
        let steps = machine.motor_steps(from.map(i64::from));
        prop_assert_eq!(machine.motor_steps_from(position.map(|units| units as i32), from, steps), motors);
    }
}
