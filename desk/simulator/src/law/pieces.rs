//! Laws of motion in pieces.

use crate::motion::Motion;
use std::fmt;

/// Maximum gap or overlap of two pieces, s: the rounding of long sums.
const JOINT_S: f64 = 1e-6;

/// Part of a law: a parabola in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Motion at the start.
    pub motion: Motion,
}

impl Piece {
    /// Returns the piece's end, s.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.duration_s
    }

    /// Returns the motion at a time, s, which need not be within the piece.
    pub fn at(&self, time_s: f64) -> Motion {
        self.motion.after(time_s - self.start_s)
    }
}

/// Reason why pieces are not a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LawError {
    /// The list of pieces is empty.
    Empty,
    /// A number of the piece with this index is not finite, or its duration is not above 0.
    Number(usize),
    /// The piece with this index does not begin where the previous one ends.
    Joint(usize),
}

impl fmt::Display for LawError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(out, "a law needs a piece"),
            Self::Number(index) => write!(out, "piece {index}: a number is not finite, or the duration not positive"),
            Self::Joint(index) => write!(out, "piece {index} does not begin when the one before ends"),
        }
    }
}

impl std::error::Error for LawError {}

/// Position of one coordinate against time, in consecutive pieces. The coordinate is at rest before
/// the first piece and after the last. The position may jump between two pieces, as that of an
/// extruder with pressure advance does.
#[derive(Clone, Debug, PartialEq)]
pub struct Law {
    pieces: Vec<Piece>,
}

impl Law {
    /// Creates a law from pieces.
    ///
    /// # Errors
    /// The pieces are not consecutive, or a number is unusable.
    pub fn new(pieces: Vec<Piece>) -> Result<Self, LawError> {
        let mut end_s = None;
        for (index, piece) in pieces.iter().enumerate() {
            let Motion { position_mm, speed_mm_per_s, acceleration_mm_per_s2 } = piece.motion;
            let numbers = [piece.start_s, piece.duration_s, position_mm, speed_mm_per_s, acceleration_mm_per_s2];
            if numbers.iter().any(|number| !number.is_finite()) || piece.duration_s <= 0.0 {
                return Err(LawError::Number(index));
            }
            if end_s.is_some_and(|end_s: f64| (end_s - piece.start_s).abs() > JOINT_S) {
                return Err(LawError::Joint(index));
            }
            end_s = Some(piece.end_s());
        }
        if pieces.is_empty() { Err(LawError::Empty) } else { Ok(Self { pieces }) }
    }

    /// Returns the pieces; never empty.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Returns the start and the end of the motion, s.
    pub fn ends_s(&self) -> [f64; 2] {
        match self.pieces.as_slice() {
            [] => [0.0; 2],
            [only] => [only.start_s, only.end_s()],
            [first, .., last] => [first.start_s, last.end_s()],
        }
    }

    /// Returns the motion at a time, s; at a joint, that of the later piece.
    pub fn at(&self, time_s: f64) -> Motion {
        self.piece_motion(self.pieces.partition_point(|piece| piece.start_s <= time_s), time_s)
    }

    /// Returns the motion in the piece before the one with index `next`; 0 means before the first
    /// piece.
    pub(super) fn piece_motion(&self, next: usize, time_s: f64) -> Motion {
        let Some(index) = next.checked_sub(1) else {
            return Motion::standing(self.pieces.first().map_or(0.0, |first| first.motion.position_mm));
        };
        match self.pieces.get(index) {
            Some(piece) if next < self.pieces.len() || time_s < piece.end_s() => piece.at(time_s),
            Some(last) => Motion::standing(last.at(last.end_s()).position_mm),
            None => Motion::default(),
        }
    }

    /// Applies linear pressure advance: the position plus a time constant times the speed, in the
    /// pieces for which `applies` returns true.
    pub fn advanced(&self, time_constant_s: f64, applies: impl Fn(usize) -> bool) -> Self {
        let pieces = self.pieces.iter().enumerate().map(|(index, piece)| {
            let gain_s = if applies(index) { time_constant_s } else { 0.0 };
            let Motion { speed_mm_per_s, acceleration_mm_per_s2, .. } = piece.motion;
            let lead = Motion {
                position_mm: speed_mm_per_s,
                speed_mm_per_s: acceleration_mm_per_s2,
                acceleration_mm_per_s2: 0.0,
            };
            Piece { motion: piece.motion.plus(gain_s, lead), ..*piece }
        });
        Self { pieces: pieces.collect() }
    }
}
