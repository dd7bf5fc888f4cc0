//! Blocks leave the look-ahead ring before the one after them has come, where its start is
//! foreseen. The plan is that of a full ring.
#![allow(clippy::unwrap_used)]

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    Geometry, Kinematics, Limits, Move, MoveError, PlannedBlock, Planner, StepsPerMm, TICKS_PER_SECOND,
};
use proptest::prelude::*;

/// Capacity above the blocks of any path of these tests.
const AMPLE: usize = 400;

/// A machine whose processor needs so long for an event and for a move, ticks.
fn planner(event_cost_ticks: u32, move_cost_ticks: u32, ring: usize) -> Planner<Vec<Slot>> {
    let steps = |value| StepsPerMm::from_f64(value).unwrap();
    let geometry = Geometry {
        kinematics: Kinematics::CoreXy,
        steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(95.0)],
        minimum_event_interval_ticks: 168,
        event_cost_ticks,
        move_cost_ticks,
    };
    let limits = Limits {
        max_feed_mm_per_s: [200.0, 200.0, 10.0, 60.0],
        max_acceleration_mm_per_s2: [1500.0, 1500.0, 100.0, 5000.0],
        print_acceleration_mm_per_s2: 1000.0,
        travel_acceleration_mm_per_s2: 1000.0,
        retract_acceleration_mm_per_s2: 1500.0,
        junction_deviation_mm: 0.1,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; 4],
    };
    let mut planner = Planner::new(geometry, limits, vec![Slot::EMPTY; ring]);
    planner.set_position([10_000_000; 3]);
    planner
}

/// Runs of pieces in one direction, most of them too short for a block of their own, with corners
/// between the runs.
fn path() -> impl Strategy<Value = Vec<Move>> {
    let length = prop_oneof![3 => 20i64..2_000, 3 => 2_000i64..60_000, 1 => 60_000i64..3_000_000];
    let filament = prop_oneof![1 => Just(0i64), 1 => 0i64..100, 2 => 0i64..1_700_000, 1 => -20_000_000i64..20_000_000];
    let run = (length, 0u32..8, 1usize..12, prop_oneof![Just(20f32), Just(80.0), Just(200.0)], filament);
    proptest::collection::vec(run, 2..40).prop_map(|runs| {
        let mut target_10nm = [10_000_000i64; 3];
        let mut line = 0;
        let mut moves = Vec::new();
        for (length, eighth, pieces, feed_mm_per_s, filament_100pm) in runs {
            let (x, y) = f64::from(eighth * 45 + 7).to_radians().sin_cos();
            // Each piece is a little shorter than the one before it.
            for piece in 0..pieces as i64 {
                let length = (length - piece * (length / 16)) as f64;
                target_10nm[0] = (target_10nm[0] + (x * length) as i64).clamp(0, 20_000_000);
                target_10nm[1] = (target_10nm[1] + (y * length) as i64).clamp(0, 20_000_000);
                line += 1;
                moves.push(Move { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move: true });
            }
        }
        moves
    })
}

/// The blocks of a path as they leave. After each move `then` may ask for what is certain,
/// and let it leave.
fn blocks(
    mut planner: Planner<Vec<Slot>>,
    path: &[Move],
    mut then: impl FnMut(&mut Planner<Vec<Slot>>, &mut Vec<PlannedBlock>),
) -> Vec<PlannedBlock> {
    let mut blocks = Vec::new();
    for request in path {
        while planner.add(request) == Err(MoveError::NoRoom) {
            blocks.extend(planner.next_planned());
        }
        then(&mut planner, &mut blocks);
    }
    planner.flush();
    blocks.extend(std::iter::from_fn(|| planner.next_planned()));
    blocks
}

/// Takes the blocks that are certain.
fn take_certain(planner: &mut Planner<Vec<Slot>>, blocks: &mut Vec<PlannedBlock>) {
    planner.certain_ticks(0);
    while planner.release_final() {
        blocks.extend(planner.next_planned());
    }
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(512))]
    #[test]
    fn no_speed_depends_on_what_was_foreseen(
        path in path(), event_cost in 0u32..30_000, move_cost in 0u32..200_000, ring in 2usize..40, whenever in any::<u128>(),
    ) {
        let planner = || planner(event_cost, move_cost, ring);
        let patient = blocks(planner(), &path, |_, _| {});
        let mut turn = 0;
        let eager = blocks(planner(), &path, |planner, blocks| {
            turn += 1;
            if whenever >> (turn % 128) & 1 == 1 {
                take_certain(planner, blocks);
            }
        });
        prop_assert_eq!(eager.len(), patient.len());
        for (eager, patient) in eager.iter().zip(&patient) {
            prop_assert_eq!(eager, patient);
        }
    }

    /// The blocks that leave last at least as long as is said to be certain. (Longer where they
    /// cannot speed up so much.)
    #[test]
    fn what_is_certain_lasts_as_long_as_it_is_said_to(path in path()) {
        let mut certain_ticks = 0;
        let mut planner = planner(210, 10_500, AMPLE);
        for request in &path {
            planner.add(request).unwrap();
            certain_ticks = planner.certain_ticks(0);
        }
        let before = planner.motion_ticks();
        while planner.release_final() {
            planner.next_planned();
        }
        prop_assert!(planner.motion_ticks() - before >= certain_ticks);
    }
}

/// A line, and a short move around its corner, which stays open: the corner is slow enough to stop
/// within the short move, so that the line's end is known.
#[test]
fn a_line_leaves_when_the_short_move_after_it_is_open() {
    let at = |x: i64, y: i64, line| {
        let target_10nm = [10_000_000 + x * 1_000, 10_000_000 + y * 1_000, 10_000_000];
        Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 100.0, line, ends_move: true }
    };
    let mut planner = planner(210, 10_500, AMPLE);
    planner.add(&at(5_000, 0, 1)).unwrap();
    assert_eq!(planner.certain_ticks(0), 0, "the end of a lone line is open");
    assert!(planner.unsettled_ticks() > 0);
    // 0.4 mm around a right angle.
    planner.add(&at(5_000, 40, 2)).unwrap();
    let certain_ticks = planner.certain_ticks(0);
    assert!(certain_ticks > u64::from(TICKS_PER_SECOND) / 2, "50 mm: {certain_ticks}");
    let unsettled = planner.unsettled_ticks();
    assert!((1..u64::from(TICKS_PER_SECOND) / 100).contains(&unsettled), "0.4 mm: {unsettled}");
    assert!(planner.release_final());
    let line = planner.next_planned().unwrap();
    assert_eq!(line.block.line, 1);
    assert!(line.exit.mm_per_s() > 10.0, "{}", line.exit.mm_per_s());
    assert_eq!(planner.next_planned(), None, "the short move may still grow");
    // The last move joins the block.
    planner.add(&at(5_000, 60, 3)).unwrap();
    assert_eq!(planner.merged_moves(), 1);
    planner.flush();
    let short = planner.next_planned().unwrap();
    assert_eq!((short.block.line, short.entry, short.exit.mm_per_s()), (3, line.exit, 0.0));
}
