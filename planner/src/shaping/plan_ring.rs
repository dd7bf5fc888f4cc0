//! Past and present plan: the pieces that a filter still sees.

use super::fixed::{self, PartLaw, PartRates, PartScale};
use crate::pressure_advance::AdvanceSlope;

/// Pieces that the ring holds. The budget keeps moves long enough that no filter sees more
/// ([`MOST_IN_FILTER`]).
const PIECES: u32 = 64;

/// The most pieces that may begin within the length of a filter: the ring's, less those of a
/// block that enters it.
pub(crate) const MOST_IN_FILTER: u32 = PIECES - 28;

/// Amount added to the extruder's position away from zero, 2^-32 step: more than rounding leaves,
/// less than a tick.
const HALF_AWAY: i64 = 4;

/// A piece of the plan: all motors on a straight line, by one law.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlanPiece {
    /// Tick of the motion clock at which it begins.
    pub start: u64,
    /// Part of the line that is done.
    pub part: PartLaw,
    /// Positions of X, Y and Z (A, B, Z) at the line's start.
    pub steps: [i32; 3],
    /// The extruder there, 1/256 steps, modulo 2^32: it is seen from places near it.
    pub extruder_256ths: i32,
    /// The units of [`Self::part`].
    pub scale: PartScale,
    /// True if the extruder's whole position is below zero.
    pub is_extruder_below_zero: bool,
    /// True if the move of [`Self::source_line`] ends with the piece.
    pub ends_move: bool,
    /// Lead of the extruder, and its sum over time at the line's start, 2^-16 steps times ticks
    /// and modulo 2^64.
    pub advance: AdvanceSlope,
    pub advance_sum: i64,
    /// The line, in steps, that of the extruder in 1/256 steps.
    pub line: [i32; 4],
    /// The move's source line.
    pub source_line: u32,
}

impl PlanPiece {
    /// Empty.
    const NONE: Self = Self {
        start: 0,
        part: PartLaw::NONE,
        scale: PartScale::NONE,
        steps: [0; 3],
        extruder_256ths: 0,
        is_extruder_below_zero: false,
        ends_move: false,
        advance: AdvanceSlope::NONE,
        advance_sum: 0,
        line: [0; 4],
        source_line: 0,
    };

    /// Piece in which all motors rest from a tick on.
    pub const fn resting(start: u64, steps: [i32; 3], extruder_256ths: i64, advance_sum: i64) -> Self {
        Self {
            start,
            steps,
            extruder_256ths: extruder_256ths as i32,
            is_extruder_below_zero: extruder_256ths < 0,
            advance_sum,
            ..Self::NONE
        }
    }

    /// The piece with motion along a line.
    pub const fn along(self, line: [i32; 4], (part, scale): (PartLaw, PartScale)) -> Self {
        Self { line, part, scale, ..self }
    }

    /// Part of the line done `ticks` after the start, 2^-56.
    #[inline]
    pub fn part_after(&self, ticks: u64) -> i64 {
        self.part.at(self.scale, ticks)
    }

    /// Rates of the part `ticks` after the start.
    #[inline]
    pub fn rates_after(&self, ticks: u64) -> PartRates {
        self.part.rates_at(self.scale, ticks)
    }

    /// The advance summed over time `ticks` after the start, where this part of the line
    /// is done (2^-56).
    #[inline]
    pub fn advance_sum_after(&self, part: i64, ticks: u64) -> i64 {
        let AdvanceSlope { ticks: slope, constant } = self.advance;
        let [.., line] = self.line;
        let mut sum = self.advance_sum;
        if slope != 0 {
            sum = sum.wrapping_add(fixed::summed_over_time(fixed::along(line, part), slope));
        }
        if constant != 0 {
            sum = sum.wrapping_add(fixed::constant_over_time(constant, ticks));
        }
        sum
    }

    /// Positions of the motors of this mask, 2^-32 step, once this part of the line is done (the
    /// others' are arbitrary); the extruder's counts from `extruder_zero_256ths`, 1/256 steps. The
    /// extruder may have moved so far that its whole position is out of range.
    #[inline]
    pub fn motors_at(&self, part: i64, mask: u8, extruder_zero_256ths: i64) -> [i64; 4] {
        let ([x, y, z], [dx, dy, dz, de]) = (self.steps, self.line);
        let done = |motor: u8, line: i32| if line == 0 || mask & motor == 0 { 0 } else { fixed::along(line, part) };
        let along =
            |motor: u8, start: i32, line: i32| fixed::of_steps(i64::from(start)).wrapping_add(done(motor, line));
        let from_zero = self.extruder_256ths.wrapping_sub(extruder_zero_256ths as i32);
        let extruder = fixed::of_256ths(from_zero).wrapping_add(done(8, de) >> 8).wrapping_add(self.extruder_away());
        [along(1, x, dx), along(2, y, dy), along(4, z, dz), extruder]
    }

    /// The positions of the motors of this mask (others: anything) summed over `ticks`, below 2^24,
    /// from `after` ticks on: 2^-16 steps times ticks, modulo 2^64. The extruder's from its own
    /// zero, found by a place near it, 1/256 steps.
    #[inline(never)]
    pub fn summed(&self, after: u64, ticks: u32, mask: u8, near_256ths: i64) -> [i64; 4] {
        let ([x, y, z], [dx, dy, dz, de]) = (self.steps, self.line);
        let moves = ticks > 0 && self.line != [0; 4];
        let mean = if moves { self.part.mean(self.scale, after, ticks) } else { 0 };
        let along = |motor: u8, line: i32| if line == 0 || mask & motor == 0 { 0 } else { fixed::along(line, mean) };
        let steps = |motor: u8, start: i32, line: i32| {
            let stands = i64::from(start).wrapping_mul(i64::from(ticks)) << 16;
            stands.wrapping_add(fixed::position_over_time(along(motor, line), ticks))
        };
        let stands = self.extruder_start_256ths(near_256ths).wrapping_mul(i64::from(ticks)) << 8;
        let extruder = stands.wrapping_add(fixed::position_over_time(along(8, de) >> 8, ticks));
        [steps(1, x, dx), steps(2, y, dy), steps(4, z, dz), extruder]
    }

    /// Sums of the positions at the piece's start over `ticks` before it.
    #[inline(never)]
    pub fn summed_before(&self, ticks: i64, near_256ths: i64) -> [i64; 4] {
        let [x, y, z] = self.steps.map(|steps| i64::from(steps).wrapping_mul(ticks) << 16);
        [x, y, z, self.extruder_start_256ths(near_256ths).wrapping_mul(ticks) << 8].map(i64::wrapping_neg)
    }

    /// Extruder position at the line's start, 1/256 steps, not modulo 2^32; found from a
    /// position near it.
    #[inline]
    fn extruder_start_256ths(&self, near_256ths: i64) -> i64 {
        near_256ths.wrapping_add(i64::from(self.extruder_256ths.wrapping_sub(near_256ths as i32)))
    }

    /// Amount by which the extruder's position is moved away from zero, 2^-32 step: halves are
    /// rounded away from zero, whatever rounding a sum of them has.
    #[inline]
    pub fn extruder_away(&self) -> i64 {
        if self.is_extruder_below_zero { -HALF_AWAY } else { HALF_AWAY }
    }
}

/// Pieces by their number, counted from the first since standstill and modulo 2^32.
#[derive(Clone, Debug)]
pub(super) struct PlanRing {
    pieces: [PlanPiece; PIECES as usize],
    /// Number of the next piece.
    end: u32,
}

impl PlanRing {
    /// No pieces.
    pub const NEW: Self = Self { pieces: [PlanPiece::NONE; PIECES as usize], end: 0 };

    /// Adds a piece, in place of the oldest.
    pub fn push(&mut self, piece: PlanPiece) {
        if let Some(place) = self.pieces.get_mut((self.end % PIECES) as usize) {
            *place = piece;
        }
        self.end = self.end.wrapping_add(1);
    }

    /// Marks the newest piece as the end of a stretch of this source line, and of its move or not.
    pub fn end_move(&mut self, source_line: u32, ends_move: bool) {
        let newest = self.end.wrapping_sub(1);
        if let Some(piece) = self.pieces.get_mut((newest % PIECES) as usize) {
            (piece.source_line, piece.ends_move) = (source_line, ends_move);
        }
    }

    /// The piece of this number, if it has come and is still there.
    #[inline]
    pub fn get(&self, number: u32) -> Option<&PlanPiece> {
        let age = self.end.wrapping_sub(number);
        if age == 0 || age > PIECES { None } else { self.pieces.get((number % PIECES) as usize) }
    }

    /// Forgets all pieces.
    pub fn clear(&mut self) {
        self.end = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piece_is_as_small_as_its_fields() {
        // The boards' memory has little room: a larger type must be noticed.
        assert_eq!(size_of::<PlanPiece>(), 88);
    }
}
