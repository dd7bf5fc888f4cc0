//! Due times of one motor's steps: the pieces of a time law, solved for equally
//! spaced path positions.

mod accelerated;
mod even;
mod jerk;
mod phase;
#[cfg(test)]
mod s_curve_tests;
#[cfg(test)]
mod trapezoid_tests;

use crate::pieces::{Never, Pieces};
use crate::s_curve::law::CurvePieces;
use crate::spacing::{MotorSteps, Spacing, Span};
use crate::stretches::Stretch;
use crate::time_law::TimeLaw;
use crate::time_units::{FRACTION_BITS, HALF_TICK};
use crate::trapezoid::TrapezoidPieces;
use phase::{Phase, PhaseMotion, Unsolved};

pub(crate) use accelerated::HotRamp;
pub(crate) use even::EvenSteps;

/// The pieces to come and a motor's steps along them, by what yields the pieces.
#[derive(Clone, Copy, Debug)]
enum Source<P> {
    /// No steps.
    None,
    /// Steps along a trapezoid of at most a quarter of a second.
    Short(Unsolved<f32, TrapezoidPieces<f32>>),
    /// Steps along a longer trapezoid.
    Long(Unsolved<f64, TrapezoidPieces<f64>>),
    /// Steps along a block of a run, and the block's start, in time units from the run's, from
    /// which the pieces count.
    Run(Unsolved<f64, CurvePieces>, u64),
    /// Steps along a law of another kind.
    Other(Unsolved<f64, P>),
}

impl<P: Pieces> Source<P> {
    /// The steps of the next piece that has any.
    #[inline]
    fn next_phase(&mut self) -> Option<Phase> {
        match self {
            Self::None => None,
            Self::Short(unsolved) => unsolved.next_phase(),
            other => other.next_phase_in_f64(),
        }
    }

    // R3.
    #[cold]
    #[inline(never)]
    fn next_phase_in_f64(&mut self) -> Option<Phase> {
        match self {
            Self::None | Self::Short(_) => None,
            Self::Long(unsolved) => unsolved.next_phase(),
            Self::Run(unsolved, start) => {
                let phase = unsolved.next_phase()?;
                Some(Phase { first: phase.first.saturating_sub(*start), ..phase })
            }
            Self::Other(unsolved) => unsolved.next_phase(),
        }
    }
}

/// The step times of a motor along one stretch of a block, in units of 2^-16 tick from the block's
/// start, never decreasing.
///
/// Each phase begins anew from its own time, so that rounding never adds up over more than a phase.
/// At a constant acceleration the interval is 2h/(v_k + v_k+1) with v_k = sqrt(v_0^2 + 2 a h k), in
/// f32; at a constant speed it is constant.
#[derive(Clone, Copy, Debug)]
pub struct StepTimes<P = Never> {
    /// Due time of the next of the `left` steps. Meaningless if none is left: read it through
    /// [`Self::next`] only.
    due: u64,
    /// Steps left in the phase; without any, no step is due any more.
    left: u32,
    motion: PhaseMotion,
    /// 2^-16 time units that `due` lacks.
    beyond: u32,
    source: Source<P>,
}

impl<P: Pieces> StepTimes<P> {
    /// No steps.
    pub const NONE: Self =
        Self { due: 0, left: 0, motion: PhaseMotion::Even(EvenSteps::EMPTY), beyond: 0, source: Source::None };

    /// Starts with the steps of a motor in a stretch of a block, none of them due before
    /// `earliest`. Every field is set here or by `enter_phase`: nothing of a block that was
    /// abandoned half-way remains.
    #[inline]
    pub fn start(&mut self, law: &TimeLaw<P>, stretch: &Stretch, steps: &MotorSteps, earliest: u64) {
        match law {
            TimeLaw::Short(law) => {
                let span = Span::of(stretch, law.length, law.per_length);
                self.source = Source::Short(Unsolved::new(law.pieces(), Spacing::new(&span, steps)));
            }
            law => self.set_source_in_f64(law, stretch, steps),
        }
        self.due = earliest;
        self.left = 0;
        self.beyond = 0;
        self.enter_phase();
    }

    // R3, R8.
    #[cold]
    #[inline(never)]
    fn set_source_in_f64(&mut self, law: &TimeLaw<P>, stretch: &Stretch, steps: &MotorSteps) {
        let spacing = |length: f64, per_length: f64| Spacing::new(&Span::of(stretch, length, per_length), steps);
        self.source = match law {
            TimeLaw::Short(_) => Source::None,
            TimeLaw::Long(law) => Source::Long(Unsolved::new(law.pieces(), spacing(law.length, law.per_length))),
            TimeLaw::Run(law) => {
                let steps = spacing(law.length, 1.0 / law.length);
                Source::Run(Unsolved::new(law.pieces(), steps), law.start)
            }
            TimeLaw::Other(law) => Source::Other(Unsolved::new(law.pieces, spacing(law.length, 1.0 / law.length))),
        };
    }

    /// Due time of the next step; `None` after the last.
    #[inline]
    pub fn next(&self) -> Option<u64> {
        if self.left > 0 { Some(self.due) } else { None }
    }

    /// Ticks from `last`, a whole tick, up to which no step is due; cut to 32 bits.
    #[inline]
    pub(crate) fn ticks_from(&self, last: u64) -> u32 {
        let Some(due) = self.next() else { return u32::MAX };
        let after = due.wrapping_add(HALF_TICK).wrapping_sub(last);
        if after.cast_signed() < 0 { 0 } else { u32::try_from(after >> FRACTION_BITS).unwrap_or(u32::MAX) }
    }

    /// Interval of the cruise, and the steps left in it, the next one included; `None`
    /// outside a cruise.
    #[inline]
    pub(crate) fn cruise(&self) -> Option<(EvenSteps, u32)> {
        match self.motion {
            PhaseMotion::Even(cruise) => Some((cruise, self.left)),
            PhaseMotion::Accelerated(_) | PhaseMotion::Jerk(_) => None,
        }
    }

    /// 2^-16 time units by which the next step is due later.
    #[inline]
    pub(crate) fn beyond(&self) -> u32 {
        self.beyond
    }

    /// Takes `count` steps of a cruise. The next one of the cruise would be due at `due`,
    /// and `beyond` later.
    #[inline]
    pub(crate) fn end_cruise(&mut self, count: u32, due: u64, beyond: u32) {
        self.left = self.left.wrapping_sub(count);
        self.due = due;
        self.beyond = beyond;
        if self.left == 0 {
            // The next phase does not begin before the last step.
            if let PhaseMotion::Even(cruise) = &self.motion {
                self.due = due.wrapping_sub(cruise.interval);
            }
            self.enter_phase();
        }
    }

    /// Next steps of a ramp for one loop, and how many it may take; `None` outside a ramp.
    #[inline(always)]
    pub(crate) fn hot_ramp(&self) -> Option<(HotRamp, u32)> {
        match &self.motion {
            PhaseMotion::Accelerated(ramp) => ramp.hot(self.left),
            PhaseMotion::Even(_) | PhaseMotion::Jerk(_) => None,
        }
    }

    /// Takes over `count` steps that a loop has taken. The one after the last would be due at `due`
    /// if that `is_next`; if not, the last one taken was.
    #[inline(always)]
    pub(crate) fn end_hot_ramp(&mut self, run: &HotRamp, count: u32, due: u64, is_next: bool) {
        self.due = due;
        self.left = self.left.wrapping_sub(count);
        if self.left == 0 {
            if is_next && count > 0 {
                // The next phase does not begin before the last step.
                self.due = due.wrapping_sub(run.units());
            }
            self.enter_phase();
            return;
        }
        if let PhaseMotion::Accelerated(ramp) = &mut self.motion {
            ramp.set_hot(run);
        }
        if !is_next {
            self.due = due.wrapping_add(run.units());
        }
    }

    /// Takes `count` steps; more than one only where `cruise` has as many.
    #[inline]
    pub fn take(&mut self, count: u32) {
        self.left = self.left.wrapping_sub(count);
        if self.left == 0 {
            self.enter_phase();
        } else {
            self.pass(count);
        }
    }

    /// Computes the time of the next step in the same phase.
    #[inline]
    fn pass(&mut self, count: u32) {
        match &mut self.motion {
            PhaseMotion::Accelerated(ramp) => self.due = self.due.wrapping_add(ramp.units()),
            PhaseMotion::Jerk(ramp) => self.due = self.due.wrapping_add(ramp.units()),
            PhaseMotion::Even(cruise) => {
                let beyond = self.beyond.wrapping_add(u32::from(cruise.beyond).wrapping_mul(count));
                self.beyond = beyond & 0xffff;
                let passed = cruise.interval.wrapping_mul(u64::from(count)).wrapping_add(u64::from(beyond >> 16));
                self.due = self.due.wrapping_add(passed);
            }
        }
    }

    /// Begins with the next phase that has steps.
    #[inline(never)]
    fn enter_phase(&mut self) {
        let Some(phase) = self.source.next_phase() else { return };
        self.motion = phase.motion;
        self.beyond = 0;
        self.due = self.due.max(phase.first);
        self.left = phase.count;
    }
}
