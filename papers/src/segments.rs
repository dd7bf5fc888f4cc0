//! Li's ring of planned segments.

use crate::plan::Plan;
use crate::table::FrequencyTable;

/// An input line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Number of pulses.
    pub pulses: f64,
    /// Requested frequency, Hz.
    pub run_hz: f64,
}

/// A segment with known frequencies at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// The line.
    pub line: Line,
    /// Frequency at its start, Hz.
    pub start_hz: f64,
    /// Frequency at its end, Hz.
    pub stop_hz: f64,
    /// Division of the segment's pulses.
    pub plan: Plan,
}

/// Number of lines read ahead.
const LINES: usize = 4;

/// The paper's look-ahead (Li 2017, sect. 2 and fig. 4): four lines are read ahead, which make
/// three segments, since a segment ends at the frequency of the line after it; they wait in a
/// circular queue.
///
/// The frequency between two lines is the lower of both, or as much as the pulses of the slower
/// line's neighbour allow: motion ends at f0 after the last known line, and no segment is planned
/// from which that could not be reached. This is the paper's own look-ahead, complete and separate;
/// the machine's has 128 blocks and corners ([`ferrostep_planner::look_ahead`]).
#[derive(Clone, Copy, Debug)]
pub struct Segments {
    table: FrequencyTable,
    lines: [Line; LINES],
    first: usize,
    count: usize,
    /// Frequency at the end of the last segment, Hz.
    before_hz: f64,
    is_over: bool,
}

impl Segments {
    /// Creates an empty queue; motion starts at f0.
    pub fn new(table: &FrequencyTable) -> Self {
        let none = Line { pulses: 0.0, run_hz: 0.0 };
        Self { table: *table, lines: [none; LINES], first: 0, count: 0, before_hz: table.start_hz(), is_over: false }
    }

    /// Reads a line; `false` if there is no room, or if the line is impossible: pulses and
    /// frequency must be finite and above zero.
    pub fn read(&mut self, line: Line) -> bool {
        let is_possible = |x: f64| x > 0.0 && x.is_finite();
        if self.count == LINES || !is_possible(line.pulses) || !is_possible(line.run_hz) {
            return false;
        }
        let place = (self.first + self.count) % LINES;
        if let Some(free) = self.lines.get_mut(place) {
            *free = line;
        }
        self.count += 1;
        self.is_over = false;
        true
    }

    /// Marks the lines that were read as the last ones.
    pub fn finish(&mut self) {
        self.is_over = true;
    }

    /// Number of waiting lines.
    pub fn waiting(&self) -> usize {
        self.count
    }

    fn line(&self, index: usize) -> Option<Line> {
        if index < self.count { self.lines.get((self.first + index) % LINES).copied() } else { None }
    }

    /// Takes the oldest segment once four lines are read, or no more will follow.
    pub fn take(&mut self) -> Option<Segment> {
        if self.count < LINES && !self.is_over {
            return None;
        }
        let line = self.line(0)?;
        let run = |line: &Line| if line.run_hz < self.table.top_hz() { line.run_hz } else { self.table.top_hz() };
        // Backwards from f0 after the last line: F^-1(F(v) + P), as for acceleration.
        let mut stop_hz = self.table.start_hz();
        for index in (1..self.count).rev() {
            let (Some(here), Some(before)) = (self.line(index), self.line(index - 1)) else { break };
            let reached = self.table.frequency_after(self.table.pulses_to(stop_hz) + here.pulses);
            stop_hz = [run(&here), run(&before), reached].into_iter().fold(f64::INFINITY, f64::min);
        }
        let ahead = self.table.frequency_after(self.table.pulses_to(self.before_hz) + line.pulses);
        let stop_hz = if stop_hz < ahead { stop_hz } else { ahead };
        let plan = Plan::new(&self.table, line.pulses, self.before_hz, stop_hz, line.run_hz);
        let segment = Segment { line, start_hz: self.before_hz, stop_hz, plan };
        self.before_hz = stop_hz;
        self.first = (self.first + 1) % LINES;
        self.count -= 1;
        Some(segment)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::plan::PlanCase;
    use proptest::prelude::*;

    fn table() -> FrequencyTable {
        FrequencyTable::new(1_000.0, 10_000.0, 100_000.0).unwrap()
    }

    fn all(lines: &[Line]) -> Vec<Segment> {
        let mut segments = Segments::new(&table());
        let mut planned = Vec::new();
        for line in lines {
            while !segments.read(*line) {
                planned.push(segments.take().unwrap());
            }
        }
        segments.finish();
        while let Some(segment) = segments.take() {
            planned.push(segment);
        }
        assert_eq!(segments.waiting(), 0);
        planned
    }

    #[test]
    fn four_lines_make_three_segments() {
        let mut segments = Segments::new(&table());
        for pulses in [4_000.0, 3_000.0, 3_000.0] {
            assert!(segments.read(Line { pulses, run_hz: 8_000.0 }));
            assert_eq!(segments.take(), None);
        }
        assert!(segments.read(Line { pulses: 5_000.0, run_hz: 2_000.0 }));
        assert!(!segments.read(Line { pulses: 5_000.0, run_hz: 2_000.0 }));
        let first = segments.take().unwrap();
        assert_eq!((first.start_hz, first.stop_hz, first.plan.case), (1_000.0, 8_000.0, PlanCase::SpeedsUp));
        segments.finish();
        let second = segments.take().unwrap();
        assert_eq!((second.stop_hz, second.plan.case), (8_000.0, PlanCase::AtRun));
        let third = segments.take().unwrap();
        assert_eq!((third.stop_hz, third.plan.case), (2_000.0, PlanCase::SlowsDown));
        assert_eq!(segments.take().unwrap().plan.case, PlanCase::SlowsDown);
        assert_eq!(segments.take(), None);
    }

    #[test]
    fn impossible_lines_are_refused() {
        let mut segments = Segments::new(&table());
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(
                !segments.read(Line { pulses: bad, run_hz: 1.0 }) && !segments.read(Line { pulses: 1.0, run_hz: bad })
            );
        }
        assert_eq!(segments.waiting(), 0);
    }

    proptest! {
        #[test]
        fn segments_join_and_can_always_stop(
            lines in proptest::collection::vec((1.0f64..6_000.0, 1_000.0f64..12_000.0), 1..40),
        ) {
            let lines: Vec<_> = lines.into_iter().map(|(pulses, run_hz)| Line { pulses, run_hz }).collect();
            let planned = all(&lines);
            prop_assert_eq!(planned.len(), lines.len());
            let mut frequency = 1_000.0;
            for (segment, line) in planned.iter().zip(&lines) {
                prop_assert_eq!(segment.line, *line);
                prop_assert_eq!(segment.start_hz, frequency);
                // Slightly short if both ends took all available pulses.
                let reach = (table().pulses_to(segment.stop_hz) - table().pulses_to(segment.start_hz)).abs();
                prop_assert!(reach <= line.pulses + 1e-3);
                prop_assert!(segment.stop_hz <= line.run_hz * (1.0 + 1e-9));
                frequency = segment.stop_hz;
            }
            prop_assert_eq!(frequency, 1_000.0);
        }
    }
}
