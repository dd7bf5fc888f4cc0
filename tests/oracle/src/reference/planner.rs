//! The plain planner: junction speeds, reverse pass, forward pass, trapezoids, all in f64.

use super::decimal::UNITS_PER_MM;
use super::job::{EXTRUDER_FRACTIONS_PER_UNIT, Job, Limits, Move, MoveKind};
use super::trapezoid::Trapezoid;
use std::num::NonZeroUsize;

/// A move's plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedMove {
    /// The law of motion along the path (along the filament for an extruder-only move).
    pub law: Trapezoid,
    /// Speed allowed along the path, mm/s, whether or not it is reached.
    pub nominal_mm_per_s: f64,
    /// True if only the extruder moves.
    pub extruder_only: bool,
}

/// A job's plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// One entry for each of [`Job::moves`].
    pub moves: Vec<PlannedMove>,
    /// Sum of the durations, s.
    pub motion_time_s: f64,
}

/// A move before its speeds are known.
struct Segment {
    direction: [f64; 3],
    /// Travel of X, Y, Z and the filament for a unit of path.
    shares: [f64; 4],
    inside_arc: bool,
    length_mm: f64,
    nominal_mm_per_s: f64,
    acceleration_mm_per_s2: f64,
    extruder_only: bool,
    /// Squared speed allowed at its start by the junction before it, (mm/s)^2.
    entry_limit_squared: f64,
}

/// Plans a job. Without `look_ahead` every junction is known to every move; with it, a move's
/// speeds are settled when this number of moves, itself included, is known, the last of them taken
/// to end at a stop.
pub fn plan(job: &Job, look_ahead: Option<NonZeroUsize>) -> Plan {
    let mut segments: Vec<Segment> = Vec::with_capacity(job.moves.len());
    for one in &job.moves {
        let Some(limits) = job.limits.get(one.limits).or(job.limits.last()) else { break };
        let mut segment = Segment::new(one, limits);
        if let (false, Some(before)) = (one.stop_before, segments.last()) {
            segment.entry_limit_squared = junction_speed_squared(before, &segment, limits.junction_deviation_mm);
            if !before.inside_arc {
                let jumps = jump_speed_squared(before, &segment, &limits.corner_velocity_mm_per_s);
                segment.entry_limit_squared = segment.entry_limit_squared.min(jumps);
            }
        }
        segments.push(segment);
    }
    let entries_squared = match look_ahead {
        None => unlimited(&segments),
        Some(window) => windowed(&segments, window.get()),
    };
    let mut moves = Vec::with_capacity(segments.len());
    let mut motion_time_s = 0.0;
    for (index, (segment, entry_squared)) in segments.iter().zip(&entries_squared).enumerate() {
        let exit_squared = entries_squared.get(index + 1).copied().unwrap_or(0.0);
        let law = Trapezoid::new(
            segment.length_mm,
            entry_squared.sqrt(),
            segment.nominal_mm_per_s,
            exit_squared.sqrt(),
            segment.acceleration_mm_per_s2,
        );
        motion_time_s += law.duration_s();
        moves.push(PlannedMove {
            law,
            nominal_mm_per_s: segment.nominal_mm_per_s,
            extruder_only: segment.extruder_only,
        });
    }
    Plan { moves, motion_time_s }
}

impl Segment {
    fn new(one: &Move, limits: &Limits) -> Self {
        let mut delta_mm = [0.0; 3];
        for ((delta, start), end) in delta_mm.iter_mut().zip(one.start_10nm).zip(one.end_10nm) {
            *delta = (end - start) as f64 / UNITS_PER_MM as f64;
        }
        let [x, y, z] = delta_mm;
        let extruder_mm =
            (one.extruder_end - one.extruder_start) as f64 / (EXTRUDER_FRACTIONS_PER_UNIT as f64 * UNITS_PER_MM as f64);
        let path_mm = (x * x + y * y + z * z).sqrt();
        let extruder_only = path_mm == 0.0;
        let length_mm = if extruder_only { extruder_mm.abs() } else { path_mm };
        let accelerations = limits.acceleration_mm_per_s2;
        let mut acceleration = if extruder_only {
            accelerations.retract
        } else if extruder_mm == 0.0 {
            accelerations.travel
        } else {
            accelerations.print
        };
        let mut nominal = one.feed_mm_per_s;
        let axis_limits = limits.max_feed_mm_per_s.iter().zip(limits.max_acceleration_mm_per_s2);
        for (distance_mm, (max_feed, max_acceleration)) in [x, y, z, extruder_mm].into_iter().zip(axis_limits) {
            // This axis moves `share` millimetres for each millimetre of the path.
            let share = distance_mm.abs() / length_mm;
            if share > 0.0 {
                nominal = nominal.min(max_feed / share);
                acceleration = acceleration.min(max_acceleration / share);
            }
        }
        Self {
            direction: if extruder_only { [0.0; 3] } else { delta_mm.map(|delta| delta / path_mm) },
            shares: [x, y, z, extruder_mm].map(|travel| travel / length_mm),
            inside_arc: one.kind == MoveKind::ArcChord { last: false },
            length_mm,
            nominal_mm_per_s: nominal,
            acceleration_mm_per_s2: acceleration,
            extruder_only,
            entry_limit_squared: 0.0,
        }
    }

    fn ramp(&self) -> f64 {
        2.0 * self.acceleration_mm_per_s2 * self.length_mm
    }
}

/// Squared speed at the corner between two moves (Yu 2019): an arc that stays within `deviation_mm`
/// of the corner and touches neither move beyond its middle, taken at the smaller of the two
/// accelerations; no faster than either move.
///
/// With theta the angle between the directions u1 and u2, sin(theta/2) = |u1 - u2|/2 and
/// cos(theta/2) = |u1 + u2|/2; R = delta*c/(1 - c) is written delta*c*(1 + c)/s^2, which keeps its
/// digits where the path is almost straight.
fn junction_speed_squared(before: &Segment, after: &Segment, deviation_mm: f64) -> f64 {
    if before.extruder_only || after.extruder_only {
        return 0.0;
    }
    let (mut difference, mut sum) = (0.0, 0.0);
    for (one, other) in before.direction.iter().zip(after.direction) {
        difference += (one - other) * (one - other);
        sum += (one + other) * (one + other);
    }
    let (sine, cosine) = (difference.sqrt() / 2.0, sum.sqrt() / 2.0);
    let nominal = before.nominal_mm_per_s.min(after.nominal_mm_per_s);
    if sine == 0.0 {
        return nominal * nominal;
    }
    let arc_mm = deviation_mm * cosine * (1.0 + cosine) / (sine * sine);
    let fitting_mm = before.length_mm.min(after.length_mm) / 2.0 * cosine / sine;
    let acceleration = before.acceleration_mm_per_s2.min(after.acceleration_mm_per_s2);
    (acceleration * arc_mm.min(fitting_mm)).min(nominal * nominal)
}

/// Squared speed at which the axis with the largest jump at a corner, relative to its limit, just
/// keeps that limit.
fn jump_speed_squared(before: &Segment, after: &Segment, limits_mm_per_s: &[f64; 4]) -> f64 {
    let jumps = before.shares.iter().zip(after.shares).map(|(before, after)| (after - before).abs());
    let speeds = jumps.zip(limits_mm_per_s).filter(|(jump, _)| *jump > 0.0).map(|(jump, limit)| limit / jump);
    speeds.fold(f64::INFINITY, f64::min).powi(2)
}

/// Squared entry speeds when everything is known: backwards from a stop at the end, then forwards.
fn unlimited(segments: &[Segment]) -> Vec<f64> {
    let mut entries = vec![0.0; segments.len()];
    let mut exit = 0.0;
    for (entry, segment) in entries.iter_mut().zip(segments).rev() {
        *entry = segment.entry_limit_squared.min(exit + segment.ramp());
        exit = *entry;
    }
    let mut reachable = 0.0;
    for (entry, segment) in entries.iter_mut().zip(segments) {
        *entry = entry.min(reachable);
        reachable = *entry + segment.ramp();
    }
    entries
}

/// Squared entry speeds when only `window` moves are known at a time.
fn windowed(segments: &[Segment], window: usize) -> Vec<f64> {
    let mut entries = Vec::with_capacity(segments.len());
    let mut entry = 0.0;
    for (index, segment) in segments.iter().enumerate() {
        entries.push(entry);
        let known = segments.get(index + 1..segments.len().min(index.saturating_add(window))).unwrap_or_default();
        let mut exit = 0.0;
        for later in known.iter().rev() {
            exit = later.entry_limit_squared.min(exit + later.ramp());
        }
        entry = exit.min(entry + segment.ramp());
    }
    entries
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::reference::{InterpretOptions, ReferenceProfile, interpret};
    use proptest::prelude::*;

    fn job(gcode: &str) -> Job {
        interpret(gcode.as_bytes(), &ReferenceProfile::cartesian(), InterpretOptions::default()).unwrap()
    }

    fn planned(gcode: &str) -> Plan {
        plan(&job(gcode), None)
    }

    fn near(value: f64, expected: f64) {
        assert!((value - expected).abs() < 1e-9 * expected.abs().max(1.0), "{value} instead of {expected}");
    }

    #[test]
    fn a_right_angle_is_taken_along_the_arc() {
        // c = cos 45 deg, R = 0.1*c/(1 - c) = 0.24142 mm, v = sqrt(1000*R).
        let plan = planned("G28\nG1 X50 F3000\nG1 Y50\n");
        let cosine = 0.5f64.sqrt();
        near(plan.moves[1].law.entry_mm_per_s, (1000.0 * 0.1 * cosine / (1.0 - cosine)).sqrt());
        near(plan.moves[0].law.exit_mm_per_s, plan.moves[1].law.entry_mm_per_s);
        near(plan.moves[0].law.entry_mm_per_s, 0.0);
        near(plan.moves[1].law.exit_mm_per_s, 0.0);
    }

    #[test]
    fn the_arc_must_fit_the_shorter_neighbour() {
        // The arc's 0.24142 mm would touch the moves 0.24142 mm from the corner; the
        // middle is at 0.1.
        let plan = planned("G28\nG1 X50 F3000\nG1 Y.2\nG1 Y.2 X100\n");
        near(plan.moves[1].law.entry_mm_per_s, (1000.0f64 * 0.1).sqrt());
    }

    #[test]
    fn straight_on_only_the_feeds_bound_the_junction() {
        let plan = planned("G28\nG1 X50 F3000\nG1 X100 F1200\nG1 X40\n");
        near(plan.moves[1].law.entry_mm_per_s, 20.0);
        near(plan.moves[2].law.entry_mm_per_s, 0.0);
    }

    #[test]
    fn motion_stops_next_to_an_extruder_only_move_and_at_waits() {
        for (between, stops) in [
            ("G1 E1\n", true),
            ("G4 P0\n", true),
            ("M400\n", true),
            ("M109 S200\n", true),
            ("G28 Z\n", true),
            ("G92 E0\n", false),
            ("M106 S9\n", false),
            ("M204 P900\n", false),
            ("M73 P3\n", false),
        ] {
            let plan = planned(&format!("G28\nG1 X50 F3000\n{between}G1 X100\n"));
            let last = plan.moves.last().unwrap();
            assert_eq!(last.law.entry_mm_per_s == 0.0, stops, "{between}");
            assert_eq!(plan.moves[0].law.exit_mm_per_s == 0.0, stops, "{between}");
        }
    }

    #[test]
    fn axes_and_the_kind_of_move_limit_speed_and_acceleration() {
        // 3-4-5 in X and Z: Z's 10 mm/s and 100 mm/s^2 are 4/5 of the path's.
        let plan = planned("G28\nG1 X3 Z4 F9000\nG1 E2\nG1 X4 E3\nG0 X9\n");
        let [slope, retract, print, travel] = [0, 1, 2, 3].map(|index| plan.moves[index]);
        near(slope.nominal_mm_per_s, 12.5);
        near(slope.law.acceleration_mm_per_s2, 125.0);
        near(retract.nominal_mm_per_s, 60.0);
        near(retract.law.acceleration_mm_per_s2, 1500.0);
        assert!(retract.extruder_only && !print.extruder_only);
        near(print.nominal_mm_per_s, 60.0);
        near(print.law.acceleration_mm_per_s2, 1000.0);
        near(travel.nominal_mm_per_s, 150.0);
    }

    #[test]
    fn a_window_of_one_stops_after_each_move() {
        let job = job("G28\nG1 X10 F3000\nG1 X20\nG1 X30\n");
        let plan = plan(&job, NonZeroUsize::new(1));
        for one in &plan.moves {
            assert_eq!((one.law.entry_mm_per_s, one.law.exit_mm_per_s), (0.0, 0.0));
        }
        near(plan.motion_time_s, 3.0 * (2.0 * 0.05 + (10.0 - 2.5) / 50.0));
    }

    proptest! {
        #[test]
        fn plans_are_feasible_and_a_wide_window_is_no_window(
            points in prop::collection::vec((0u32..200_000, 0u32..200_000, 0u32..3, 300u32..12_000), 1..60),
        ) {
            let mut gcode = String::from("G28\nM83\n");
            for (x, y, e, feed) in &points {
                let (x, y) = (f64::from(*x) / 1000.0, f64::from(*y) / 1000.0);
                gcode.push_str(&format!("G1 X{x} Y{y} E{e} F{feed}\n"));
            }
            let job = job(&gcode);
            let unlimited = plan(&job, None);
            prop_assert_eq!(&plan(&job, NonZeroUsize::new(points.len())), &unlimited);
            prop_assert!(plan(&job, NonZeroUsize::new(4)).motion_time_s >= unlimited.motion_time_s - 1e-9);
            let mut before = 0.0;
            for one in &unlimited.moves {
                let law = one.law;
                prop_assert_eq!(law.entry_mm_per_s, before);
                let change = (law.exit_mm_per_s.powi(2) - law.entry_mm_per_s.powi(2)).abs();
                prop_assert!(change <= 2.0 * law.acceleration_mm_per_s2 * law.length_mm * (1.0 + 1e-9) + 1e-9);
                prop_assert!(law.peak_mm_per_s <= one.nominal_mm_per_s * (1.0 + 1e-12));
                before = law.exit_mm_per_s;
            }
            prop_assert_eq!(before, 0.0);
        }
    }
}
