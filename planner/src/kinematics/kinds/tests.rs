//! Properties that every kinematics must have, and their consequences.

use core::num::Wrapping;

use super::*;
use proptest::prelude::*;

proptest! {
    #[test]
    fn every_kinematics_is_linear_and_undone(
        from in proptest::array::uniform3(-500_000_000_i32..=500_000_000),
        to in proptest::array::uniform3(-500_000_000_i32..=500_000_000),
    ) {
        let (wide_from, wide_to) = (from.map(i64::from), to.map(i64::from));
        for kinematics in Kinematics::ALL {
            let motors = kinematics.motors(wide_from);
            prop_assert_eq!(kinematics.position(motors), wide_from);
            prop_assert_eq!(kinematics.motors(from.map(Wrapping)).map(|motor| i64::from(motor.0)), motors);
            let sum = [0, 1, 2].map(|axis| wide_from[axis] + wide_to[axis]);
            let [one, other, both] = [wide_from, wide_to, sum].map(|position| kinematics.motors(position));
            prop_assert_eq!([0, 1, 2].map(|motor| one[motor] + other[motor]), both);
            let mm = wide_from.map(|units| units as f64);
            prop_assert_eq!(kinematics.position(kinematics.motors(mm)), mm);
        }
    }
}

#[test]
fn names_are_told_apart() {
    for kinematics in Kinematics::ALL {
        assert_eq!(Kinematics::named(kinematics.name()), Some(kinematics));
    }
    assert_eq!(Kinematics::named("delta"), None);
}

#[test]
fn axes_and_motors_hold_each_other() {
    for (kinematics, axes_of_x, axes_of_z) in
        [(Kinematics::Cartesian, 0b001, 0b100), (Kinematics::CoreXy, 0b011, 0b100), (Kinematics::CoreXz, 0b101, 0b101)]
    {
        assert_eq!(kinematics.axes_of_motors(0b0001), axes_of_x);
        assert_eq!(kinematics.axes_of_motors(0b1100), axes_of_z | 0b1000);
        // All kinematics are symmetric: if a motor moves an axis, the axis is moved by that motor.
        assert_eq!(kinematics.motors_of_axis(0), axes_of_x);
        assert_eq!(kinematics.shares_motors(0), axes_of_x != 0b001);
        assert!(!Kinematics::CoreXz.shares_motors(1));
    }
}

#[test]
fn motors_are_fastest_on_a_diagonal() {
    let axes = [500.0, 400.0, 20.0];
    assert_eq!(Kinematics::Cartesian.largest_motor_feeds(axes), axes);
    assert_eq!(Kinematics::CoreXy.largest_motor_feeds(axes), [900.0, 900.0, 20.0]);
    assert_eq!(Kinematics::CoreXz.largest_motor_feeds(axes), [520.0, 400.0, 520.0]);
}
