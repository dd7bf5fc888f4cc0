//! Tests Marlin's rules against an oracle from their definitions.

use crate::two_pass::{self, Limited};
use crate::{assert_same, plan, print};
use ferrostep_random_cases::cases;
use ferrostep_rules::arcs::Arc;
use ferrostep_rules::marlin::{Corner, JerkRule, Marlin, MarlinSettings, SlowestSpeed};
use ferrostep_rules::{Axis, Limit, Move, Planner};
use proptest::prelude::*;

fn settings(corner: Corner) -> MarlinSettings {
    MarlinSettings {
        max_feed_mm_per_s: [180.0, 160.0, 12.0, 40.0],
        max_acceleration_mm_per_s2: [1500.0, 1250.0, 150.0, 2500.0],
        acceleration_mm_per_s2: 1100.0,
        travel_acceleration_mm_per_s2: 1400.0,
        retract_acceleration_mm_per_s2: 1200.0,
        ..MarlinSettings::example(corner)
    }
}

const DEVIATION: Corner = Corner::JunctionDeviation { deviation_mm: 0.02, handles_small_segments: true };

fn jerk(rule: JerkRule) -> Corner {
    Corner::ClassicJerk { jerk_mm_per_s: [8.0, 9.0, 0.4, 5.0], rule }
}

/// Returns the displacements of the limited axes: on CoreXY, the motors.
fn motors(one: &Move, settings: &MarlinSettings) -> [f64; 4] {
    let [x, y, z, e] = one.displacement_mm;
    if settings.is_core_xy { [x + y, x - y, z, e] } else { [x, y, z, e] }
}

fn norm(vector: &[f64]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// Computes a move's limits without its corner, by Marlin's documentation of M201, M203 and M204.
fn limited(one: &Move, settings: &MarlinSettings) -> Limited {
    let path = norm(&one.displacement_mm[..3]);
    let filament = one.displacement_mm[3];
    let length = if path > 0.0 { path } else { filament.abs() };
    let mut duration = length / one.feed_mm_per_s;
    let mut acceleration = if path == 0.0 {
        settings.retract_acceleration_mm_per_s2
    } else if filament != 0.0 {
        settings.acceleration_mm_per_s2
    } else {
        settings.travel_acceleration_mm_per_s2
    };
    for (axis, distance) in motors(one, settings).into_iter().enumerate().filter(|(_, distance)| *distance != 0.0) {
        duration = duration.max(distance.abs() / settings.max_feed_mm_per_s[axis]);
        if path > 0.0 {
            acceleration = acceleration.min(settings.max_acceleration_mm_per_s2[axis] * length / distance.abs());
        }
    }
    let SlowestSpeed::Fixed(slowest) = settings.slowest else { panic!("the oracle has a fixed speed") };
    Limited { length, nominal: length / duration, acceleration, corner: 0.0, slowest }
}

/// Computes the speed of a corner by junction deviation: the arc whose middle is the deviation away
/// from the corner.
fn by_deviation(before: &Move, one: &Move, ours: &Limited, nominal: f64, settings: &MarlinSettings) -> f64 {
    let Corner::JunctionDeviation { deviation_mm, .. } = settings.corner else { panic!("no deviation") };
    let direction = |one: &Move| {
        let parts = motors(one, settings);
        let path = norm(&one.displacement_mm[..3]);
        let length = if parts[3] == 0.0 && !settings.is_core_xy { path } else { norm(&parts) };
        parts.map(|part| part / length)
    };
    let [from, to] = [direction(before), direction(one)];
    let cosine: f64 = from.iter().zip(to).map(|(one, other)| one * other).sum();
    if cosine < -0.999_999 {
        return ours.slowest;
    }
    let difference: Vec<f64> = from.iter().zip(to).map(|(one, other)| other - one).collect();
    let size = norm(&difference);
    let mut acceleration = ours.acceleration;
    if size > 0.0 {
        for (part, max) in difference.iter().zip(settings.max_acceleration_mm_per_s2) {
            acceleration = acceleration.min(max * size / part.abs());
        }
    }
    let cosine = cosine.min(0.999_999);
    let half = (0.5 * (1.0 + cosine)).sqrt();
    let mut speed = (acceleration * deviation_mm * half / (1.0 - half)).sqrt();
    if ours.length < 1.0 && cosine > 0.5f64.sqrt() {
        // The arc that such chords stand for: its angle by Marlin's polynomial, within 0.033 of the
        // true one.
        let powers = |t: f64| {
            0.032843707 - 1.451838349 * t + 29.66153956 * t.powi(2) - 131.1123477 * t.powi(3) + 262.8130562 * t.powi(4)
                - 242.7199627 * t.powi(5)
                + 84.31466202 * t.powi(6)
        };
        let angle = std::f64::consts::FRAC_PI_2 - powers(cosine);
        assert!((angle - cosine.acos()).abs() < 0.034);
        speed = speed.min((ours.length * acceleration / angle).sqrt());
    }
    speed.max(ours.slowest).min(nominal)
}

/// Computes the speed of a corner by classic jerk, as in the released versions.
fn by_safe_speed(before: &Move, one: &Move, ours: [&Limited; 2], jerk: [f64; 4], settings: &MarlinSettings) -> f64 {
    let velocity =
        |one: &Move, limited: &Limited| motors(one, settings).map(|part| part / limited.length * limited.nominal);
    let safe = |one: &Move, limited: &Limited| {
        let shares = velocity(one, limited).map(|speed| speed.abs() / limited.nominal);
        shares.iter().zip(jerk).fold(limited.nominal, |least, (share, jerk)| least.min(jerk / share))
    };
    let corner = ours[0].nominal.min(ours[1].nominal);
    let mut factor = 1.0f64;
    let leaving = velocity(before, ours[0]).map(|speed| speed * corner / ours[0].nominal);
    for ((leaving, entering), jerk) in leaving.into_iter().zip(velocity(one, ours[1])).zip(jerk) {
        let (leaving, entering) = (leaving * factor, entering * factor);
        // An axis that reverses counts with its larger speed.
        let jump =
            if leaving * entering > 0.0 { (leaving - entering).abs() } else { leaving.abs().max(entering.abs()) };
        if jump > jerk {
            factor *= jerk / jump;
        }
    }
    let speed = corner * factor;
    let [safe_before, safe] = [safe(before, ours[0]), safe(one, ours[1])];
    if safe_before > 0.99 * speed && safe > 0.99 * speed { safe.min(corner) } else { speed }
}

fn by_difference(before: &Move, one: &Move, ours: [&Limited; 2], jerk: [f64; 4], settings: &MarlinSettings) -> f64 {
    let share = |one: &Move, limited: &Limited| motors(one, settings).map(|part| part / limited.length);
    let [from, to] = [share(before, ours[0]), share(one, ours[1])];
    let mut speed = ours[0].nominal.min(ours[1].nominal);
    for axis in 0..4 {
        speed = speed.min(jerk[axis] / (from[axis] - to[axis]).abs());
    }
    speed
}

fn oracle(moves: &[Move], stops: &[usize], settings: &MarlinSettings, known: usize) -> Vec<two_pass::Speeds> {
    let mut speeds = Vec::new();
    let mut run: Vec<Limited> = Vec::new();
    for (index, one) in moves.iter().enumerate() {
        let mut next = limited(one, settings);
        if let Some(before) = run.last() {
            let nominal = before.nominal.min(next.nominal);
            let previous = &moves[index - 1];
            next.corner = match settings.corner {
                Corner::JunctionDeviation { .. } => by_deviation(previous, one, &next, nominal, settings),
                Corner::ClassicJerk { jerk_mm_per_s, rule: JerkRule::SafeSpeed } => {
                    by_safe_speed(previous, one, [before, &next], jerk_mm_per_s, settings)
                }
                Corner::ClassicJerk { jerk_mm_per_s, rule: JerkRule::Difference } => {
                    by_difference(previous, one, [before, &next], jerk_mm_per_s, settings)
                }
            };
            next.corner = next.corner.max(next.slowest).min(nominal);
        }
        run.push(next);
        if stops.contains(&index) || index + 1 == moves.len() {
            speeds.extend(two_pass::plan(&run, known));
            run.clear();
        }
    }
    speeds
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn moves_are_planned_as_by_the_definitions(
        moves in print(80),
        corner in prop_oneof![Just(DEVIATION), Just(jerk(JerkRule::SafeSpeed)), Just(jerk(JerkRule::Difference))],
        is_core_xy in any::<bool>(),
        blocks in prop_oneof![Just(16usize), 5usize..70],
        stop in 0usize..160,
    ) {
        let settings = MarlinSettings { is_core_xy, block_buffer_size: blocks, ..settings(corner) };
        let mut planner = Planner::Marlin(Marlin::new(settings).unwrap());
        let ours = plan(&mut planner, &moves, &[stop]);
        assert_same(&ours, &oracle(&moves, &[stop], &settings, blocks - 2));
    }
}

/// Returns a square of 10 mm, whose corners turn by 90 degrees.
fn square(feed: f64) -> Vec<Move> {
    [[10.0, 0.0], [0.0, 10.0], [-10.0, 0.0], [0.0, -10.0]]
        .into_iter()
        .enumerate()
        .map(|(tag, [x, y])| Move::straight(tag as u64, [x, y, 0.0, 0.0], feed))
        .collect()
}

#[test]
fn a_corner_of_90_degrees_by_junction_deviation() {
    let deviation = Corner::JunctionDeviation { deviation_mm: 0.02, handles_small_segments: true };
    let settings = MarlinSettings { travel_acceleration_mm_per_s2: 1000.0, ..MarlinSettings::example(deviation) };
    let ours = plan(&mut Planner::Marlin(Marlin::new(settings).unwrap()), &square(200.0), &[]);
    // sqrt(a d s / (1 - s)) with s = sin 45 degrees.
    assert!((ours[1].start_mm_per_s - (1000.0f64 * 0.02 * (1.0 + 2f64.sqrt())).sqrt()).abs() < 1e-9);
    assert_eq!(ours[1].start_limit, Limit::Corner);
    assert_eq!(ours[1].cruise_limit, Limit::ShortMove);
    assert_eq!(ours[0].start_limit, Limit::Rest);
}

#[test]
fn a_corner_of_90_degrees_by_classic_jerk_is_taken_at_the_jerk() {
    for rule in [JerkRule::SafeSpeed, JerkRule::Difference] {
        let corner = Corner::ClassicJerk { jerk_mm_per_s: [8.0, 8.0, 0.4, 5.0], rule };
        let planner = Marlin::new(MarlinSettings::example(corner)).unwrap();
        let ours = plan(&mut Planner::Marlin(planner), &square(100.0), &[]);
        assert!((ours[1].start_mm_per_s - 8.0).abs() < 1e-9, "{ours:?}");
    }
}

#[test]
fn a_slow_axis_is_the_limit() {
    let planner = Marlin::new(MarlinSettings::example(DEVIATION)).unwrap();
    let up = Move::straight(0, [0.0, 0.0, 20.0, 0.0], 100.0);
    let ours = plan(&mut Planner::Marlin(planner), &[up], &[]);
    assert_eq!(ours[0].cruise_limit, Limit::AxisSpeed(Axis::Z));
    assert_eq!(ours[0].acceleration_limit, Limit::AxisAcceleration(Axis::Z));
    assert_eq!(ours[0].limit(), Limit::AxisSpeed(Axis::Z));
    assert!((ours[0].cruise_mm_per_s - 5.0).abs() < 1e-9);
}

#[test]
fn moves_of_less_than_six_steps_join_the_next() {
    let settings =
        MarlinSettings { steps_per_mm: Some([80.0, 80.0, 400.0, 93.0]), ..MarlinSettings::example(DEVIATION) };
    let mut planner = Planner::Marlin(Marlin::new(settings).unwrap());
    let moves: Vec<Move> = (0..100).map(|tag| Move::straight(tag, [0.05, 0.0, 0.0, 0.0], 50.0)).collect();
    let ours = plan(&mut planner, &moves, &[]);
    assert_eq!(ours.len(), 50);
    assert!((ours.iter().map(|one| one.length_mm).sum::<f64>() - 5.0).abs() < 1e-9);
}

/// Returns three circles of 10 mm radius as chords.
fn circles(planner: &Planner) -> Vec<Move> {
    let circle = Arc { displacement_mm: [0.0, 0.0, 0.0, 1.0], centre_mm: [10.0, 0.0], is_clockwise: true };
    let chords = (0..3).flat_map(|_| circle.chords(&planner.arc_cut(), 250.0));
    let moves = chords.enumerate().map(|(tag, chord)| Move {
        tag: tag as u64,
        displacement_mm: chord.displacement_mm,
        feed_mm_per_s: 250.0,
        arc: chord.hint,
    });
    moves.collect()
}

#[test]
fn an_arc_is_as_fast_as_its_radius_allows() {
    let mut planner = Planner::Marlin(Marlin::new(MarlinSettings::example(DEVIATION)).unwrap());
    let arcs = circles(&planner);
    let ours = plan(&mut planner, &arcs, &[]);
    // Each chord except a circle's first enters with at most the square root of a r.
    let chords = ours.iter().zip(&arcs).filter(|(_, one)| one.arc.is_some_and(|arc| arc.radius_mm > 0.0));
    let most = chords.map(|(one, _)| one.start_mm_per_s).fold(0.0, f64::max);
    let by_radius = (3000.0f64 * 10.0).sqrt();
    assert!(most > 0.9 * by_radius && most <= by_radius * (1.0 + 1e-9), "{most} mm/s");
    let sum: f64 = ours.iter().map(|one| one.travelled_mm()).sum();
    let length: f64 = arcs.iter().map(Move::path_mm).sum();
    assert!((sum - length).abs() < 1e-6);
}
