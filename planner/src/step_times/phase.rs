//! The steps of a motor in one piece of the time law.

use super::accelerated::AcceleratedSteps;
use super::even::EvenSteps;
use super::jerk::JerkSteps;
use crate::piece::{Anchor, Motion, Piece, above_zero};
use crate::real::Real;
use crate::spacing::Spacing;
use crate::time_units::{ramp_time, steps_per_tick};

/// Law of the time from step to step.
#[derive(Clone, Copy, Debug)]
pub(super) enum PhaseMotion {
    /// Constant interval.
    Even(EvenSteps),
    /// Constant acceleration.
    Accelerated(AcceleratedSteps),
    /// Constant jerk.
    Jerk(JerkSteps),
}

/// Steps at equal distances in one piece.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phase {
    pub(super) count: u32,
    /// Due time of the first of them, time units.
    pub(super) first: u64,
    pub(super) motion: PhaseMotion,
}

/// Pieces and the steps of a motor along them, solved a piece at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unsolved<F, P> {
    pieces: P,
    steps: Spacing<F>,
    /// Steps in the pieces that have been taken.
    done: u32,
}

impl<F: Real, P: Iterator<Item = Piece<F>>> Unsolved<F, P> {
    /// A motor's steps along these pieces.
    #[inline]
    pub(super) fn new(pieces: P, steps: Spacing<F>) -> Self {
        Self { pieces, steps, done: 0 }
    }

    /// The steps of the next piece that has any.
    #[inline]
    pub(super) fn next_phase(&mut self) -> Option<Phase> {
        while self.done < self.steps.count {
            let piece = self.pieces.next()?;
            let up_to = self.steps.steps_up_to(piece.end, self.done);
            if up_to > self.done {
                let phase = Phase::new(&piece, &self.steps, self.done, up_to - self.done);
                self.done = up_to;
                return Some(phase);
            }
        }
        None
    }
}

impl Phase {
    /// `count` steps of a piece, the first of them `index`.
    #[inline]
    fn new<F: Real>(piece: &Piece<F>, steps: &Spacing<F>, index: u32, count: u32) -> Self {
        // Path from the anchor to the nearest step and to the first, and the number of the
        // first from there.
        let (nearest, first, number) = match piece.anchor {
            Anchor::Start => {
                let nearest = above_zero(steps.position(index) - piece.position);
                (nearest, nearest, 0)
            }
            Anchor::End => {
                let number = count - 1;
                let nearest = above_zero(steps.rest(index + number) - piece.position);
                (nearest, nearest + F::from_u32(number) * steps.spacing, number)
            }
        };
        let direction = if piece.anchor == Anchor::Start { 1 } else { u32::MAX };
        let (motion, time) = match piece.motion {
            Motion::Constant { path, time } => {
                let even = EvenSteps::new(time * steps.spacing / path);
                (PhaseMotion::Even(even), time * first / path)
            }
            Motion::Accelerated { speed, gain } => {
                let squared = speed * speed;
                let steps_per_tick = steps_per_tick(steps.per_spacing);
                let square = steps_per_tick * steps_per_tick;
                let here = (squared + gain * first).square_root();
                let ramp = AcceleratedSteps {
                    slow: ((squared + gain * nearest) * square).to_f32(),
                    gain: (gain * steps.spacing * square).to_f32(),
                    speed: (here * steps_per_tick).to_f32(),
                    index: number,
                    direction,
                };
                (PhaseMotion::Accelerated(ramp), ramp_time(first, speed, here))
            }
            Motion::Jerk { curve, duration } => {
                let time = curve.solve(first) * duration;
                let base = nearest * steps.per_spacing;
                let curve = curve.scaled(steps.per_spacing);
                (PhaseMotion::Jerk(JerkSteps::new(&curve, duration, time, base, number, direction)), time)
            }
        };
        let first = match piece.anchor {
            Anchor::Start => piece.time + time,
            Anchor::End => piece.time - time,
        };
        Self { count, first: first.to_u64(), motion }
    }
}
