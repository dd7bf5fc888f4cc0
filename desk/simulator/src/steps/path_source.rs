//! Provides the programmed path, from the G-code or from the steps themselves.

use crate::measures::Measures;
use crate::path::PathSegment;
use crate::plan::MoveShape;
use ferrostep_oracle::reference::{Job, Move, MoveKind, UNITS_PER_MM};
use std::collections::VecDeque;
use std::fmt;

/// Maximum number of steps kept before part of the path is drawn from them; drawing takes at worst
/// the square of their number.
const MAX_POINTS: usize = 20_000;

/// Maximum duration of the path that is drawn at once, s.
const MAX_PART_S: f64 = 10.0;

/// Tolerance of a path drawn from steps, mm: two steps of a coarse motor.
const STEPS_TOLERANCE_MM: f64 = 0.02;

/// Pause that ends a part of a path drawn from steps, s.
const PAUSE_S: f64 = 0.1;

/// Reason why the path does not match the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathError {
    /// A move in the trace is on another line than the G-code's next move.
    Line {
        /// Line in the trace.
        traced: u32,
        /// Line in the G-code; `None` if it has no further move.
        expected: Option<u32>,
    },
    /// The G-code has further moves.
    Unfinished {
        /// Line of the first further move.
        line: u32,
    },
}

impl fmt::Display for PathError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { traced, expected: Some(expected) } => write!(
                out,
                "the trace has a move of line {traced} where the G-code has one of line {expected}: is the trace of this file?"
            ),
            Self::Line { traced, expected: None } => {
                write!(
                    out,
                    "the trace has a move of line {traced} after the G-code's last one: is the trace of this file?"
                )
            }
            Self::Unfinished { line } => {
                write!(
                    out,
                    "the trace ends before the G-code's move of line {line}: is the trace of this file, and complete?"
                )
            }
        }
    }
}

impl std::error::Error for PathError {}

/// Passes the path to the measures as time advances.
#[derive(Debug)]
pub struct PathSource {
    from: From,
    filament_mm2: f64,
    /// End of the last known part of the path, s.
    end_s: f64,
    /// Lines of moves before which the printer adds its own.
    after_own: VecDeque<u32>,
}

#[derive(Debug)]
enum From {
    Job { moves: std::vec::IntoIter<(Move, f64)>, may_end_early: bool, joins: bool },
    Steps { points: Vec<Point> },
}

/// Position of the motors after a step.
#[derive(Clone, Copy, Debug)]
struct Point {
    time_s: f64,
    place_mm: [f64; 2],
    filament_mm: f64,
}

impl PathSource {
    /// Takes the path from the moves of a G-code file. `durations_s` are the times that a plan
    /// gives them, s; a line's time is divided among its moves in their proportion.
    pub fn of_job(job: &Job, durations_s: Vec<f64>, filament_mm2: f64) -> Self {
        let moves: Vec<(Move, f64)> = job.moves.iter().copied().zip(durations_s).collect();
        Self {
            from: From::Job { moves: moves.into_iter(), may_end_early: false, joins: false },
            ..Self::of_steps(filament_mm2)
        }
    }

    /// Gives G10 and G11 no time of their own: they run during travels.
    pub fn filament_on_the_way(mut self) -> Self {
        if let From::Job { moves, .. } = &mut self.from {
            for (one, duration_s) in moves.as_mut_slice() {
                if one.kind == MoveKind::FirmwareRetraction {
                    *duration_s = 0.0;
                }
            }
        }
        self
    }

    /// Takes the path from the motors' own steps: a trace without its G-code is measured against
    /// that.
    pub const fn of_steps(filament_mm2: f64) -> Self {
        Self { from: From::Steps { points: Vec::new() }, filament_mm2, end_s: 0.0, after_own: VecDeque::new() }
    }

    /// Allows the job to stop before its end.
    pub fn may_end_early(mut self) -> Self {
        if let From::Job { may_end_early, .. } = &mut self.from {
            *may_end_early = true;
        }
        self
    }

    /// Allows the plan to join a move that is too short to the next one, whose end is then that of
    /// both, and to drop such a move at the end.
    pub fn may_join_moves(mut self) -> Self {
        if let From::Job { may_end_early, joins, .. } = &mut self.from {
            (*may_end_early, *joins) = (true, true);
        }
        self
    }

    /// Notes that before the move of this line the printer adds its own, such as to a parking
    /// position or another tool.
    pub(super) fn own_moves_before(&mut self, line: u32) {
        if let From::Job { .. } = self.from {
            self.after_own.push_back(line);
        }
    }

    pub(super) fn stepped(&mut self, time_s: f64, place_mm: [f64; 2], filament_mm: f64, measures: &mut Measures) {
        let From::Steps { points } = &mut self.from else { return };
        let paused = points.last().is_some_and(|last| time_s - last.time_s > PAUSE_S);
        let is_long = points.first().is_some_and(|first| time_s - first.time_s > MAX_PART_S);
        if paused || is_long || points.len() >= MAX_POINTS {
            self.draw(measures);
        }
        if let From::Steps { points } = &mut self.from {
            points.push(Point { time_s, place_mm, filament_mm });
        }
    }

    pub(super) fn move_ended(
        &mut self,
        time_s: f64,
        line: u32,
        place_mm: [f64; 2],
        filament_mm: f64,
        measures: &mut Measures,
    ) -> Result<(), PathError> {
        let From::Job { moves, joins, .. } = &mut self.from else {
            self.draw(measures);
            self.restart_points(time_s, place_mm, filament_mm);
            return Ok(());
        };
        // Moves of this line, and moves before it that leave no record.
        let mut part = Vec::new();
        loop {
            let (one, duration_s) = moves.next().ok_or(PathError::Line { traced: line, expected: None })?;
            part.push((one, duration_s));
            if one.kind.ends_with_a_record() {
                if one.line == line {
                    break;
                }
                if !*joins {
                    return Err(PathError::Line { traced: line, expected: Some(one.line) });
                }
            }
        }
        let planned_s: f64 = part.iter().map(|(_, duration_s)| duration_s).sum();
        let is_after_own = self.after_own.pop_front_if(|after| *after == line).is_some();
        if is_after_own && time_s - self.end_s > planned_s {
            self.end_s = time_s - planned_s;
            measures.nothing_until(self.end_s);
        }
        let scale = if planned_s > 0.0 { (time_s - self.end_s).max(0.0) / planned_s } else { 0.0 };
        let mut start_s = self.end_s;
        for (one, duration_s) in part {
            let end_s = start_s + duration_s * scale;
            let bead_mm2 = MoveShape::of(&one).bead_mm2(self.filament_mm2);
            let [from_mm, to_mm] =
                [one.start_10nm, one.end_10nm].map(|[x, y, _]| [x, y].map(|units| units as f64 / UNITS_PER_MM as f64));
            if from_mm != to_mm {
                measures.push_segment(PathSegment { start_s, end_s, from_mm, to_mm, bead_mm2 });
            }
            start_s = end_s;
        }
        self.end_s = time_s;
        measures.nothing_until(time_s);
        Ok(())
    }

    /// Restarts the path after the motors' positions were redefined.
    pub(super) fn restart(&mut self, time_s: f64, place_mm: [f64; 2], filament_mm: f64, measures: &mut Measures) {
        self.draw(measures);
        if let From::Steps { points } = &mut self.from {
            // The change of the origin is not motion.
            points.clear();
        }
        self.restart_points(time_s, place_mm, filament_mm);
        self.end_s = time_s;
        measures.nothing_until(time_s);
    }

    pub(super) fn finish(&mut self, end_s: f64, measures: &mut Measures) -> Result<(), PathError> {
        self.draw(measures);
        measures.nothing_until(end_s);
        match &mut self.from {
            From::Job { moves, may_end_early: false, .. } => match moves.find(|(one, _)| one.kind.ends_with_a_record())
            {
                Some((one, _)) => Err(PathError::Unfinished { line: one.line }),
                None => Ok(()),
            },
            _ => Ok(()),
        }
    }

    fn restart_points(&mut self, time_s: f64, place_mm: [f64; 2], filament_mm: f64) {
        if let From::Steps { points } = &mut self.from {
            points.push(Point { time_s, place_mm, filament_mm });
        }
    }

    /// Draws segments through the points, as few as stay within the tolerance.
    fn draw(&mut self, measures: &mut Measures) {
        let From::Steps { points } = &mut self.from else { return };
        let points = std::mem::take(points);
        let Some(last) = points.last() else { return };
        let mut kept = vec![0];
        let mut open = vec![(0, points.len() - 1)];
        while let Some((from, to)) = open.pop() {
            match farthest(&points[from..=to]) {
                Some(middle) => open.extend([(from + middle, to), (from, from + middle)]),
                None => kept.push(to),
            }
        }
        for pair in kept.windows(2) {
            let &[from, to] = pair else { continue };
            let (from, to) = (points[from], points[to]);
            let (dx, dy) = (to.place_mm[0] - from.place_mm[0], to.place_mm[1] - from.place_mm[1]);
            let (length_mm, filament_mm) = (dx.hypot(dy), to.filament_mm - from.filament_mm);
            if length_mm > 0.0 {
                measures.push_segment(PathSegment {
                    start_s: from.time_s,
                    end_s: to.time_s,
                    from_mm: from.place_mm,
                    to_mm: to.place_mm,
                    bead_mm2: (filament_mm / length_mm).max(0.0) * self.filament_mm2,
                });
            }
        }
        self.end_s = last.time_s;
        measures.nothing_until(last.time_s);
        // The next part begins where this one ended.
        self.restart_points(last.time_s, last.place_mm, last.filament_mm);
    }
}

/// Finds the point farthest from the line between the first and the last, if that is farther than
/// the tolerance. Of several equally far ones, it is the one nearest to the middle, so that a path
/// to and fro is halved.
fn farthest(points: &[Point]) -> Option<usize> {
    let [first, .., last] = points else { return None };
    let chord = PathSegment { start_s: 0.0, end_s: 0.0, from_mm: first.place_mm, to_mm: last.place_mm, bead_mm2: 0.0 };
    let from_middle = |index: usize| index.abs_diff(points.len() / 2);
    let distances = points.iter().enumerate().map(|(index, point)| (index, chord.nearest(point.place_mm).0));
    distances
        .max_by(|one, other| one.1.total_cmp(&other.1).then(from_middle(other.0).cmp(&from_middle(one.0))))
        .filter(|(index, distance_mm)| *distance_mm > STEPS_TOLERANCE_MM && *index > 0 && *index + 1 < points.len())
        .map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Splitting points off one by one would take n^2 distances for n points.
    #[test]
    fn a_path_to_and_fro_is_split_in_its_middle() {
        let point = |index: u32| Point {
            time_s: f64::from(index),
            place_mm: [0.1 * f64::from(index % 2), 0.0],
            filament_mm: 0.0,
        };
        let points: Vec<Point> = (0..1001).map(point).collect();
        let Some(index) = farthest(&points) else { panic!("it turns by 0.1 mm") };
        assert!((400..600).contains(&index), "{index}");
    }
}
