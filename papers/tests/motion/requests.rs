//! Single moves: refused, long, slow.

use ferrostep_planner::{Kinematics, MotionChoice, MoveError, Moved, TICKS_PER_SECOND};

use crate::motion::machine::{cartesian, geometry, planner, play};
use crate::motion::moves::request;

#[test]
fn bad_moves_are_refused_and_change_nothing() {
    let mut planner = planner(cartesian(), &MotionChoice::DEFAULT, 4);
    let far = 600_000_000;
    assert_eq!(planner.add(&request([far, 0, 0], 0, 10.0)), Err(MoveError::TooFar));
    assert_eq!(planner.add(&request([i64::MIN, 0, 0], 0, 10.0)), Err(MoveError::TooFar));
    assert_eq!(planner.add(&request([0; 3], i64::MIN, 10.0)), Err(MoveError::TooMuchFilament));
    for feed in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(planner.add(&request([1_000, 0, 0], 0, feed)), Err(MoveError::Feed));
    }
    assert_eq!(planner.add(&request([0; 3], 0, 10.0)), Ok(Moved::Nothing));
    assert!(planner.is_idle());
    assert_eq!(planner.position_10nm(), [0; 3]);
}

#[test]
fn a_slope_of_one_in_fifty_takes_an_entry_for_fifty_steps() {
    // 250 mm by 5 mm at constant speed: 20,000 by 400 steps, hardly any ramp.
    let machine = cartesian();
    let player = play(machine, &MotionChoice::DEFAULT, 4, &[request([25_000_000, 500_000, 0], 0, 5.0)], || 0);
    assert_eq!(player.events.len(), 20_000);
    assert!(player.entries < 450, "{}", player.entries);
}

#[test]
fn a_step_that_takes_minutes_is_waited_for() {
    // One step a millimetre and 0.01 mm/s: 100 s between steps, twice what 32 bits of ticks hold.
    let machine = geometry(Kinematics::Cartesian, [1.0, 80.0, 400.0, 95.0]);
    let player = play(machine, &MotionChoice::DEFAULT, 4, &[request([1_000_000, 0, 0], 0, 0.000_01)], || 0);
    assert_eq!(player.events.len(), 10);
    for pair in player.events.windows(2) {
        let seconds = (pair[1].tick - pair[0].tick) as f64 / f64::from(TICKS_PER_SECOND);
        // Speeds are whole multiples of 2^-16 mm/s.
        assert!((seconds - 100.0).abs() < 0.1, "{seconds}");
    }
}
