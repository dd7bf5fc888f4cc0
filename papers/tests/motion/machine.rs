//! Machines, and their results for given moves.

use ferrostep_papers::Papers;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AccelerationProfile, Geometry, Kinematics, Limits, MotionChoice, Move, MoveError, PlannedBlock, Planner, Progress,
    StepsPerMm,
};
use proptest::prelude::*;

use crate::motion::player::Player;

pub const MINIMUM_INTERVAL: u32 = 168;

/// The default method under another acceleration law.
pub fn under(acceleration: AccelerationProfile) -> MotionChoice {
    MotionChoice { acceleration, ..MotionChoice::DEFAULT }
}

/// The default method under any acceleration law.
pub fn accelerations() -> impl Strategy<Value = MotionChoice> {
    proptest::sample::select(&AccelerationProfile::ALL[..]).prop_map(under)
}

pub fn geometry(kinematics: Kinematics, steps_per_mm: [f64; 4]) -> Geometry {
    Geometry {
        kinematics,
        steps_per_mm: steps_per_mm.map(|steps| StepsPerMm::from_f64(steps).unwrap()),
        minimum_event_interval_ticks: MINIMUM_INTERVAL,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    }
}

pub fn limits() -> Limits {
    Limits {
        max_feed_mm_per_s: [300.0, 250.0, 15.0, 60.0],
        max_acceleration_mm_per_s2: [5000.0, 4000.0, 300.0, 5000.0],
        print_acceleration_mm_per_s2: 2000.0,
        travel_acceleration_mm_per_s2: 3000.0,
        retract_acceleration_mm_per_s2: 1500.0,
        junction_deviation_mm: 0.05,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; 4],
    }
}

/// The machine of most examples.
pub fn cartesian() -> Geometry {
    geometry(Kinematics::Cartesian, [80.0, 80.0, 400.0, 95.0])
}

/// Steps per millimetre of typical machines.
pub fn usual_steps() -> impl Strategy<Value = [f64; 4]> {
    prop_oneof![
        Just([80.0, 80.0, 400.0, 95.0]),
        Just([160.0, 160.0, 800.0, 400.0]),
        Just([100.33, 99.87, 401.5, 415.3])
    ]
}

/// Machines of all kinematics with these steps per millimetre.
pub fn machines_with(steps: impl Strategy<Value = [f64; 4]>) -> impl Strategy<Value = Geometry> {
    (proptest::sample::select(&Kinematics::ALL[..]), steps).prop_map(|(kinematics, steps)| geometry(kinematics, steps))
}

pub fn machines() -> impl Strategy<Value = Geometry> {
    machines_with(usual_steps())
}

pub fn planner(geometry: Geometry, choice: &MotionChoice, ring: usize) -> Planner<Vec<Slot>, Papers> {
    let mut planner = Planner::new(geometry, limits(), vec![Slot::EMPTY; ring]);
    planner.set_motion_choice(choice).unwrap();
    planner
}

/// Advances, and checks that the planner keeps to the room that a queue must have.
pub fn advance(planner: &mut Planner<Vec<Slot>, Papers>, player: &mut Player) -> Progress {
    let before = player.entries;
    let progress = planner.advance(player);
    assert!(player.entries - before <= ferrostep_planner::interpolator::MAX_ENTRIES);
    progress
}

/// Plays a job of moves and returns everything that it becomes.
pub fn play(
    geometry: Geometry,
    choice: &MotionChoice,
    ring: usize,
    moves: &[Move],
    mut pause: impl FnMut() -> usize,
) -> Player {
    let mut planner = planner(geometry, choice, ring);
    let mut player = Player::default();
    for each in moves {
        for _ in 0..pause() {
            advance(&mut planner, &mut player);
        }
        while let Err(MoveError::NoRoom) = planner.add(each) {
            assert_eq!(advance(&mut planner, &mut player), Progress::Worked);
        }
    }
    planner.flush();
    while advance(&mut planner, &mut player) == Progress::Worked {}
    assert!(planner.is_idle());
    player
}

/// Blocks of the same plan.
pub fn blocks(geometry: Geometry, choice: &MotionChoice, ring: usize, moves: &[Move]) -> Vec<PlannedBlock> {
    let mut planner = planner(geometry, choice, ring);
    let mut blocks = Vec::new();
    for each in moves {
        while let Err(MoveError::NoRoom) = planner.add(each) {
            blocks.extend(planner.next_planned());
        }
    }
    planner.flush();
    while let Some(block) = planner.next_planned() {
        blocks.push(block);
    }
    blocks
}
