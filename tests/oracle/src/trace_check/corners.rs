//! Jumps of the speed of each axis from one move to the next.
//!
//! Both by the reference plan, whose speeds the steps were compared with, for the table of all
//! corners, and by the steps themselves, without any plan, as the least jump that fits them.

use super::law::MotorEvent;
use crate::reference::{
    EXTRUDER_FRACTIONS_PER_UNIT, Job, Kinematics, Move, MoveKind, Plan, ReferenceProfile, UNITS_PER_MM,
};

/// Time before and after a corner in which steps are examined, s.
const WINDOW_S: f64 = 0.01;

/// Maximum error of an axis' position at either end of a window, steps.
const SLACK_STEPS: f64 = 1.0;

/// Jumps of an axis at corners, mm/s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jumps {
    /// 99th percentile: 99 of 100 corners have no larger jump.
    pub p99_mm_per_s: f64,
    /// Largest jump.
    pub largest_mm_per_s: f64,
}

/// Travel of X, Y, Z and the filament for a unit of path, and the path's length, mm.
pub fn shares(one: &Move) -> ([f64; 4], f64) {
    let mut travel = [0.0; 4];
    for ((travel, start), end) in travel.iter_mut().zip(one.start_10nm).zip(one.end_10nm) {
        *travel = (end - start) as f64 / UNITS_PER_MM as f64;
    }
    let extruder = (one.extruder_end - one.extruder_start) as f64;
    travel[3] = extruder / (EXTRUDER_FRACTIONS_PER_UNIT as f64 * UNITS_PER_MM as f64);
    let [x, y, z, e] = travel;
    let path = (x * x + y * y + z * z).sqrt();
    let length = if path == 0.0 { e.abs() } else { path };
    (travel.map(|travel| if length > 0.0 { travel / length } else { 0.0 }), length)
}

/// Returns true if two moves in a row are chords of one arc.
fn is_inside_arc(before: &Move, after: &Move) -> bool {
    before.line == after.line && before.kind == MoveKind::ArcChord { last: false }
}

/// Jumps of each axis over all corners of a plan, except those between the chords of an arc.
pub fn planned(job: &Job, plan: &Plan) -> [Jumps; 4] {
    let mut jumps: [Vec<f64>; 4] = Default::default();
    for (moves, planned) in job.moves.windows(2).zip(&plan.moves) {
        let [before, after] = moves else { continue };
        if is_inside_arc(before, after) {
            continue;
        }
        let ((before, _), (after, _)) = (shares(before), shares(after));
        for (axis, jumps) in jumps.iter_mut().enumerate() {
            jumps.push((after[axis] - before[axis]).abs() * planned.law.exit_mm_per_s);
        }
    }
    jumps.map(|mut jumps| {
        jumps.sort_by(f64::total_cmp);
        let p99 = (jumps.len() * 99 / 100).min(jumps.len().saturating_sub(1));
        Jumps {
            p99_mm_per_s: jumps.get(p99).copied().unwrap_or(0.0),
            largest_mm_per_s: jumps.last().copied().unwrap_or(0.0),
        }
    })
}

/// Speeds of an axis near an end of a move, as its steps show them.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Mean over the window, mm/s.
    mean: f64,
    /// Maximum difference between the speed at the corner and the mean.
    slack: f64,
}

/// A jump beyond its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TooLarge {
    /// Index of the axis.
    pub axis: usize,
    /// The smallest jump that fits the steps, mm/s.
    pub least_mm_per_s: f64,
    /// The limit, mm/s.
    pub limit_mm_per_s: f64,
}

/// Watches the corners of a trace.
pub struct Corners {
    kinematics: Kinematics,
    steps_per_mm: [f64; 4],
    tick_hz: f64,
    /// Window at the end of the move before, if a corner may follow it.
    before: Option<[Seen; 4]>,
}

/// A traced move.
pub struct Traced<'a> {
    /// The move.
    pub one: &'a Move,
    /// Acceleration along the path, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    /// First and last tick.
    pub ticks: [u64; 2],
    /// Steps of the move.
    pub events: &'a [MotorEvent],
    /// Jump that its corner allows each axis, mm/s.
    pub limits_mm_per_s: [f64; 4],
}

impl Corners {
    /// A watch for a machine.
    pub fn new(profile: &ReferenceProfile, tick_hz: u64) -> Self {
        Self {
            kinematics: profile.kinematics,
            steps_per_mm: profile.steps_per_mm.map(|steps| steps.to_f64()),
            tick_hz: tick_hz as f64,
            before: None,
        }
    }

    /// Forgets the move before: the next one does not follow a corner, since something
    /// unchecked lies between.
    pub fn forget(&mut self) {
        self.before = None;
    }

    /// Passes a move; returns the axes that jumped too far at its start.
    pub fn pass(&mut self, traced: &Traced<'_>) -> Vec<TooLarge> {
        let [start, end] = traced.ticks;
        let window = ((WINDOW_S * self.tick_hz) as u64).min(end.saturating_sub(start));
        let after = self.seen(traced, start, start + window);
        let ending = self.seen(traced, end - window, end);
        let Some(before) = self.before.replace(ending) else { return Vec::new() };
        let axes = before.into_iter().zip(after).zip(traced.limits_mm_per_s).enumerate();
        axes.filter_map(|(axis, ((before, after), limit_mm_per_s))| {
            let least_mm_per_s = (after.mean - before.mean).abs() - before.slack - after.slack;
            (least_mm_per_s > limit_mm_per_s).then_some(TooLarge { axis, least_mm_per_s, limit_mm_per_s })
        })
        .collect()
    }

    /// Speeds of the axes by the steps from one tick to another.
    fn seen(&self, traced: &Traced<'_>, from: u64, to: u64) -> [Seen; 4] {
        let mut steps = [0i64; 4];
        for event in traced.events.iter().filter(|event| (from..=to).contains(&event.tick)) {
            for (sum, step) in steps.iter_mut().zip(event.steps) {
                *sum += i64::from(step);
            }
        }
        let [a, b, c, e] = steps.map(|steps| steps as f64);
        let [x, y, z] = self.kinematics.twice_the_tool([a, b, c]);
        let steps = [x / 2.0, y / 2.0, z / 2.0, e];
        let seconds = (to - from) as f64 / self.tick_hz;
        let (shares, _) = shares(traced.one);
        std::array::from_fn(|axis| {
            if seconds <= 0.0 {
                return Seen { mean: 0.0, slack: f64::INFINITY };
            }
            let per_mm = self.steps_per_mm[axis];
            let rounding = SLACK_STEPS / per_mm / seconds;
            let ramp = traced.acceleration_mm_per_s2 * shares[axis].abs() * seconds / 2.0;
            Seen { mean: steps[axis] / per_mm / seconds, slack: rounding + ramp }
        })
    }
}
