//! A law in pieces.

use crate::motion::Motion;
use std::fmt;

/// Pieces may overlap or leave a gap by this much: rounding of long sums.
const JOINT_S: f64 = 1e-6;

/// A part of a law: a parabola in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// The motion at its start.
    pub motion: Motion,
}

impl Piece {
    /// Returns its end, s.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.duration_s
    }

    /// The motion at a time, s, which need not be within the piece.
    pub fn at(&self, time_s: f64) -> Motion {
        self.motion.after(time_s - self.start_s)
    }
}

/// Reason for which pieces are not a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LawError {
    /// The list of pieces is empty.
    Empty,
    /// A number of the piece with this index is not finite, or its duration is not positive.
    Number(usize),
    /// The piece with this index does not begin where the one before ends.
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

/// Position against time of one coordinate, in pieces that follow each other. The coordinate is at
/// rest before the first and after the last. A position may jump between two pieces, as that of an
/// extruder with pressure advance does.
#[derive(Clone, Debug, PartialEq)]
pub struct Law {
    pieces: Vec<Piece>,
}

impl Law {
    /// A law of these pieces.
    ///
    /// # Errors
    /// The pieces do not follow each other, or a number is not usable.
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

    /// The pieces; never empty.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Returns the beginning and end of the motion, s.
    pub fn ends_s(&self) -> [f64; 2] {
        match self.pieces.as_slice() {
            [] => [0.0; 2],
            [only] => [only.start_s, only.end_s()],
            [first, .., last] => [first.start_s, last.end_s()],
        }
    }

    /// The motion at a time, s; at a joint that of the later piece.
    pub fn at(&self, time_s: f64) -> Motion {
        self.piece_motion(self.pieces.partition_point(|piece| piece.start_s <= time_s), time_s)
    }

    /// The motion in the piece before the one with this index; 0 is before the first.
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

    /// The law of position plus a time constant times speed: linear pressure advance. `applies`
    /// says for which pieces.
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
