//! The entries of the queue between planner and step timer.

/// Bit of the extruder in an axis mask; X (A), Y (B) and Z are bits 0 to 2.
pub const EXTRUDER: u8 = 1 << 3;

/// One entry of the step queue, 8 bytes.
///
/// A *stair* (Wu 2024) is `count` events at one interval; each steps `axes`. In the last one it is
/// the other way round with `added`: what does not step in the others steps there, and what does
/// (on a steep line) does not. All intervals count from the event before. Times are ticks of the
/// motion clock, which advances only while blocks run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepEntry {
    interval_ticks: u32,
    /// Packed fields: from bit 0 on the count, from bit 16 on the axes, from bit 24 on
    /// `added` of a stair or the direction bits of a direction change. One word, so that an
    /// entry is stored at once.
    rest: u32,
}

/// Action of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepKind {
    /// Events that step motors.
    Stair {
        /// Ticks from the previous event to the first, and between events.
        interval_ticks: u32,
        /// Number of events, at least 1.
        count: u16,
        /// Motors that step in each event.
        axes: u8,
        /// Motors that step in the last only; those of them that are among `axes`, in
        /// all but the last.
        added: u8,
    },
    /// Time passes without a step: an interval longer than 32 bits.
    Wait {
        /// Duration, ticks.
        interval_ticks: u32,
    },
    /// The direction signals change, right after the event before.
    Directions {
        /// Bit i = motor i runs backwards.
        directions: u8,
    },
}

impl StepEntry {
    /// A stair; `None` without events or without motors, in the last event too.
    #[inline]
    pub const fn stair(interval_ticks: u32, count: u16, axes: u8, added: u8) -> Option<Self> {
        if count == 0 || axes == 0 || axes == added {
            return None;
        }
        Some(Self::of(interval_ticks, count, axes, added))
    }

    /// A stair, of at least one event and one motor.
    #[inline(always)]
    pub(crate) const fn of(interval_ticks: u32, count: u16, axes: u8, other: u8) -> Self {
        Self { interval_ticks, rest: count as u32 | (axes as u32) << 16 | (other as u32) << 24 }
    }

    /// An event that steps `axes`, at least one motor.
    #[inline(always)]
    pub(crate) const fn event(interval_ticks: u32, axes: u8) -> Self {
        Self::of(interval_ticks, 1, axes, 0)
    }

    /// Time without a step.
    pub const fn wait(interval_ticks: u32) -> Self {
        Self::of(interval_ticks, 0, 0, 0)
    }

    /// A change of the direction signals.
    pub const fn directions(directions: u8) -> Self {
        Self::of(0, 0, u8::MAX, directions)
    }

    /// Ticks from the previous event to the first, and between events; 0 for a direction change.
    #[inline(always)]
    pub const fn interval_ticks(self) -> u32 {
        self.interval_ticks
    }

    /// Number of events; 0 for entries other than stairs.
    #[inline(always)]
    pub const fn count(self) -> u16 {
        self.rest as u16
    }

    /// True if it is one event, of no motors but the first four.
    #[inline(always)]
    pub const fn is_single(self) -> bool {
        self.rest & 0xfff0_ffff == 1
    }

    /// True if it is a stair of at most 2^13 events.
    #[inline(always)]
    pub const fn is_short_stair(self) -> bool {
        // A count of 0 wraps to ones.
        self.rest.wrapping_sub(1) & 0xe000 == 0
    }

    /// All of a stair but its interval: from bit 0 on the count, from bit 16 on [`Self::axes`],
    /// from bit 24 on [`Self::added`].
    #[inline(always)]
    pub const fn stair_word(self) -> u32 {
        self.rest
    }

    /// Motors that step in each event of a stair.
    #[inline(always)]
    pub const fn axes(self) -> u8 {
        (self.rest >> 16) as u8
    }

    /// Motors that step in a stair's last event only, or in all but the last.
    #[inline(always)]
    pub const fn added(self) -> u8 {
        (self.rest >> 24) as u8
    }

    /// The entry as two words, for a queue that shares words between tasks.
    #[inline(always)]
    pub const fn to_words(self) -> [u32; 2] {
        [self.interval_ticks, self.rest]
    }

    /// The entry of [`Self::to_words`].
    #[inline(always)]
    pub const fn from_words([interval_ticks, rest]: [u32; 2]) -> Self {
        Self { interval_ticks, rest }
    }

    /// The entry as single events, for a player that looks at something after each (homing).
    pub fn events(self) -> impl Iterator<Item = Self> {
        let single = self.count().max(1);
        (1..=single).map(move |index| match self.count() {
            0 => self,
            _ if index == single => Self::event(self.interval_ticks, self.axes() ^ self.added()),
            _ => Self::event(self.interval_ticks, self.axes()),
        })
    }

    /// An entry with the first `count` events of this one (all of them if it has no more); `None`
    /// for none of a stair's.
    pub const fn first_events(self, count: u16) -> Option<Self> {
        if self.count() == 0 || count >= self.count() {
            return Some(self);
        }
        // The last event, which alone is different, is left out.
        Self::stair(self.interval_ticks, count, self.axes(), 0)
    }

    /// The entry with another interval.
    #[inline(always)]
    pub(crate) const fn at(self, interval_ticks: u32) -> Self {
        Self { interval_ticks, ..self }
    }

    /// The event with more motors stepping.
    #[inline(always)]
    pub(crate) const fn with(self, axes: u8) -> Self {
        Self { rest: self.rest | (axes as u32) << 16, ..self }
    }

    /// A single event, repeated `count` times, 1 to 2^16 - 1.
    #[inline(always)]
    pub const fn times(self, count: u32) -> Self {
        Self { rest: self.rest.wrapping_add(count).wrapping_sub(1), ..self }
    }

    /// The stair with more motors stepping in its last event, none of which steps anywhere in it.
    #[inline(always)]
    pub(crate) const fn with_added(self, axes: u8) -> Self {
        Self { rest: self.rest | (axes as u32) << 24, ..self }
    }

    /// The stair with other motors also stepping in its last event; `None` if one of them steps
    /// anywhere in it, or the entry is not a stair.
    pub(crate) const fn joined(self, axes: u8) -> Option<Self> {
        let shift = if self.count() == 1 { 16 } else { 24 };
        if self.count() == 0 || (self.axes() | self.added()) & axes != 0 {
            None
        } else {
            Some(Self { rest: self.rest | (axes as u32) << shift, ..self })
        }
    }

    /// Action of the entry.
    #[inline]
    pub const fn kind(self) -> StepKind {
        let interval_ticks = self.interval_ticks;
        match (self.count(), self.axes()) {
            (0, u8::MAX) => StepKind::Directions { directions: self.added() },
            (0, _) => StepKind::Wait { interval_ticks },
            (count, axes) => StepKind::Stair { interval_ticks, count, axes, added: self.added() },
        }
    }
}

/// Event between steps, at a tick of the motion clock: after the steps up to that tick and
/// before the later ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Notice {
    /// A move has ended.
    MoveEnded {
        /// Time of the end.
        tick: u64,
        /// Source line of the move.
        line: u32,
    },
    /// A block has ended: all steps of it and of the blocks before it have been handed out.
    BlockEnded {
        /// Time of the end.
        tick: u64,
        /// Positions that X, Y, Z (CoreXY: A, B, Z) and the extruder must have by their blocks' own
        /// counts, for comparison with the steps handed out.
        motor_steps: [i64; 4],
    },
    /// A fan changes with the motion around it.
    FanPower {
        /// Time of the change.
        tick: u64,
        /// Number of the fan, as asked for.
        fan: u8,
        /// Power, 0 to 255.
        power: u8,
    },
}

impl Notice {
    /// Time of the notice.
    pub const fn tick(self) -> u64 {
        match self {
            Self::MoveEnded { tick, .. } | Self::BlockEnded { tick, .. } | Self::FanPower { tick, .. } => tick,
        }
    }
}

/// Receiver of the planner's output: the step queue, a file, a counter.
pub trait StepSink {
    /// Takes an entry.
    fn entry(&mut self, entry: StepEntry);
    /// Takes entries, in their order.
    #[inline]
    fn entries(&mut self, entries: &[StepEntry]) {
        for entry in entries {
            self.entry(*entry);
        }
    }
    /// Takes a notice.
    fn notice(&mut self, notice: Notice);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entry_takes_eight_bytes_and_says_what_it_was_made_of() {
        assert_eq!(core::mem::size_of::<StepEntry>(), 8);
        assert_eq!(StepEntry::wait(7).kind(), StepKind::Wait { interval_ticks: 7 });
        assert_eq!(StepEntry::directions(5).kind(), StepKind::Directions { directions: 5 });
        assert_eq!(
            StepEntry::stair(9, 3, 1, 2).map(StepEntry::kind),
            Some(StepKind::Stair { interval_ticks: 9, count: 3, axes: 1, added: 2 })
        );
    }

    #[test]
    fn words_hold_the_whole_entry() {
        let entry = StepEntry::of(0x8765_4321, 0xfedc, 0xba, 0x98);
        assert_eq!(entry.to_words(), [0x8765_4321, 0x98ba_fedc]);
        assert_eq!(StepEntry::from_words(entry.to_words()), entry);
    }

    #[test]
    fn the_first_events_of_an_entry() {
        let entry = StepEntry::of(9, 3, 1, 2);
        assert_eq!(entry.first_events(0), None);
        assert_eq!(entry.first_events(2), StepEntry::stair(9, 2, 1, 0));
        for count in [3, 4] {
            assert_eq!(entry.first_events(count), Some(entry));
        }
        assert_eq!(StepEntry::wait(7).first_events(0), Some(StepEntry::wait(7)));
    }

    #[test]
    fn the_last_event_differs_by_what_is_added() {
        let axes = |axes, added| StepEntry::of(9, 3, axes, added).events().map(StepEntry::axes).collect::<Vec<_>>();
        assert_eq!(axes(1, 2), [1, 1, 3]);
        assert_eq!(axes(3, 2), [3, 3, 1]);
        assert_eq!(axes(3, 6), [3, 3, 5]);
        assert_eq!(StepEntry::of(9, 1, 3, 2).events().map(StepEntry::axes).collect::<Vec<_>>(), [1]);
    }

    #[test]
    fn a_stair_without_steps_is_refused() {
        assert_eq!(StepEntry::stair(9, 0, 1, 0), None);
        assert_eq!(StepEntry::stair(9, 1, 0, 1), None);
        assert_eq!(StepEntry::stair(9, 5, 1, 1), None);
    }
}
