//! Short moves that share one block: where each of them ends, and the steps that lead there.

use crate::block::Block;

/// The most moves that end inside one block, the last of the block not counted.
pub const MAX_INNER_ENDS: usize = 7;

/// The end of a move inside a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InnerEnd {
    /// Path position from the block's start, units of 10 nm.
    pub length_10nm: u32,
    /// Signed steps of X, Y and Z (CoreXY: A, B, Z) since the end before it.
    pub steps: [i32; 3],
    /// Signed travel of the extruder since the end before it, 1/256 steps.
    pub extruder_256ths: i32,
    /// Its source line.
    pub line: u32,
    /// Whether the line's move ends here; otherwise it is a corner of an arc.
    pub ends_move: bool,
}

/// The ends inside a block, in the order of the path.
///
/// Small, for every place of the look-ahead ring has one. Only short moves are worth sharing a block, so a path
/// position has 16 bits (0.65 mm), a move has at most 127 steps of a motor and 127 of the extruder, and a line is given
/// by its distance from the block's.
#[derive(Clone, Copy, Debug, Default)]
pub struct InnerEnds {
    lengths_10nm: [u16; MAX_INNER_ENDS],
    extruder_256ths: [i16; MAX_INNER_ENDS],
    steps: [[i8; 3]; MAX_INNER_ENDS],
    /// By how many lines each is before the block's last.
    lines_before: [u8; MAX_INNER_ENDS],
    /// Bit i: a line's move ends at end i.
    end_moves: u8,
    count: u8,
}

// What is after the last has no meaning.
impl PartialEq for InnerEnds {
    fn eq(&self, other: &Self) -> bool {
        self.count == other.count && self.iter(0).eq(other.iter(0))
    }
}

impl Eq for InnerEnds {}

impl InnerEnds {
    /// No ends.
    pub const NONE: Self = Self {
        lengths_10nm: [0; MAX_INNER_ENDS],
        extruder_256ths: [0; MAX_INNER_ENDS],
        steps: [[0; 3]; MAX_INNER_ENDS],
        lines_before: [0; MAX_INNER_ENDS],
        end_moves: 0,
        count: 0,
    };

    /// These ends and one more, in a block that now ends at `block_line` instead of at the added end's line; `None`
    /// where it does not fit.
    pub fn with(&self, added: InnerEnd, block_line: u32) -> Option<Self> {
        let mut ends = *self;
        let step = u8::try_from(block_line.checked_sub(added.line)?).ok()?;
        let count = usize::from(ends.count);
        for before in ends.lines_before.iter_mut().take(count) {
            *before = before.checked_add(step)?;
        }
        *ends.lines_before.get_mut(count)? = step;
        *ends.lengths_10nm.get_mut(count)? = u16::try_from(added.length_10nm).ok()?;
        *ends.extruder_256ths.get_mut(count)? = i16::try_from(added.extruder_256ths).ok()?;
        let [x, y, z] = added.steps.map(i8::try_from);
        *ends.steps.get_mut(count)? = [x.ok()?, y.ok()?, z.ok()?];
        ends.end_moves = ends.end_moves & !(1 << count) | u8::from(added.ends_move) << count;
        ends.count += 1;
        Some(ends)
    }

    /// The ends, in a block whose last move is of `block_line`.
    pub fn iter(&self, block_line: u32) -> impl Iterator<Item = InnerEnd> + '_ {
        (0..usize::from(self.count)).map_while(move |index| self.get(index, block_line))
    }

    /// The end of this index.
    fn get(&self, index: usize, block_line: u32) -> Option<InnerEnd> {
        if index >= usize::from(self.count) {
            return None;
        }
        Some(InnerEnd {
            length_10nm: u32::from(*self.lengths_10nm.get(index)?),
            steps: self.steps.get(index)?.map(i32::from),
            extruder_256ths: i32::from(*self.extruder_256ths.get(index)?),
            line: block_line.wrapping_sub(u32::from(*self.lines_before.get(index)?)),
            ends_move: self.end_moves >> index & 1 == 1,
        })
    }

    /// Forgets all ends.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Whether no move ends inside.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

/// A stretch of a block in which one move is executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Path from the block's start to its own, units of 10 nm.
    pub before_10nm: u32,
    /// Its path length, units of 10 nm, at least 1.
    pub length_10nm: u32,
    /// Path from its end to the block's, units of 10 nm.
    pub after_10nm: u32,
    /// Signed steps of X, Y and Z (CoreXY: A, B, Z).
    pub steps: [i32; 3],
    /// Signed travel of the extruder, 1/256 steps.
    pub extruder_256ths: i32,
    /// Its source line.
    pub line: u32,
    /// Whether the line's move ends with it.
    pub ends_move: bool,
}

impl Stretch {
    /// All of a block in which no move ends before the last.
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
    /// What is left of the block.
    rest: Option<Stretch>,
}

impl Stretches {
    /// Those of a block.
    pub fn of(block: &Block) -> Self {
        Self {
            ends: block.inner_ends,
            index: 0,
            block_line: block.line,
            block_length_10nm: block.length_10nm.max(1),
            rest: Some(Stretch::whole(block)),
        }
    }

    /// Whether the last has been handed out.
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
        // Ends in another order than the path's make stretches without length; those have their steps all the same.
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
            // Within the block's own.
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

    fn end(length_10nm: u32, line: u32) -> InnerEnd {
        InnerEnd { length_10nm, steps: [1, -2, 3], extruder_256ths: -40, line, ends_move: line != 11 }
    }

    #[test]
    fn ends_keep_their_places_and_lines() {
        let mut ends = InnerEnds::NONE;
        let mut line = 10;
        for index in 0..MAX_INNER_ENDS as u32 {
            let next = line + 1 + index % 3;
            ends = ends.with(end(5_000 * (index + 1), line), next).unwrap();
            line = next;
        }
        let lines: Vec<_> = ends.iter(line).map(|end| (end.length_10nm, end.line, end.ends_move)).collect();
        let expected =
            [(5_000, 10), (10_000, 11), (15_000, 13), (20_000, 16), (25_000, 17), (30_000, 19), (35_000, 22)];
        assert_eq!(lines, expected.map(|(length, line)| (length, line, line != 11)));
        assert!(ends.iter(line).all(|end| end.steps == [1, -2, 3] && end.extruder_256ths == -40));
        assert_eq!(ends.with(end(40_000, line), line + 1), None);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let one = InnerEnds::NONE.with(end(1, 5), 6).unwrap();
        assert_eq!(one.with(end(65_536, 6), 7), None);
        assert_eq!(one.with(end(9, 6), 262), None);
        assert_eq!(one.with(end(9, 7), 6), None);
        assert_eq!(one.with(InnerEnd { steps: [0, 128, 0], ..end(9, 6) }, 7), None);
        assert_eq!(one.with(InnerEnd { extruder_256ths: 32_768, ..end(9, 6) }, 7), None);
        assert!(!one.is_empty() && InnerEnds::NONE.is_empty());
    }

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
