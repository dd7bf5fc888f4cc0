//! The times at which a host's lines arrive.

use super::time::CYCLES_PER_S;

/// A host that waits for each `ok` and is not faster than its line.
#[derive(Clone, Debug)]
pub struct HostLine {
    lines_per_s: u64,
    burst: u64,
    /// Silences: the line before which each comes, counted from 0, and its length, cycles.
    silences: Vec<(u64, u64)>,
    taken: u64,
    /// Cycle at which the present burst began.
    began: u64,
}

impl HostLine {
    /// A host with this many lines a second, at even intervals.
    pub fn steady(lines_per_s: u64) -> Self {
        Self::bursts(lines_per_s, 1)
    }

    /// A host with this many lines a second, sent in bursts of this many.
    pub fn bursts(lines_per_s: u64, burst: u64) -> Self {
        Self { lines_per_s: lines_per_s.max(1), burst: burst.max(1), silences: Vec::new(), taken: 0, began: 0 }
    }

    /// Adds a silence of the host before this line, counted from 0, in milliseconds.
    pub fn with_silence(mut self, before_line: u64, milliseconds: u64) -> Self {
        self.silences.push((before_line, milliseconds * (CYCLES_PER_S / 1_000)));
        self
    }

    /// Cycle at which the next line has arrived, given the cycle of the last `ok`.
    pub fn next_at(&mut self, ok_at: u64) -> u64 {
        let mut at = ok_at;
        if self.taken.is_multiple_of(self.burst) {
            if self.taken > 0 {
                at = at.max(self.began + self.burst * CYCLES_PER_S / self.lines_per_s);
            }
            self.began = at;
        }
        let silence: u64 =
            self.silences.iter().filter(|(before, _)| *before == self.taken).map(|(_, cycles)| cycles).sum();
        self.began += silence;
        self.taken += 1;
        at + silence
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_at_their_times_and_after_the_ok() {
        let second = CYCLES_PER_S;
        let mut line = HostLine::bursts(10, 2).with_silence(5, 1_000);
        assert_eq!(line.next_at(100), 100);
        assert_eq!(line.next_at(200), 200);
        assert_eq!(line.next_at(300), 100 + second / 5);
        assert_eq!(line.next_at(100 + second / 5), 100 + second / 5);
        // A late `ok`.
        assert_eq!(line.next_at(5 * second), 5 * second);
        assert_eq!(line.next_at(5 * second), 6 * second);
        assert_eq!(line.next_at(6 * second), 6 * second + second / 5);
    }
}
