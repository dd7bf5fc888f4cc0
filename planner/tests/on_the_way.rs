//! Filament that moves on the way: what is printed stays the same, the nozzle keeps its path, and
//! nothing is faster than it may be. Under a trapezoid and an S-curve, with filters, an advance and
//! a tolerance of the filtered path, and without.
#![allow(clippy::unwrap_used)]

use std::collections::{BTreeMap, BTreeSet};

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::stretches::{Stretch, Stretches};
use ferrostep_planner::{
    AXES, AccelerationProfile, AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, MoveError, PlannedBlock,
    Planner, PressureAdvance, ShaperKind, StepsPerMm,
};
use proptest::prelude::*;

/// Largest speed and acceleration of the filament.
const FILAMENT_FEED: f64 = 60.0;
const FILAMENT_ACCELERATION: f64 = 5_000.0;

/// Largest change of the filament's speed between parts, mm/s: a fifth of its highest, if that
/// is above 25 mm/s.
const MOST_JUMP: f64 = 12.5;

const EXTRUDER_STEPS_PER_MM: f64 = 140.0;

fn geometry(kinematics: Kinematics) -> Geometry {
    let steps = |value: f64| StepsPerMm::from_f64(value).unwrap();
    Geometry {
        kinematics,
        // Enough steps for the shortest part to have some.
        steps_per_mm: [steps(400.0), steps(400.0), steps(2_000.0), steps(EXTRUDER_STEPS_PER_MM)],
        minimum_event_interval_ticks: 1,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    }
}

fn limits(acceleration: f64, z_acceleration: f64, retract: f64) -> Limits {
    Limits {
        max_feed_mm_per_s: [400.0, 400.0, 20.0, FILAMENT_FEED],
        max_acceleration_mm_per_s2: [20_000.0, 20_000.0, z_acceleration, FILAMENT_ACCELERATION],
        print_acceleration_mm_per_s2: acceleration,
        travel_acceleration_mm_per_s2: acceleration,
        retract_acceleration_mm_per_s2: retract,
        junction_deviation_mm: 0.05,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; AXES],
    }
}

/// A line and the way to the next: where it goes, mm, with filament, and what comes between.
#[derive(Clone, Debug)]
struct Line {
    to: [f64; 2],
    /// Back over the line, with this share of the retraction.
    wipe: f64,
    /// Some more of a lift before the travel, as where a layer ends.
    second_lift: f64,
    /// Places between, mm from the line's end: more than one way may have, sometimes.
    by_way_of: Vec<[f64; 2]>,
    travel_to: [f64; 2],
    lift: f64,
    retraction: f64,
    recovery: f64,
    retraction_feed: f32,
    travel_feed: f32,
    /// A move of the filament alone in the middle of the travel, and a flush there.
    between: (bool, bool),
}

fn line() -> impl Strategy<Value = Line> {
    let place = || [0.0..150.0f64, 0.0..150.0f64];
    let near = (-1.0..1.0f64).prop_map(|offset| offset);
    (
        (place(), place(), near, any::<bool>()),
        prop_oneof![Just(0.0), 0.05..1.0f64],
        (prop_oneof![Just(0.0), 0.02..8.0f64], prop_oneof![Just(0.0), 0.02..8.0f64], any::<bool>()),
        (5.0f32..80.0, 20.0f32..400.0),
        (prop::bool::weighted(0.1), prop::bool::weighted(0.05)),
        (
            prop_oneof![Just(0.0), 0.1..0.95f64],
            prop_oneof![Just(0.0), 0.05..0.4f64],
            prop::collection::vec([-20.0..20.0f64, -20.0..20.0f64], 0..7),
            any::<bool>(),
        ),
    )
        .prop_map(|((to, far, offset, is_far), lift, (retraction, other, same), feeds, between, way)| Line {
            to,
            wipe: way.0,
            second_lift: way.1,
            by_way_of: if way.3 { Vec::new() } else { way.2 },
            travel_to: if is_far { far } else { [to[0] + offset, to[1] - 0.3 * offset] },
            lift,
            retraction,
            recovery: if same { retraction } else { other },
            retraction_feed: feeds.0,
            travel_feed: feeds.1,
            between,
        })
}

fn add(moves: &mut Vec<Option<Move>>, place: [f64; 3], filament: f64, feed_mm_per_s: f32) {
    let line = moves.iter().flatten().count() as u32 + 1;
    let target_10nm = place.map(|mm| (mm * 1e5).round() as i64);
    let filament_100pm = (filament * 1e7).round() as i64;
    moves.push(Some(Move { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move: true }));
    if line.is_multiple_of(50) {
        moves.push(None);
    }
}

/// The moves of these lines; `None`: motion is flushed.
fn moves(lines: &[Line]) -> Vec<Option<Move>> {
    let mut moves = Vec::new();
    let mut place = [0.0, 0.0, 0.2];
    add(&mut moves, place, 0.0, 10.0);
    for line in lines {
        let length = ((line.to[0] - place[0]).powi(2) + (line.to[1] - place[1]).powi(2)).sqrt();
        place = [line.to[0], line.to[1], place[2]];
        add(&mut moves, place, 0.04 * length, 80.0);
        if line.wipe > 0.0 {
            place = [place[0] - 0.7, place[1] + 0.4, place[2]];
            add(&mut moves, place, -line.wipe * line.retraction, 80.0);
        }
        add(&mut moves, place, -(1.0 - line.wipe) * line.retraction, line.retraction_feed);
        let height = place[2];
        for lift in [line.lift, line.second_lift] {
            place[2] += lift;
            add(&mut moves, place, 0.0, line.travel_feed);
        }
        let end = place;
        for [x, y] in &line.by_way_of {
            place = [end[0] + x, end[1] + y, place[2]];
            add(&mut moves, place, 0.0, line.travel_feed);
        }
        let (alone, flush) = line.between;
        if alone {
            add(&mut moves, place, 0.3, 20.0);
        }
        if flush {
            moves.push(None);
        }
        place = [line.travel_to[0], line.travel_to[1], place[2]];
        add(&mut moves, place, 0.0, line.travel_feed);
        place[2] = height;
        add(&mut moves, place, 0.0, line.travel_feed);
        add(&mut moves, place, line.recovery, line.retraction_feed);
    }
    moves
}

#[derive(Clone, Debug)]
struct Machine {
    kinematics: Kinematics,
    limits: Limits,
    choice: MotionChoice,
    look_ahead: usize,
}

fn machine() -> impl Strategy<Value = Machine> {
    (
        prop::sample::select(&[Kinematics::Cartesian, Kinematics::CoreXy]),
        (300.0..15_000.0f64, 50.0..1_500.0f64, 300.0..5_000.0f64),
        prop_oneof![Just(ShaperKind::None), Just(ShaperKind::Mzv)],
        prop_oneof![Just(0.0), 0.01..0.2f64],
        prop_oneof![Just(3), Just(16), Just(128)],
        prop_oneof![Just(AccelerationProfile::Trapezoid), Just(AccelerationProfile::SCurve)],
        prop_oneof![Just(None), Just(Some(0.05))],
    )
        .prop_map(|(kinematics, (acceleration, z, retract), kind, seconds, look_ahead, profile, tolerance)| {
            let choice = MotionChoice {
                acceleration: profile,
                jerk_mm_per_s3: 100_000.0,
                filament_jerk_mm_per_s3: 500_000.0,
                shapers: [AxisShaper { kind, frequency_hz: 45.0, damping: 0.1 }; 2],
                pressure_advance: PressureAdvance { seconds, ..PressureAdvance::NONE },
                path_tolerance_mm: tolerance.filter(|_| kind != ShaperKind::None),
                ..MotionChoice::DEFAULT
            };
            Machine { kinematics, limits: limits(acceleration, z, retract), choice, look_ahead }
        })
}

/// The blocks of moves, and how long they take, s. `drains`: after each move all blocks are
/// taken that are final.
fn planned(
    machine: &Machine,
    filament_on_the_way: bool,
    drains: bool,
    moves: &[Option<Move>],
) -> (Vec<PlannedBlock>, f64) {
    let mut planner: Planner<Vec<Slot>> =
        Planner::new(geometry(machine.kinematics), machine.limits, vec![Slot::EMPTY; machine.look_ahead]);
    planner.set_motion_choice(&MotionChoice { filament_on_the_way, ..machine.choice }).unwrap();
    let mut blocks = Vec::new();
    for one in moves {
        let Some(one) = one else {
            planner.flush();
            continue;
        };
        loop {
            let room = |planner: &mut Planner<Vec<Slot>>| {
                let block = planner.next_planned();
                let made = block.is_some();
                blocks.extend(block);
                made
            };
            match planner.add_making_room(one, room) {
                Ok(_) => break,
                // A marker has left.
                Err(MoveError::NoRoom) => assert!(planner.has_room()),
                Err(error) => panic!("{error:?}"),
            }
        }
        while drains && planner.release_final() {
            blocks.extend(planner.next_planned());
        }
        let [x, y, z] = planner.position_10nm();
        assert_eq!([x, y, z], one.target_10nm);
    }
    planner.flush();
    while let Some(block) = planner.next_planned() {
        blocks.push(block);
    }
    assert!(planner.is_look_ahead_empty());
    let seconds = planner.motion_ticks() as f64 / f64::from(ferrostep_planner::TICKS_PER_SECOND);
    (blocks, seconds)
}

/// The lines that draw filament back while they go somewhere.
fn wipes(moves: &[Option<Move>]) -> BTreeSet<u32> {
    let pairs = moves.iter().flatten().zip(moves.iter().flatten().skip(1));
    let wipes = pairs.filter(|(before, one)| before.target_10nm != one.target_10nm && one.filament_100pm < 0);
    wipes.map(|(_, one)| one.line).collect()
}

/// Steps of the motors, in both directions, and length of the path, mm.
fn steps_and_path(blocks: &[PlannedBlock]) -> ([u64; 3], f64) {
    let (mut sum, mut path) = ([0; 3], 0.0);
    for stretch in blocks.iter().flat_map(|planned| Stretches::of(&planned.block)) {
        for (sum, steps) in sum.iter_mut().zip(stretch.steps) {
            *sum += u64::from(steps.unsigned_abs());
        }
        if filament_per_path(&stretch).is_some() {
            path += f64::from(stretch.length_10nm) / 1e5;
        }
    }
    (sum, path)
}

/// Motor positions at the end of each line, in steps and 1/256 steps of the extruder.
fn ends(blocks: &[PlannedBlock]) -> BTreeMap<u32, [i64; 4]> {
    let mut at = [0; 4];
    let mut ends = BTreeMap::new();
    for planned in blocks {
        for stretch in Stretches::of(&planned.block) {
            let [x, y, z] = stretch.steps.map(i64::from);
            for (at, more) in at.iter_mut().zip([x, y, z, i64::from(stretch.extruder_256ths)]) {
                *at += more;
            }
            if stretch.ends_move {
                ends.insert(stretch.line, at);
            }
        }
    }
    ends.insert(u32::MAX, at);
    ends
}

/// Filament for a mm of path, and the amount by which counting in 1/256 steps and 10 nm may
/// have changed it.
struct Ratio {
    mm_per_mm: f64,
    rounding: f64,
}

/// `None` where the filament moves alone.
fn filament_per_path(stretch: &Stretch) -> Option<Ratio> {
    if stretch.steps == [0; 3] && stretch.extruder_256ths != 0 {
        return None;
    }
    let length = f64::from(stretch.length_10nm);
    let unit = 1e5 / (256.0 * EXTRUDER_STEPS_PER_MM * length);
    let mm_per_mm = f64::from(stretch.extruder_256ths) * unit;
    Some(Ratio { mm_per_mm, rounding: 2.0 * unit + mm_per_mm.abs() / length })
}

proptest! {
    #[test]
    fn the_same_is_printed_in_less_time(machine in machine(), lines in prop::collection::vec(line(), 1..12)) {
        let moves = moves(&lines);
        let (stops, with_stops) = planned(&machine, false, false, &moves);
        let (on_the_way, without) = planned(&machine, true, false, &moves);
        // The blocks are the same, whenever they leave.
        let in_other_ring = Machine { look_ahead: 40, ..machine.clone() };
        for (machine, drains) in [(&machine, true), (&in_other_ring, false)] {
            let (same, _) = planned(machine, true, drains, &moves);
            prop_assert!(on_the_way.iter().map(|one| one.block).eq(same.iter().map(|one| one.block)));
        }
        let (expected, found) = (ends(&stops), ends(&on_the_way));
        // Filament that is pushed begins and ends where it does with stops, all motors; in between
        // filament and travel are together.
        for one in moves.iter().flatten().filter(|one| one.filament_100pm > 0) {
            prop_assert_eq!(expected[&one.line], found[&one.line], "line {}", one.line);
        }
        for one in moves.iter().flatten().filter(|one| one.filament_100pm < 0) {
            prop_assert!(found.contains_key(&one.line), "line {}", one.line);
        }
        prop_assert_eq!(expected.len(), found.len());
        prop_assert_eq!(expected[&u32::MAX], found[&u32::MAX]);
        // The nozzle keeps to its path: nowhere back, nowhere beside, but for the
        // rounding of each part.
        let ((steps, path), (same_steps, same_path)) = (steps_and_path(&stops), steps_and_path(&on_the_way));
        prop_assert_eq!(steps, same_steps);
        let rounding = 2e-5 * (stops.len() + on_the_way.len()) as f64;
        prop_assert!((path - same_path).abs() <= rounding + 2e-6 * path, "{path} mm, {same_path} mm");
        let wipes = wipes(&moves);
        let mut before: Option<Ratio> = None;
        for planned in &on_the_way {
            let block = &planned.block;
            for stretch in Stretches::of(block) {
                let Some(ratio) = filament_per_path(&stretch) else {
                    before = None;
                    continue;
                };
                let is_within = |limit: f64, value: f64| value * (ratio.mm_per_mm.abs() - ratio.rounding) <= limit * 1.001;
                prop_assert!(is_within(FILAMENT_FEED, block.nominal.mm_per_s()), "{planned:?}");
                prop_assert!(is_within(FILAMENT_ACCELERATION, block.acceleration.mm_per_s2()), "{planned:?}");
                // A wipe has its ratio from the job.
                let is_wipe = wipes.contains(&stretch.line);
                if let Some(other) = before.filter(|_| !is_wipe) {
                    // No place inside a block is faster than its nominal speed.
                    let speed = if stretch.before_10nm == 0 { planned.entry } else { block.nominal };
                    let jump = (ratio.mm_per_mm - other.mm_per_mm).abs() - ratio.rounding - other.rounding;
                    prop_assert!(jump * speed.mm_per_s() <= MOST_JUMP, "{} before {planned:?}", jump * speed.mm_per_s());
                }
                before = Some(ratio);
            }
        }
        // Look-ahead by few blocks sees less of a path in many parts. An S-curve takes the least
        // acceleration that a tolerance leaves to one of several parts for all of them.
        let is_least_of_all =
            machine.choice.acceleration == AccelerationProfile::SCurve && machine.choice.path_tolerance_mm.is_some();
        if machine.look_ahead > 16 && !is_least_of_all {
            prop_assert!(without <= with_stops * 1.005, "{without} s instead of {with_stops} s");
        }
    }
}
