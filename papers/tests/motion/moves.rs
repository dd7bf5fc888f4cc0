//! Moves to be planned.

use ferrostep_planner::Move;
use proptest::prelude::*;

/// Moves of every kind: long and shorter than a step, with and without filament, filament alone.
pub fn moves_up_to(farthest_10nm: i64, most: usize) -> impl Strategy<Value = Vec<Move>> {
    let coordinate = prop_oneof![-2_000i64..2_000, -200_000i64..200_000, -farthest_10nm..farthest_10nm];
    let filament = prop_oneof![Just(0i64), -50_000i64..50_000, -20_000_000i64..20_000_000];
    let one = (
        proptest::array::uniform3(coordinate),
        0u8..8,
        filament,
        prop_oneof![0.5f32..20.0, 20.0f32..400.0],
        any::<bool>(),
    );
    proptest::collection::vec(one, 1..most).prop_map(|list| {
        let mut target = [0i64; 3];
        (1..)
            .zip(list)
            .map(|(line, (delta, which, filament_100pm, feed_mm_per_s, ends_move))| {
                for axis in 0..3 {
                    // Z moves less, and rarely.
                    let delta = if axis == 2 { delta[axis] / 20 } else { delta[axis] };
                    if which >> axis & 1 == 1 {
                        target[axis] += delta;
                    }
                }
                Move { target_10nm: target, filament_100pm, feed_mm_per_s, line, ends_move }
            })
            .collect()
    })
}

/// Enough moves to fill any ring here.
pub fn moves() -> impl Strategy<Value = Vec<Move>> {
    moves_up_to(8_000_000, 40)
}

/// Short moves that continue nearly in the direction of the previous ones, some of them in units
/// that suit the motors.
pub fn short_moves() -> impl Strategy<Value = Vec<Move>> {
    let one = (prop_oneof![Just(5_000i64), Just(1_250), 1_000i64..20_000], -3i64..=3, any::<u8>(), any::<bool>());
    let directions = (0usize..6, prop_oneof![Just(0i64), 1i64..100], 10.0f32..100.0);
    (directions, proptest::collection::vec(one, 2..120)).prop_map(|((direction, filament, feed_mm_per_s), list)| {
        let [dx, dy] = [[1, 0], [0, 1], [-1, 1], [2, 1], [-3, -1], [5, 4]][direction];
        let mut target = [0i64; 3];
        (1..)
            .zip(list)
            .map(|(line, (length, off, turn, ends_move))| {
                target[0] += dx * length + if turn < 30 { off } else { 0 };
                target[1] += dy * length + if turn < 20 { off * 40 } else { 0 };
                let filament_100pm = filament * length / 10;
                Move { target_10nm: target, filament_100pm, feed_mm_per_s, line, ends_move: ends_move || turn > 20 }
            })
            .collect()
    })
}

pub fn request(target_10nm: [i64; 3], filament_100pm: i64, feed_mm_per_s: f32) -> Move {
    Move { target_10nm, filament_100pm, feed_mm_per_s, line: 7, ends_move: true }
}
