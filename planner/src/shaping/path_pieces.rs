//! A time law as polynomials in time: what a filter can delay and add.

use crate::block::PlannedBlock;
use crate::piece::{Anchor, Motion, Piece, PieceEnd};
use crate::pieces::Pieces;
use crate::time_law::TimeLaw;
use crate::time_units::{FRACTION_BITS, TICKS};
use crate::trapezoid::Trapezoid;

/// The most pieces of a block's law: those of an S-curve.
const MAX_PIECES: usize = 7;

/// Time units in a tick.
const UNITS_PER_TICK: f64 = (1u32 << FRACTION_BITS) as f64;

/// Position over time, a polynomial of third degree at most: units of path (or steps) and ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Polynomial {
    pub position: f64,
    pub speed: f64,
    pub acceleration: f64,
    pub jerk: f64,
}

impl Polynomial {
    /// Standstill.
    const ZERO: Self = Self { position: 0.0, speed: 0.0, acceleration: 0.0, jerk: 0.0 };

    /// The position after `ticks`.
    #[inline(never)]
    pub fn position_after(&self, ticks: f64) -> f64 {
        let Self { position, speed, acceleration, jerk } = *self;
        let bend = if jerk == 0.0 { acceleration } else { acceleration + ticks * jerk * (1.0 / 3.0) };
        position + ticks * (speed + 0.5 * ticks * bend)
    }

    /// The motion from `ticks` later on.
    #[inline(never)]
    pub fn after(&self, ticks: f64) -> Self {
        let Self { speed, acceleration, jerk, .. } = *self;
        Self {
            position: self.position_after(ticks),
            speed: speed + ticks * (acceleration + 0.5 * ticks * jerk),
            acceleration: acceleration + ticks * jerk,
            jerk,
        }
    }

    /// The motion in another time, a tick of which is `1 / factor` of this.
    #[inline(never)]
    fn hastened(&self, factor: f64) -> Self {
        let square = factor * factor;
        Self {
            position: self.position,
            speed: self.speed * factor,
            acceleration: self.acceleration * square,
            jerk: self.jerk * square * factor,
        }
    }

    /// Another unit of path, of which one makes `1 / factor` of this, counted from another zero.
    pub fn scaled(&self, zero: f64, factor: f64) -> Self {
        Self {
            position: (self.position - zero) * factor,
            speed: self.speed * factor,
            acceleration: self.acceleration * factor,
            jerk: self.jerk * factor,
        }
    }
}

/// A piece of a block's law: path in units of 10 nm from the block's start.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathPiece {
    /// Start and end, ticks from the block's start.
    pub start: f64,
    pub end: f64,
    /// The path from its start.
    pub path: Polynomial,
}

/// The pieces of a block's law, in their order and without gaps.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathPieces {
    pieces: [PathPiece; MAX_PIECES],
    count: usize,
    /// The block's duration, whole ticks.
    pub duration_ticks: u64,
}

impl PathPieces {
    /// Empty.
    pub const NONE: Self = Self {
        pieces: [PathPiece { start: 0.0, end: 0.0, path: Polynomial::ZERO }; MAX_PIECES],
        count: 0,
        duration_ticks: 0,
    };

    /// Adds the pieces of a planned block to an empty list.
    #[inline(never)]
    pub fn add<P: Pieces>(&mut self, planned: &PlannedBlock, law: &TimeLaw<P>) {
        let length = f64::from(planned.block.length_10nm.max(1));
        match law {
            // Positions are added up over many blocks' time: single precision, exact enough for
            // one, is not for these.
            TimeLaw::Short(_) => self.add_trapezoid(&Trapezoid::new(planned), length),
            TimeLaw::Long(law) => self.add_trapezoid(law, length),
            TimeLaw::Run(run) => {
                run.pieces().for_each(|piece| self.push(&piece, run.start as f64, length));
                self.duration_ticks = run.duration_ticks();
            }
            // Filters are refused beside the laws of other methods.
            TimeLaw::Other(_) => {}
        }
    }

    #[inline(never)]
    fn add_trapezoid(&mut self, law: &Trapezoid<f64>, length: f64) {
        law.pieces().for_each(|piece| self.push(&piece, 0.0, length));
        self.end_at_a_tick();
    }

    /// Makes the block last a whole number of ticks (under an S-curve, the run's blocks continue at
    /// the same fraction of one): it passes each place in proportion earlier or later. Without that
    /// the position would jump where the next block begins.
    #[inline(never)]
    fn end_at_a_tick(&mut self) {
        let end = self.iter().last().map_or(0.0, |last| last.end);
        self.duration_ticks = (end + 0.5) as u64;
        if self.duration_ticks == 0 {
            self.count = 0;
            return;
        }
        let longer = self.duration_ticks as f64 / end;
        let faster = end / self.duration_ticks as f64;
        for piece in self.pieces.iter_mut().take(self.count) {
            *piece =
                PathPiece { start: piece.start * longer, end: piece.end * longer, path: piece.path.hastened(faster) };
        }
    }

    /// The pieces in order.
    pub fn iter(&self) -> impl Iterator<Item = &PathPiece> {
        self.pieces.iter().take(self.count)
    }

    /// Adds a piece whose times count from `zero`, time units, in a block of this length.
    #[inline(never)]
    fn push(&mut self, piece: &Piece<f64>, zero: f64, length: f64) {
        let start = self.count.checked_sub(1).and_then(|last| self.pieces.get(last)).map_or(0.0, |last| last.end);
        let anchor_ticks = (piece.time - zero) * (1.0 / UNITS_PER_TICK);
        let (distance, speed, acceleration, jerk) = from_anchor(piece, length);
        let (end, position, acceleration) = match piece.anchor {
            Anchor::Start => (anchor_ticks + distance_ticks(piece, distance), piece.position, acceleration),
            Anchor::End => (anchor_ticks, length - piece.position, -acceleration),
        };
        let Some(place) = self.pieces.get_mut(self.count) else { return };
        if end <= start {
            return;
        }
        let at_anchor = Polynomial { position, speed, acceleration, jerk };
        *place = PathPiece { start, end, path: at_anchor.after(start - anchor_ticks) };
        self.count += 1;
    }
}

/// The length of a piece, and speed, acceleration away from its anchor and jerk, in
/// 10 nm and ticks.
fn from_anchor(piece: &Piece<f64>, length: f64) -> (f64, f64, f64, f64) {
    let end = match (piece.anchor, piece.end) {
        (Anchor::End, _) => piece.position,
        (Anchor::Start, PieceEnd::FromStart(end)) => end,
        (Anchor::Start, PieceEnd::ToEnd(rest)) => length - rest,
        (Anchor::Start, PieceEnd::Last) => length,
    };
    let (speed, acceleration, jerk) = match piece.motion {
        Motion::Constant { path, time } => (path / time * UNITS_PER_TICK, 0.0, 0.0),
        Motion::Accelerated { speed, gain } => (speed * (1.0 / TICKS), 0.5 * gain * (1.0 / TICKS / TICKS), 0.0),
        Motion::Jerk { curve, duration } => {
            if duration <= 0.0 {
                return (0.0, 0.0, 0.0, 0.0);
            }
            let per_tick = UNITS_PER_TICK / duration;
            (curve.linear * per_tick, 0.0, 6.0 * curve.cubic * per_tick * per_tick * per_tick)
        }
    };
    (end - piece.position, speed, acceleration, jerk)
}

/// Time of a piece from its anchor over a distance, ticks.
fn distance_ticks(piece: &Piece<f64>, distance: f64) -> f64 {
    if distance > 0.0 { piece.motion.time_over(distance) * (1.0 / UNITS_PER_TICK) } else { 0.0 }
}
