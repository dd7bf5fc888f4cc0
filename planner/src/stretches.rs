//! The stretches of a block: one for each of the moves that share it.

use crate::block::Block;
use crate::inner_ends::InnerEnds;

/// A stretch of a block in which one move is executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Path from the block's start to its own, units of 10 nm.
    pub before_10nm: u32,
    /// Path length of the stretch, units of 10 nm, at least 1.
    pub length_10nm: u32,
    /// Path from its end to the block's, units of 10 nm.
    pub after_10nm: u32,
    /// Signed steps of X, Y and Z (CoreXY: A, B, Z).
    pub steps: [i32; 3],
    /// Signed travel of the extruder, 1/256 steps.
    pub extruder_256ths: i32,
    /// Source line of the stretch.
    pub line: u32,
    /// True if the line's move ends with it.
    pub ends_move: bool,
}

impl Stretch {
    /// The whole of a block in which no move ends before the last.
    #[inline]
    pub fn whole(block: &Block) -> Self {
        Self {
            before_10nm: 0,
            length_10nm: block.length_10nm.max(1),
            after_10nm: 0,
            steps: block.steps,
            extruder_256ths: block.extruder_256ths,
            line: block.line,
            ends_move: block.ends_move,
        }
    }
}

/// The stretches of a block, in the order of the path.
#[derive(Clone, Copy, Debug)]
pub struct Stretches {
    ends: InnerEnds,
    index: usize,
    block_line: u32,
    block_length_10nm: u32,
    /// The remainder of the block.
    rest: Option<Stretch>,
}

impl Stretches {
    /// Stretches of a block.
    pub fn of(block: &Block) -> Self {
        Self {
            ends: block.inner_ends,
            index: 0,
            block_line: block.line,
            block_length_10nm: block.length_10nm.max(1),
            rest: Some(Stretch::whole(block)),
        }
    }

    /// True if the last has been handed out.
    pub(crate) fn is_over(&self) -> bool {
        self.rest.is_none()
    }
}

impl Iterator for Stretches {
    type Item = Stretch;

    fn next(&mut self) -> Option<Stretch> {
        let rest = self.rest?;
        let Some(end) = self.ends.get(self.index, self.block_line) else {
            self.rest = None;
            return Some(rest);
        };
        self.index += 1;
        // Ends in another order than the path's make stretches without length; those have their
        // steps all the same.
        let end_10nm = end.length_10nm.clamp(rest.before_10nm, self.block_length_10nm);
        let after_10nm = self.block_length_10nm.saturating_sub(end_10nm);
        let stretch = Stretch {
            before_10nm: rest.before_10nm,
            length_10nm: end_10nm.saturating_sub(rest.before_10nm).max(1),
            after_10nm,
            steps: end.steps,
            extruder_256ths: end.extruder_256ths,
            line: end.line,
            ends_move: end.ends_move,
        };
        let [x, y, z] = rest.steps;
        let [dx, dy, dz] = end.steps;
        self.rest = Some(Stretch {
            before_10nm: end_10nm,
            length_10nm: after_10nm.max(1),
            // The differences are within the block's own numbers.
            steps: [x.wrapping_sub(dx), y.wrapping_sub(dy), z.wrapping_sub(dz)],
            extruder_256ths: rest.extruder_256ths.wrapping_sub(end.extruder_256ths),
            ..rest
        });
        Some(stretch)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::block::{Acceleration, Speed};
    use crate::inner_ends::tests::end;

    #[test]
    fn stretches_add_up_to_the_block() {
        let mut block = Block {
            steps: [10, -7, 3],
            extruder_256ths: 900,
            length_10nm: 30_000,
            nominal: Speed(1_000_000),
            acceleration: Acceleration::from_mm_per_s2(1000.0),
            line: 12,
            ends_move: true,
            inner_ends: InnerEnds::NONE,
        };
        assert!(Stretches::of(&block).eq([Stretch::whole(&block)]));
        block.inner_ends = InnerEnds::NONE.with(end(9_000, 10), 11).unwrap().with(end(10_000, 11), 12).unwrap();
        let stretches: Vec<_> = Stretches::of(&block).collect();
        let lengths: Vec<_> = stretches.iter().map(|s| (s.before_10nm, s.length_10nm, s.after_10nm)).collect();
        assert_eq!(lengths, [(0, 9_000, 21_000), (9_000, 1_000, 20_000), (10_000, 20_000, 0)]);
        let sums = stretches.iter().fold([0; 4], |sums, s| {
            let [x, y, z] = s.steps;
            [sums[0] + x, sums[1] + y, sums[2] + z, sums[3] + s.extruder_256ths]
        });
        assert_eq!(sums, [10, -7, 3, 900]);
        assert_eq!(
            stretches.iter().map(|s| (s.line, s.ends_move)).collect::<Vec<_>>(),
            [(10, true), (11, false), (12, true)]
        );
    }
}
