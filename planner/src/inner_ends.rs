//! Short moves that share one block: the place where each of them ends, and the steps that lead
//! there.

/// Maximum number of moves that end inside one block, not counting the block's last.
pub const MAX_INNER_ENDS: usize = 7;

/// Longest block of several moves, units of 10 nm: the range of an inner end's place.
pub(crate) const MAX_LENGTH_10NM: u32 = u16::MAX as u32;

/// Maximum filament of a move in a shared block, 1/256 steps: an eighth of the range of an inner
/// end, so that a prepared job can be printed with eight times its flow (M221).
pub(crate) const MAX_EXTRUDER_256THS: u32 = i16::MAX as u32 / 8;

/// The end of a move inside a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InnerEnd {
    /// Path position from the block's start, units of 10 nm.
    pub length_10nm: u32,
    /// Signed steps of X, Y and Z (CoreXY: A, B, Z) since the previous end.
    pub steps: [i32; 3],
    /// Signed travel of the extruder since the previous end, 1/256 steps.
    pub extruder_256ths: i32,
    /// Source line of the move.
    pub line: u32,
    /// True if the line's move ends here; otherwise it is a corner of an arc.
    pub ends_move: bool,
}

/// The ends inside a block, in path order.
///
/// The type is small because every place of the look-ahead ring holds one. Only short moves are
/// worth sharing a block, so a path position has 16 bits (0.65 mm), a move has at most 127 steps of
/// a motor and 127 of the extruder, and a line is given by its distance from the block's.
#[derive(Clone, Copy, Debug, Default)]
pub struct InnerEnds {
    lengths_10nm: [u16; MAX_INNER_ENDS],
    extruder_256ths: [i16; MAX_INNER_ENDS],
    steps: [[i8; 3]; MAX_INNER_ENDS],
    /// Lines from each end to the block's last.
    lines_before: [u8; MAX_INNER_ENDS],
    /// Bit i: a line's move ends at end i.
    end_moves: u8,
    count: u8,
}

// Places after the last end are meaningless.
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

    /// Returns these ends and one more, in a block that now ends at `block_line` instead of at the
    /// added end's line; `None` if it does not fit.
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

    /// The end with this index.
    pub(crate) fn get(&self, index: usize, block_line: u32) -> Option<InnerEnd> {
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

    /// Discards all ends.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// True if no move ends inside.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// An end in a block: of a part of a move in line 11, of a move in any other.
    pub(crate) fn end(length_10nm: u32, line: u32) -> InnerEnd {
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
}
