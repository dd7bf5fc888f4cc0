//! Moves that continue each other become one block.
//!
//! Slicers cut curves, and at times straight lines, into moves of a few hundredths of a mm. Each would take a place of
//! the look-ahead ring, which then sees only millimetres ahead. So the newest block stays open, outside the ring, until
//! the next move is there, and takes it in if nobody could tell the difference: neither in the speeds nor in where the
//! motors stand when a move ends.

use crate::block::{Block, Speed};
use crate::extruder::rounded_steps;
use crate::inner_ends::{InnerEnd, MAX_INNER_ENDS};
use crate::junction::Pull;
use crate::path::Path;

/// Longest block that is made of several moves, units of 10 nm: what an inner end's place can tell.
const LONGEST_10NM: u32 = u16::MAX as u32;

/// How far an end inside a block may be from the block's straight line, on each axis, units of 10 nm: together at most
/// 1 um, a twelfth of a step of 1/80 mm.
const TOLERANCE_10NM: i64 = 57;

/// A move planned by itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planned {
    /// Its block.
    pub block: Block,
    /// Bound of the speed at its start, by the corner there.
    pub junction: Speed,
    /// Its way.
    pub path: Path,
    /// Whether the filament moves alone: as if there were no way.
    pub is_filament_alone: bool,
    /// Its acceleration, as its corners see it; none where the filament moves alone.
    pub pull: Pull,
}

/// A place inside the block.
#[derive(Clone, Copy, Debug)]
struct Inside {
    vector_10nm: [i32; 3],
    length_10nm: u32,
    steps: [i32; 3],
    extruder_256ths: i32,
    /// Whether a move ends here; otherwise it is a corner of an arc.
    ends_move: bool,
}

impl Inside {
    /// The start.
    const START: Self =
        Self { vector_10nm: [0; 3], length_10nm: 0, steps: [0; 3], extruder_256ths: 0, ends_move: false };
}

/// The newest block, which may still grow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Open {
    /// The moves so far as one block.
    pub block: Block,
    /// Bound of the speed at its start.
    pub junction: Speed,
    /// Number of moves in it; 0 where no block is open.
    pub moves: u32,
    /// Where the extruder stands at its start.
    pub extruder_256ths: i64,
    /// The way from its start to its end; `None` for the filament alone.
    vector_10nm: [i32; 3],
    is_filament_alone: bool,
    /// The places inside, as many as moves but the last.
    inside: [Inside; MAX_INNER_ENDS],
}

impl Open {
    /// No block.
    pub const NONE: Self = Self {
        block: Block::NONE,
        junction: Speed::ZERO,
        moves: 0,
        extruder_256ths: 0,
        vector_10nm: [0; 3],
        is_filament_alone: true,
        inside: [Inside::START; MAX_INNER_ENDS],
    };

    /// Whether there is a block.
    pub fn is_some(&self) -> bool {
        self.moves > 0
    }

    /// A block of one move that starts with the extruder here.
    #[inline(always)]
    pub fn begin(&mut self, planned: &Planned, extruder_256ths: i64) {
        self.block = planned.block;
        self.junction = planned.junction;
        self.moves = 1;
        self.extruder_256ths = extruder_256ths;
        self.set_way(planned.path.vector_10nm, planned.is_filament_alone);
    }

    /// The way of a block of one move.
    #[inline(always)]
    pub fn set_way(&mut self, vector_10nm: [i32; 3], is_filament_alone: bool) {
        self.vector_10nm = vector_10nm;
        self.is_filament_alone = is_filament_alone;
    }

    /// Forgets the block.
    pub fn clear(&mut self) {
        self.moves = 0;
    }

    /// Takes the next move in, if that changes nothing: same nominal speed and acceleration, a corner that limits
    /// neither, and at each end inside the motors at the steps where they would have stood.
    ///
    /// Of a move whose plan found that (`is_planned`) the extruder is not asked where it stands at the ends inside: that depends
    /// on the part of a step that it had left over before the job, and on a flow that has been changed since.
    pub fn absorb(&mut self, next: &Planned, is_planned: bool) -> bool {
        let turns = || {
            let [before, after] = [&self.block, &next.block].map(|block| block.extruder_256ths.signum());
            before != after && !(is_planned && before * after == 0)
        };
        // The commonest reasons against it come first.
        let length_10nm = self.block.length_10nm.saturating_add(next.block.length_10nm);
        if length_10nm > LONGEST_10NM
            || !self.is_some()
            || next.block.nominal != self.block.nominal
            || next.block.acceleration != self.block.acceleration
            || next.junction < self.block.nominal
            || turns()
        {
            return false;
        }
        self.joined(next, length_10nm).is_some_and(|whole| self.become_whole(whole, is_planned))
    }

    /// The block and its way with the next move in it; `None` where they are out of range.
    fn joined(&self, next: &Planned, length_10nm: u32) -> Option<Whole> {
        let mut block = self.block;
        block.steps = sums(block.steps, next.block.steps)?;
        block.extruder_256ths = block.extruder_256ths.checked_add(next.block.extruder_256ths)?;
        block.length_10nm = length_10nm;
        block.line = next.block.line;
        block.ends_move = next.block.ends_move;
        if self.block.ends_move {
            let end = InnerEnd { length_10nm: self.block.length_10nm, line: self.block.line };
            block.inner_ends = block.inner_ends.with(end, next.block.line)?;
        } else if self.block.line != next.block.line {
            return None;
        }
        if self.is_filament_alone || next.is_filament_alone {
            return None;
        }
        let vector_10nm = sums(self.vector_10nm, next.path.vector_10nm)?;
        Some(Whole { block, vector_10nm, extruder_256ths: self.extruder_256ths })
    }

    /// Takes a longer block's shape if that passes all places inside; whether it does.
    fn become_whole(&mut self, whole: Whole, is_planned: bool) -> bool {
        let end = Inside {
            vector_10nm: self.vector_10nm,
            length_10nm: self.block.length_10nm,
            steps: self.block.steps,
            extruder_256ths: self.block.extruder_256ths,
            ends_move: self.block.ends_move,
        };
        let (before, rest) = self.inside.split_at_mut((self.moves as usize - 1).min(MAX_INNER_ENDS));
        let Some(place) = rest.first_mut() else { return false };
        let passes = |place| whole.passes(place) && (is_planned || whole.has_extruder_at(place));
        if !passes(&end) || !before.iter().all(passes) {
            return false;
        }
        *place = end;
        self.block = whole.block;
        self.vector_10nm = whole.vector_10nm;
        self.moves += 1;
        true
    }
}

/// A block as it would become.
struct Whole {
    block: Block,
    vector_10nm: [i32; 3],
    extruder_256ths: i64,
}

impl Whole {
    /// Whether the block comes near enough to a place inside it and, where a move ends, has the motors but the extruder at its
    /// steps.
    fn passes(&self, place: &Inside) -> bool {
        let (at, whole) = (i64::from(place.length_10nm), i64::from(self.block.length_10nm));
        let near = place
            .vector_10nm
            .iter()
            .zip(self.vector_10nm)
            .all(|(place, end)| (i64::from(*place) * whole - i64::from(end) * at).abs() <= TOLERANCE_10NM * whole);
        near && (!place.ends_move || self.motors_stand_at(place))
    }

    /// Whether, where a move ends, the block has the extruder at its step.
    fn has_extruder_at(&self, place: &Inside) -> bool {
        !place.ends_move || self.extruder_stands_at(place)
    }

    /// As the interpolator steps: the master's step k of N at (k - 1/2) S/N, the followers with the master's step k where
    /// 2 k n first passes (2 j - 1) N. A tie counts as a difference.
    ///
    /// Between the ends no motor may be more than a step from where the unmerged moves' straight lines have it, as
    /// everywhere. The block's own line passes the place up to half a step off; that leaves half a step to the master, and
    /// to a master's equal, which are within half a step of that line. A follower is within (1 + n/N)/2, so for it the line
    /// may be (1 - n/N)/2 off.
    fn motors_stand_at(&self, place: &Inside) -> bool {
        let (at, whole) = (i64::from(place.length_10nm), i64::from(self.block.length_10nm));
        let totals = self.block.steps.map(|steps| i64::from(steps).abs());
        // Steps against the direction of the whole count as negative, and are never right.
        let [x, y, z] = [0, 1, 2].map(|motor: usize| {
            let (steps, total) = (place.steps[motor], self.block.steps[motor]);
            i64::from(if total < 0 { steps.saturating_neg() } else { steps })
        });
        let steps = [x, y, z];
        let master = match totals {
            [x, y, z] if x >= y && x >= z => 0,
            [_, y, z] if y >= z => 1,
            _ => 2,
        };
        let (all, made) = (totals[master], steps[master]);
        let master_agrees = (2 * made - 1) * whole < 2 * all * at && 2 * all * at < (2 * made + 1) * whole;
        master_agrees
            && (0..3).filter(|&motor| motor != master).all(|motor| {
                let (total, stands) = (totals[motor], steps[motor]);
                let in_step = total == 0 && stands == 0
                    || 2 * made * total > (2 * stands - 1) * all && 2 * made * total <= (2 * stands + 1) * all;
                // Steps times S that the straight line between the rounded ends passes beside the place.
                let off = (total * at - stands * whole).abs();
                in_step && (total == all || 2 * off * all <= (all - total) * whole)
            })
    }

    /// Whether e0 + dE s/S rounds to the step at which the place has the extruder. A tie counts as a difference.
    fn extruder_stands_at(&self, place: &Inside) -> bool {
        let (at, whole) = (i64::from(place.length_10nm), i64::from(self.block.length_10nm));
        let stands = rounded_steps(self.extruder_256ths + i64::from(place.extruder_256ths));
        let from_start = stands * 256 - self.extruder_256ths;
        let travel = i64::from(self.block.extruder_256ths) * at;
        (from_start - 128) * whole < travel && travel < (from_start + 128) * whole
    }
}

/// Sums of the components, where they are in range.
fn sums(one: [i32; 3], other: [i32; 3]) -> Option<[i32; 3]> {
    let ([x, y, z], [dx, dy, dz]) = (one, other);
    Some([x.checked_add(dx)?, y.checked_add(dy)?, z.checked_add(dz)?])
}
