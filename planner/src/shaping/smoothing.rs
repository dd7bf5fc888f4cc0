//! The moving average of a filter: the difference of positions summed over time, at two delays.
//!
//! A sum continues from piece to piece of the plan in whole numbers, modulo 2^64, so that two
//! cursors that have passed the same pieces have the same sum, and their difference is exact
//! however long the plan is.

use super::fixed::{self, Mean};
use super::plan_ring::PlanPiece;

/// Bits of the ticks after which a long piece is summed up to a place within it: single products
/// hold what follows.
const CELL_BITS: u32 = 22;

/// The positions of all motors summed over time up to a place of the plan, 2^-16 steps times ticks
/// and modulo 2^64.
#[derive(Clone, Copy, Debug)]
pub(super) struct PositionSums([i64; 4]);

/// A place of the plan: a number of cells after the start of a piece. Only the motors of the mask
/// are summed there.
// Apart from the sums, so that a delay has no gaps in memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Anchor<'a> {
    pub piece: &'a PlanPiece,
    pub cells: u32,
    pub motors: u8,
}

/// Origin of positions: X's, Y's and Z's motors (A, B, Z) and the extruder, whole steps, near
/// their positions.
pub(super) type Reference = [i64; 4];

impl Anchor<'_> {
    /// Ticks from the piece's start.
    #[inline]
    fn ticks(&self) -> u64 {
        u64::from(self.cells) << CELL_BITS
    }

    /// The positions summed over `ticks` from here on.
    fn summed(&self, ticks: u32, near: &Reference) -> [i64; 4] {
        let [.., extruder] = near;
        self.piece.summed(self.ticks(), ticks, self.motors, extruder.wrapping_mul(256))
    }
}

impl PositionSums {
    /// Zero sums, at the start of the first piece.
    pub const NONE: Self = Self([0; 4]);

    fn add(&mut self, added: [i64; 4]) {
        for (sum, added) in self.0.iter_mut().zip(added) {
            *sum = sum.wrapping_add(added);
        }
    }

    /// Advances to the last cell of the piece that ends by then, `ticks` after the piece's start;
    /// returns which that is.
    #[inline]
    pub fn pass_cells(&mut self, anchor: Anchor<'_>, ticks: u64, near: &Reference) -> u32 {
        let mut anchor = anchor;
        while anchor.ticks().wrapping_add(1 << CELL_BITS) <= ticks {
            self.add(anchor.summed(1 << CELL_BITS, near));
            anchor.cells = anchor.cells.wrapping_add(1);
        }
        anchor.cells
    }

    /// Advances to the start of the next piece, which begins `ticks` after this one.
    #[inline(never)]
    pub fn pass_piece(&mut self, anchor: Anchor<'_>, ticks: u64, near: &Reference) {
        let anchor = Anchor { cells: self.pass_cells(anchor, ticks, near), ..anchor };
        self.add(anchor.summed(ticks.wrapping_sub(anchor.ticks()) as u32, near));
    }

    /// The sums `ticks` after the start of the anchor's piece; negative ticks lie before the first
    /// piece, where everything rests.
    fn at(&self, anchor: &Anchor<'_>, ticks: i64, near: &Reference) -> [i64; 4] {
        let mut sums = *self;
        sums.add(if ticks < 0 {
            let [.., extruder] = near;
            anchor.piece.summed_before(ticks.wrapping_neg(), extruder.wrapping_mul(256))
        } else {
            anchor.summed(ticks.cast_unsigned().wrapping_sub(anchor.ticks()) as u32, near)
        });
        sums.0
    }
}

/// A moving average over a number of ticks.
#[derive(Clone, Copy, Debug)]
pub(super) struct MovingAverage {
    pub ticks: u32,
    mean: Mean,
}

/// A time of the plan: the sums up to an anchor before it, and ticks since the
/// anchor's piece began.
pub(super) type Seen<'a> = (&'a PositionSums, Anchor<'a>, i64);

impl MovingAverage {
    /// No average.
    pub const NONE: Self = Self { ticks: 0, mean: Mean::NONE };

    /// Average over `ticks`.
    #[cold]
    pub fn over(ticks: u32) -> Self {
        Self { ticks, mean: Mean::over(ticks) }
    }

    /// Mean positions of the motors between two times of the plan that are `ticks` apart, 2^-32
    /// step; the extruder's counts from the reference's.
    pub fn between(&self, late: Seen<'_>, early: Seen<'_>, near: &Reference) -> [i64; 4] {
        let at = |(sums, anchor, ticks): Seen<'_>| sums.at(&anchor, ticks, near);
        let (mut places, before) = (at(late), at(early));
        for ((place, before), near) in places.iter_mut().zip(before).zip(near) {
            let stands = near.wrapping_mul(i64::from(self.ticks)) << 16;
            *place = self.mean.of(place.wrapping_sub(before).wrapping_sub(stands));
        }
        let ([x, y, z, extruder], [near_x, near_y, near_z, _]) = (places, near);
        let from_zero = |place: i64, near: &i64| place.wrapping_add(fixed::of_steps(*near));
        let (_, anchor, _) = late;
        let extruder = extruder.wrapping_add(anchor.piece.extruder_away());
        [from_zero(x, near_x), from_zero(y, near_y), from_zero(z, near_z), extruder]
    }
}
