//! Pieces: the parts of a block's time in which the jerk is constant.
//!
//! A piece is the value at the seam between a time law, which yields pieces in their order,
//! and a stepper, which solves them for the times of one motor's steps. A filter takes pieces
//! and yields pieces.

use crate::cubic::Cubic;
use crate::real::Real;
use crate::time_units::ramp_time;

/// The end of a piece that its figures belong to: the one where rounding would hurt most, which is
/// the slow one of a ramp, and of half an S-curve's ramp the one without acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The start. Positions count from the block's start, and time runs forwards.
    Start,
    /// The end. Positions count back from the block's end, and time runs backwards.
    End,
}

/// Motion of a piece away from its anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion<F> {
    /// Constant speed, which covers `path` (10 nm) in `time` (time units).
    Constant {
        /// Path, 10 nm.
        path: F,
        /// Time for it, time units.
        time: F,
    },
    /// Constant acceleration.
    Accelerated {
        /// Speed at the anchor, 2^-16 mm/s.
        speed: F,
        /// Change of the squared speed over 10 nm: twice the acceleration.
        gain: F,
    },
    /// Constant jerk, from no acceleration at the anchor.
    Jerk {
        /// Path (10 nm) at a share of the duration.
        curve: Cubic<F>,
        /// Duration, time units.
        duration: F,
    },
}

/// End of a piece on a block's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PieceEnd<F> {
    /// Distance from the block's start, 10 nm.
    FromStart(F),
    /// Distance from the block's end, 10 nm.
    ToEnd(F),
    /// End of the block.
    Last,
}

/// A part of a block's time in which the jerk is constant. Lengths are in units of 10 nm, times in
/// units of 2^-16 tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece<F> {
    /// End that the other figures belong to.
    pub anchor: Anchor,
    /// Time at the anchor, from the block's start.
    pub time: F,
    /// Position of the anchor: path to it from the block's start, or from it to the block's end.
    pub position: F,
    /// The motion away from the anchor.
    pub motion: Motion<F>,
    /// End of the piece.
    pub end: PieceEnd<F>,
}

/// A place on a path, from both ends. Neither is worked out from the other: near a standstill,
/// 10 nm take long.
#[derive(Clone, Copy, Debug)]
pub struct Place<F> {
    /// Path from the start, 10 nm.
    pub from_start: F,
    /// Path to the end, 10 nm.
    pub to_end: F,
}

impl<F: Real> PieceEnd<F> {
    /// True if a place is not beyond this end.
    fn holds(&self, place: &Place<F>) -> bool {
        match *self {
            Self::FromStart(end) => place.from_start <= end,
            Self::ToEnd(rest) => place.to_end >= rest,
            Self::Last => true,
        }
    }
}

impl<F: Real> Motion<F> {
    /// Time from the anchor over a distance.
    pub(crate) fn time_over(&self, distance: F) -> F {
        match *self {
            Self::Constant { path, time } => time * distance / path,
            Self::Accelerated { speed, gain } => {
                ramp_time(distance, speed, (speed * speed + gain * distance).square_root())
            }
            Self::Jerk { curve, duration } => curve.solve(distance) * duration,
        }
    }
}

impl<F> Piece<F> {
    /// A piece whose figures belong to its start, which is `position` from the block's start and
    /// passed at `time`.
    #[inline(always)]
    pub const fn leaving(position: F, time: F, motion: Motion<F>, end: PieceEnd<F>) -> Self {
        Self { anchor: Anchor::Start, time, position, motion, end }
    }

    /// A piece whose figures belong to its end, from which it is `position` to the block's end,
    /// passed at `time`.
    #[inline(always)]
    pub const fn arriving(position: F, time: F, motion: Motion<F>, end: PieceEnd<F>) -> Self {
        Self { anchor: Anchor::End, time, position, motion, end }
    }
}

impl<F: Real> Piece<F> {
    /// Path between the anchor and a place in the piece.
    pub(crate) fn distance(&self, place: &Place<F>) -> F {
        let distance = match self.anchor {
            Anchor::Start => place.from_start - self.position,
            Anchor::End => place.to_end - self.position,
        };
        above_zero(distance)
    }

    /// Time at a place in the piece, time units from the block's start.
    fn time_at(&self, place: &Place<F>) -> F {
        let time = self.motion.time_over(self.distance(place));
        match self.anchor {
            Anchor::Start => self.time + time,
            Anchor::End => self.time - time,
        }
    }
}

/// The piece that a place is in; of two the earlier.
pub(crate) fn piece_at<F: Real>(mut pieces: impl Iterator<Item = Piece<F>>, place: &Place<F>) -> Option<Piece<F>> {
    pieces.find(|piece| piece.end.holds(place))
}

/// Time at a place, time units from the block's start.
pub(crate) fn time_at<F: Real>(pieces: impl Iterator<Item = Piece<F>>, place: &Place<F>) -> F {
    piece_at(pieces, place).map_or(F::ZERO, |piece| piece.time_at(place))
}

/// The distance itself, or zero where rounding left a tiny negative one.
#[inline]
pub(crate) fn above_zero<F: Real>(distance: F) -> F {
    if distance > F::ZERO { distance } else { F::ZERO }
}
