//! Where moves end inside a block that was made of several.

/// Most moves that end inside one block, the last of the block not counted.
pub const MAX_INNER_ENDS: usize = 7;

/// A move that ends inside a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InnerEnd {
    /// Path position from the block's start, units of 10 nm.
    pub length_10nm: u32,
    /// Its source line.
    pub line: u32,
}

/// Ends of moves inside a block, in the order of the path.
///
/// Kept small, for every place of the look-ahead ring has one: only short moves are worth merging, so a path
/// position has 16 bits (0.65 mm), and a line is told by its distance from the block's.
#[derive(Clone, Copy, Debug, Default)]
pub struct InnerEnds {
    lengths_10nm: [u16; MAX_INNER_ENDS],
    /// By how many lines each is before the block's last.
    lines_before: [u8; MAX_INNER_ENDS],
    count: u8,
}

// What is behind the last is of no account.
impl PartialEq for InnerEnds {
    fn eq(&self, other: &Self) -> bool {
        self.count == other.count && self.iter(0).eq(other.iter(0))
    }
}

impl Eq for InnerEnds {}

impl InnerEnds {
    /// None.
    pub const NONE: Self = Self { lengths_10nm: [0; MAX_INNER_ENDS], lines_before: [0; MAX_INNER_ENDS], count: 0 };

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
        ends.count += 1;
        Some(ends)
    }

    /// The ends, in a block whose last move is of `block_line`.
    pub fn iter(&self, block_line: u32) -> impl Iterator<Item = InnerEnd> + '_ {
        let places = self.lengths_10nm.iter().zip(&self.lines_before).take(usize::from(self.count));
        places.map(move |(length, before)| InnerEnd {
            length_10nm: u32::from(*length),
            line: block_line.wrapping_sub(u32::from(*before)),
        })
    }

    /// Forgets all.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn ends_keep_their_places_and_lines() {
        let mut ends = InnerEnds::NONE;
        let mut line = 10;
        for index in 0..MAX_INNER_ENDS as u32 {
            let next = line + 1 + index % 3;
            ends = ends.with(InnerEnd { length_10nm: 5_000 * (index + 1), line }, next).unwrap();
            line = next;
        }
        let lines: Vec<_> = ends.iter(line).map(|end| (end.length_10nm, end.line)).collect();
        assert_eq!(
            lines,
            [(5_000, 10), (10_000, 11), (15_000, 13), (20_000, 16), (25_000, 17), (30_000, 19), (35_000, 22)]
        );
        assert_eq!(ends.with(InnerEnd { length_10nm: 40_000, line }, line + 1), None);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let one = InnerEnds::NONE.with(InnerEnd { length_10nm: 1, line: 5 }, 6).unwrap();
        assert_eq!(one.with(InnerEnd { length_10nm: 65_536, line: 6 }, 7), None);
        assert_eq!(one.with(InnerEnd { length_10nm: 9, line: 6 }, 262), None);
        assert_eq!(one.with(InnerEnd { length_10nm: 9, line: 7 }, 6), None);
        assert!(!one.is_empty() && InnerEnds::NONE.is_empty());
    }
}
