//! Tests the rules against independently written oracles, and properties of every plan.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod arcs;
mod changes;
mod klipper;
mod marlin;
mod properties;
mod rrf;
mod two_pass;

use ferrostep_rules::{Move, PlannedMove, Planner};
use proptest::prelude::*;

/// Plans moves; motion ends after those in `stops`.
fn plan(planner: &mut Planner, moves: &[Move], stops: &[usize]) -> Vec<PlannedMove> {
    let mut released = Vec::new();
    for (index, one) in moves.iter().enumerate() {
        planner.push(one, &mut released).unwrap();
        if stops.contains(&index) {
            planner.flush(&mut released);
        }
    }
    planner.flush(&mut released);
    released
}

/// Generates a move of a print: short and long lines, travels, retractions, lifts, wipes.
fn displacement() -> impl Strategy<Value = [f64; 4]> {
    let line = (-2.5f64..2.0, 0.0f64..std::f64::consts::TAU, 0usize..4);
    let in_plane = line.prop_map(|(size, angle, kind)| {
        let length = 10f64.powf(size);
        [length * angle.cos(), length * angle.sin(), 0.0, length * [0.0, 0.033, 0.04, -0.05][kind]]
    });
    prop_oneof![
        12 => in_plane,
        1 => (-2.0f64..2.0).prop_filter("no length", |e| e.abs() > 1e-3).prop_map(|e| [0.0, 0.0, 0.0, e]),
        1 => prop_oneof![Just(0.2), Just(-0.2), Just(0.6)].prop_map(|z| [0.0, 0.0, z, 0.0]),
        1 => (-3.0f64..3.0, -3.0f64..3.0, 0.01f64..1.0).prop_map(|(x, y, z)| [x, y, z, 0.05]),
    ]
}

/// Generates a print: moves with their speeds, many of which continue in nearly the direction of
/// the previous one.
fn print(most: usize) -> impl Strategy<Value = Vec<Move>> {
    let speed = prop_oneof![Just(20.0), Just(45.0), Just(80.0), Just(150.0), 1.0f64..400.0];
    proptest::collection::vec((displacement(), speed, any::<bool>(), -0.3f64..0.3), 1..most).prop_map(|lines| {
        let mut moves: Vec<Move> = Vec::new();
        for (tag, (mut parts, feed, goes_on, turn)) in lines.into_iter().enumerate() {
            let [x, y, z, e] = parts;
            if let Some(before) = moves.last().filter(|_| goes_on && z == 0.0 && (x != 0.0 || y != 0.0)) {
                let [x_before, y_before, ..] = before.displacement_mm;
                if x_before != 0.0 || y_before != 0.0 {
                    let angle = y_before.atan2(x_before) + turn;
                    parts = [x.hypot(y) * angle.cos(), x.hypot(y) * angle.sin(), z, e];
                }
            }
            moves.push(Move::straight(tag as u64, parts, feed));
        }
        moves
    })
}

/// Asserts that speeds and times agree to within a millionth.
fn assert_same(ours: &[PlannedMove], other: &[two_pass::Speeds]) {
    assert_eq!(ours.len(), other.len());
    for (one, other) in ours.iter().zip(other) {
        let pairs = [
            (one.start_mm_per_s, other.start),
            (one.cruise_mm_per_s, other.cruise),
            (one.end_mm_per_s, other.end),
            (one.duration_s(), other.duration_s),
        ];
        for (value, expected) in pairs {
            assert!((value - expected).abs() <= 1e-6 * (1.0 + expected.abs()), "{one:?}, expected {other:?}");
        }
    }
}
