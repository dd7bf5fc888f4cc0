//! Stops in mid-motion, and choices that wait for a standstill.

use ferrostep_planner::{AccelerationProfile, ChoiceError, Kinematics, MotionChoice, Progress};

use crate::motion::machine::{advance, cartesian, geometry, planner, under};
use crate::motion::moves::request;
use crate::motion::player::Player;

#[test]
fn after_a_stop_motion_goes_on_from_where_the_motors_stand() {
    for law in AccelerationProfile::ALL {
        goes_on_after_a_stop(law);
    }
}

fn goes_on_after_a_stop(law: AccelerationProfile) {
    let machine = geometry(Kinematics::CoreXy, [160.0, 160.0, 800.0, 400.0]);
    let mut planner = planner(machine, &under(law), 8);
    let mut player = Player::default();
    planner.add(&request([5_000_000, 3_000_000, 0], 100_000_000, 100.0)).unwrap();
    planner.flush();
    for _ in 0..500 {
        advance(&mut planner, &mut player);
    }
    let motors = Player::motors_after(&player.events);
    planner.reset_to(motors, player.tick, player.directions);
    assert!(planner.is_idle());
    let here = planner.position_10nm();
    assert_eq!(machine.motor_steps(here).map(i64::from), [motors[0], motors[1], motors[2]]);
    planner.add(&request([0; 3], 0, 100.0)).unwrap();
    planner.flush();
    while advance(&mut planner, &mut player) == Progress::Worked {}
    assert_eq!(Player::motors_after(&player.events)[..3], [0, 0, 0]);
}

#[test]
fn the_law_changes_at_a_standstill_only() {
    let machine = cartesian();
    let mut planner = planner(machine, &MotionChoice::DEFAULT, 8);
    let choice = |acceleration, jerk_mm_per_s3, top_hz| {
        let mut choice = MotionChoice { acceleration, jerk_mm_per_s3, ..MotionChoice::DEFAULT };
        choice.s_curve_table.top_hz = top_hz;
        choice
    };
    let good = choice(AccelerationProfile::SCurve, 5_000.0, 2_000);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let refused = planner.set_motion_choice(&choice(AccelerationProfile::SCurve, bad, 2_000));
        assert_eq!(refused, Err(ChoiceError::Parameter));
    }
    let refused = planner.set_motion_choice(&choice(AccelerationProfile::SCurveTable, 1.0, 1_000));
    assert_eq!(refused, Err(ChoiceError::Parameter));
    assert_eq!(*planner.motion_choice(), MotionChoice::DEFAULT);
    planner.add(&request([1_000_000, 0, 0], 0, 50.0)).unwrap();
    assert_eq!(planner.set_motion_choice(&good), Err(ChoiceError::InMotion));
    planner.flush();
    let mut player = Player::default();
    while advance(&mut planner, &mut player) == Progress::Worked {}
    let trapezoid = planner.motion_ticks();
    planner.set_motion_choice(&good).unwrap();
    planner.add(&request([0; 3], 0, 50.0)).unwrap();
    planner.flush();
    while advance(&mut planner, &mut player) == Progress::Worked {}
    assert_eq!(player.events.len(), 1_600);
    // Less jerk takes longer.
    assert!(planner.motion_ticks() > 2 * trapezoid + trapezoid / 10);
}
