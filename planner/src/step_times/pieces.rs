//! The phases of laws that have more than three, made one after the other.

use super::jerk::JerkRamp;
use super::{Cruise, Pace, Phase};
use crate::real::Real;
use crate::s_curve::cubic::Cubic;
use crate::s_curve::law::{Along, Curve, Piece};
use crate::s_curve::staircase::Staircase;
use crate::spacing::Spacing;

/// What the phases to come are made of.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pieces {
    /// A trapezoid's are there from the start.
    None,
    /// The pieces of an S-curve along a block.
    Run { law: Along, steps: Spacing<f64>, next: u8, done: u32 },
    /// The slices of a table.
    Staircase { law: Staircase, steps: Spacing<f64>, next: u32, done: u32 },
}

/// Steps up to a path position, of those that a motor makes.
fn steps_before(steps: &Spacing<f64>, position: f64) -> u32 {
    let behind_first = position - steps.first;
    if behind_first < 0.0 { 0 } else { Real::to_u32(behind_first * steps.per_spacing + 1.0).min(steps.count) }
}

/// Path position of a step.
fn position_of(steps: &Spacing<f64>, index: u32) -> f64 {
    steps.first + f64::from(index) * steps.spacing
}

/// Path from a step to the block's end.
fn behind(steps: &Spacing<f64>, index: u32) -> f64 {
    steps.after_last + f64::from((steps.count - 1).saturating_sub(index)) * steps.spacing
}

fn cruise(count: u32, first: u64, interval: f64) -> Phase {
    let beyond = Real::to_u64(interval * 65_536.0) as u16;
    Phase { count, first, pace: Pace::Cruise(Cruise::new(Real::to_u64(interval), beyond)) }
}

impl Pieces {
    /// The next phase that has steps.
    pub(super) fn next_phase(&mut self) -> Option<Phase> {
        match self {
            Self::None => None,
            Self::Run { law, steps, next, done } => {
                while *done < steps.count
                    && let Some(piece) = law.curve.piece(*next)
                {
                    let is_last = *next + 1 == Curve::PIECES;
                    let end = law.curve.end_of(*next) - law.offset;
                    let before = if is_last { steps.count } else { steps_before(steps, end) };
                    *next += 1;
                    if before > *done {
                        let phase = run_phase(law, &piece, steps, *done, before - *done);
                        *done = before;
                        return Some(phase);
                    }
                }
                None
            }
            Self::Staircase { law, steps, next, done } => {
                while *done < steps.count
                    && let Some(stair) = law.stair(*next)
                {
                    let before = match stair.end {
                        Some(end) => steps_before(steps, end),
                        None => steps.count,
                    };
                    *next += 1;
                    if before > *done {
                        let inside = position_of(steps, *done) - stair.start;
                        let first = stair.start_time + stair.per_length * if inside > 0.0 { inside } else { 0.0 };
                        let phase = cruise(before - *done, Real::to_u64(first), stair.per_length * steps.spacing);
                        *done = before;
                        return Some(phase);
                    }
                }
                None
            }
        }
    }
}

/// `count` steps of a piece, the first of them `index`.
fn run_phase(law: &Along, piece: &Piece, steps: &Spacing<f64>, index: u32, count: u32) -> Phase {
    match *piece {
        Piece::Cruise { start, start_time } => {
            let inside = law.offset + position_of(steps, index) - start;
            let time = start_time + law.curve.cruise_time(if inside > 0.0 { inside } else { 0.0 });
            cruise(count, law.since_start(time), law.curve.cruise_time(steps.spacing))
        }
        Piece::From { anchor, anchor_time, curve, half_time } => {
            let distance = (law.offset - anchor) + position_of(steps, index);
            let distance = if distance > 0.0 { distance } else { 0.0 };
            let time = curve.solve(distance) * half_time;
            let base = distance * steps.per_spacing;
            let ramp = ramp(curve, half_time, steps, time, base, 0);
            Phase { count, first: law.since_start(anchor_time + time), pace: Pace::Jerk(ramp) }
        }
        Piece::To { before_end, anchor_time, curve, half_time } => {
            let last = (law.rest - before_end) + behind(steps, index + (count - 1));
            let last = if last > 0.0 { last } else { 0.0 };
            let time = curve.solve(last + f64::from(count - 1) * steps.spacing) * half_time;
            let ramp = ramp(curve, half_time, steps, time, last * steps.per_spacing, count - 1);
            let ramp = JerkRamp { direction: u32::MAX, ..ramp };
            Phase { count, first: law.since_start(anchor_time - time), pace: Pace::Jerk(ramp) }
        }
    }
}

/// Half of a ramp in steps, away from where the acceleration is zero.
fn ramp(curve: Cubic<f64>, half_time: f64, steps: &Spacing<f64>, time: f64, base: f64, index: u32) -> JerkRamp {
    let curve =
        Cubic { linear: (curve.linear * steps.per_spacing) as f32, cubic: (curve.cubic * steps.per_spacing) as f32 };
    JerkRamp {
        curve,
        half_time: half_time as f32,
        per_half_time: (1.0 / half_time) as f32,
        time: Real::to_u64(time),
        base: base as f32,
        index,
        direction: 1,
    }
}
