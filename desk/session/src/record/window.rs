//! The part of a print that a waveform shows, by time or by the lines of the file.

use std::collections::VecDeque;

use ferrostep_planner::Move;

/// Beginning or end of a part of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// A time of the motion clock, s.
    Seconds(f64),
    /// The motion of a line, from 1.
    Line(u32),
}

/// A part of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// The beginning: this time, or where the first motion of this line or of a later one begins.
    pub from: Bound,
    /// The end: this time, or where the motion of this line ends; the end of all motion if absent.
    pub to: Option<Bound>,
}

impl Window {
    /// The whole motion.
    pub const ALL: Self = Self { from: Bound::Seconds(0.0), to: None };

    /// Returns true if it ends before it begins, when both bounds are of the same kind.
    pub fn is_reversed(&self) -> bool {
        match (self.from, self.to) {
            (Bound::Seconds(from_s), Some(Bound::Seconds(to_s))) => to_s <= from_s,
            (Bound::Line(from), Some(Bound::Line(to))) => to < from,
            _ => false,
        }
    }
}

/// Finds the times of a window while the motion is made.
#[derive(Debug)]
pub(super) struct Cut {
    window: Window,
    begin_ns: Option<u64>,
    end_ns: Option<u64>,
    lines: Lines,
    /// End of the last move, ns.
    ended_ns: u64,
}

/// A time as whole ns; saturates for numbers that no print reaches.
fn ns(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

impl Cut {
    pub fn new(window: Window) -> Self {
        let time = |bound: Bound| match bound {
            Bound::Seconds(seconds) => Some(ns(seconds)),
            // Motion before the first line's is homing at most, which has no line.
            Bound::Line(0 | 1) => Some(0),
            Bound::Line(_) => None,
        };
        let end_ns = window.to.filter(|to| matches!(to, Bound::Seconds(_))).and_then(time);
        Self { begin_ns: time(window.from), end_ns, window, lines: Lines::default(), ended_ns: 0 }
    }

    /// A move follows those planned before.
    pub fn planned(&mut self, taken: &Move) {
        self.lines.planned(taken.line, taken.ends_move);
    }

    /// A line's move has ended.
    pub fn move_ended(&mut self, now_ns: u64) {
        self.lines.ended();
        self.ended_ns = now_ns;
    }

    /// Homing has ended: earlier plans are over.
    pub fn redefined(&mut self, now_ns: u64) {
        self.lines = Lines::default();
        self.ended_ns = now_ns;
    }

    /// A step is made. `pulse_end_ns`: when the pulse before it ends.
    pub fn stepped(&mut self, pulse_end_ns: Option<u64>) {
        let Some(line) = self.lines.present() else { return };
        // The last pulse belongs to the motion before.
        let start_ns = self.ended_ns.max(pulse_end_ns.unwrap_or(0)) + 1;
        if let (None, Bound::Line(from)) = (self.begin_ns, self.window.from)
            && line >= from
        {
            self.begin_ns = Some(start_ns);
        }
        if let (None, Some(Bound::Line(to))) = (self.end_ns, self.window.to)
            && line > to
        {
            self.end_ns = Some(start_ns);
        }
    }

    /// Returns true if a change at this time is in the part.
    pub fn contains(&self, now_ns: u64) -> bool {
        self.begin_ns.is_some_and(|begin_ns| now_ns >= begin_ns) && self.end_ns.is_none_or(|end_ns| now_ns < end_ns)
    }

    /// Returns its beginning, ns; `None` before any motion of its lines.
    pub fn begin_ns(&self) -> Option<u64> {
        self.begin_ns
    }
}

/// The lines whose motion is planned, the present one first.
#[derive(Debug, Default)]
struct Lines(VecDeque<PlannedLine>);

/// A line with motion.
#[derive(Debug)]
struct PlannedLine {
    line: u32,
    /// Moves whose end is planned, less those that have ended.
    open: i32,
}

impl Lines {
    fn planned(&mut self, line: u32, ends: bool) {
        if self.0.back().is_none_or(|last| last.line != line) {
            self.0.push_back(PlannedLine { line, open: 0 });
        }
        if let Some(last) = self.0.back_mut() {
            last.open += i32::from(ends);
        }
        self.forget();
    }

    fn ended(&mut self) {
        if let Some(first) = self.0.front_mut() {
            first.open -= 1;
        }
        self.forget();
    }

    /// A line is over as soon as all its moves are and another has followed: until then
    /// it may have more.
    fn forget(&mut self) {
        while self.0.len() > 1 && self.0.front().is_some_and(|first| first.open <= 0) {
            self.0.pop_front();
        }
    }

    /// The line whose motion is made.
    fn present(&self) -> Option<u32> {
        self.0.front().map(|first| first.line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_present_line_is_the_first_that_has_not_ended() {
        let mut lines = Lines::default();
        // An arc in two pieces, then a line with two moves.
        lines.planned(3, false);
        assert_eq!(lines.present(), Some(3));
        lines.planned(3, true);
        lines.planned(7, true);
        lines.planned(7, true);
        lines.planned(9, true);
        assert_eq!(lines.present(), Some(3));
        for expected in [7, 7, 9, 9] {
            lines.ended();
            assert_eq!(lines.present(), Some(expected));
        }
        lines.planned(12, true);
        assert_eq!(lines.present(), Some(12));
    }

    #[test]
    fn a_window_that_ends_before_it_begins_is_reversed() {
        let window = |from, to| Window { from, to: Some(to) };
        assert!(window(Bound::Line(4), Bound::Line(3)).is_reversed());
        assert!(!window(Bound::Line(4), Bound::Line(4)).is_reversed());
        assert!(window(Bound::Seconds(2.0), Bound::Seconds(2.0)).is_reversed());
        assert!(!window(Bound::Seconds(2.0), Bound::Line(1)).is_reversed());
        assert!(!Window::ALL.is_reversed());
    }
}
