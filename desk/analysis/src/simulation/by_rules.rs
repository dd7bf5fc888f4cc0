//! The motion of a job by another firmware's rules, as the simulator plays it.

use std::cell::RefCell;
use std::collections::HashSet;
use std::rc::Rc;

use ferrostep_oracle::reference::{Job, Move};
use ferrostep_printer::Profile;
use ferrostep_session::job::{self, JobError, JobProgress};
use ferrostep_session::rules::{ByRules, Piece, PlanObserver};
use ferrostep_session::{JobReplies, Session};
use ferrostep_simulator::plan::{ExecutedMove, MoveShape, Plan, PlanBuilder};

/// A job's motion by other rules.
pub(super) struct ByRulesPlan {
    /// The plans: one, and another after each homing on the way.
    pub plans: Vec<Plan>,
    /// The time of each of the job's moves, s.
    pub durations_s: Vec<f64>,
    /// Lines before whose moves the printer adds others.
    pub after_own: Vec<u32>,
    /// Error that stopped the job early.
    pub stopped: Option<JobError>,
}

/// Plans a job's text by other rules; `job`: its path, if that is known.
pub(super) fn planned(
    text: &[u8],
    job: Option<&Job>,
    profile: &Profile,
    by: ByRules,
    filament_mm2: f64,
) -> ByRulesPlan {
    let session = Session::by_rules(*profile, by, JobReplies::new(|_: &str| {}));
    let executed = Rc::new(RefCell::new(Executed::new(filament_mm2)));
    session.desk().observe(Box::new(Shared(Rc::clone(&executed))));
    let mut done = JobProgress::default();
    let outcome = session.run(job::run(&mut &text[..], &mut session.printer(), &mut done, |_| {}));
    drop(session);
    let mut executed = executed.borrow_mut();
    executed.begin_plan();
    ByRulesPlan {
        plans: std::mem::take(&mut executed.plans),
        durations_s: job.map(|job| durations_s(job, &executed.spans)).unwrap_or_default(),
        after_own: after_own(&executed.spans),
        stopped: outcome.err(),
    }
}

/// Hands the pieces on.
struct Shared(Rc<RefCell<Executed>>);

impl PlanObserver for Shared {
    fn ran(&mut self, piece: &Piece) {
        self.0.borrow_mut().ran(piece);
    }

    fn stands(&mut self, _tick: u64, _position_mm: [f64; 3]) {
        self.0.borrow_mut().begin_plan();
    }
}

/// Length and time of a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Span {
    line: u32,
    length_mm: f64,
    duration_s: f64,
    ends_move: bool,
}

/// The pieces so far.
struct Executed {
    filament_mm2: f64,
    plans: Vec<Plan>,
    plan: PlanBuilder,
    spans: Vec<Span>,
    filament_mm: f64,
}

impl Executed {
    fn new(filament_mm2: f64) -> Self {
        Self {
            filament_mm2,
            plans: Vec::new(),
            plan: PlanBuilder::new(filament_mm2),
            spans: Vec::new(),
            filament_mm: 0.0,
        }
    }

    /// The machine is at another place: the moves after it are another plan.
    fn begin_plan(&mut self) {
        let ended = std::mem::replace(&mut self.plan, PlanBuilder::new(self.filament_mm2));
        self.plans.extend(ended.build());
    }

    fn ran(&mut self, piece: &Piece) {
        let Piece { line, start_mm: [x_mm, y_mm, z_mm], displacement_mm: [x, y, z, filament_mm], ends_move, .. } =
            *piece;
        let shape = MoveShape::new([x, y, z], filament_mm);
        let phases = piece.phases.map(|phase| {
            let [from, to] = phase.speeds_mm_per_s;
            (phase.seconds, if phase.seconds > 0.0 { (to - from) / phase.seconds } else { 0.0 })
        });
        self.plan.push(&ExecutedMove {
            recorded_line: ends_move.then_some(line),
            start_mm: [x_mm, y_mm, z_mm, self.filament_mm],
            shape,
            entry_mm_per_s: piece.phases[0].speeds_mm_per_s[0],
            phases,
        });
        self.filament_mm += filament_mm;
        let duration_s = phases.iter().map(|(duration_s, _)| duration_s).sum();
        self.spans.push(Span { line, length_mm: shape.length_mm, duration_s, ends_move });
    }
}

/// Lines before whose moves the printer adds others: moves of another line that no end has told.
fn after_own(spans: &[Span]) -> Vec<u32> {
    let groups = spans.split_inclusive(|span| span.ends_move);
    let last = groups.filter_map(|group| group.last().map(|last| (group, last)));
    last.filter(|(group, last)| last.ends_move && group.iter().any(|span| span.line != last.line))
        .map(|(_, last)| last.line)
        .collect()
}

/// The time of each of the job's moves: of the pieces up to the end of a move, their share by
/// length. The pieces of an arc are other chords than the job's. A job that stops has no time for
/// the moves after.
fn durations_s(job: &Job, spans: &[Span]) -> Vec<f64> {
    let mut durations_s = Vec::with_capacity(job.moves.len());
    let mut rest = job.moves.as_slice();
    for group in spans.split_inclusive(|span| span.ends_move) {
        // A move that is too short for the rules goes with the next one, and has no separate end.
        let end = group.last().filter(|last| last.ends_move).map(|last| last.line);
        let is_last = |one: &Move| one.kind.ends_with_a_record() && end.is_none_or(|line| one.line == line);
        let Some(last) = rest.iter().position(is_last) else { break };
        let (moves, after) = rest.split_at(last + 1);
        rest = after;
        let lines: HashSet<u32> = moves.iter().map(|one| one.line).collect();
        // The printer's own moves are of no line here.
        let pieces = group.iter().filter(|span| lines.contains(&span.line));
        share(moves, pieces.copied(), &mut durations_s);
    }
    share(rest, std::iter::empty(), &mut durations_s);
    durations_s
}

/// Appends the times of moves that are executed in these pieces.
fn share(moves: &[Move], mut pieces: impl Iterator<Item = Span> + Clone, durations_s: &mut Vec<f64>) {
    let lengths_mm = moves.iter().map(|one| MoveShape::of(one).length_mm);
    let whole_mm: f64 = lengths_mm.clone().sum();
    let pieces_mm: f64 = pieces.clone().map(|piece| piece.length_mm).sum();
    let scale = if whole_mm > 0.0 { pieces_mm / whole_mm } else { 0.0 };
    let mut piece = pieces.next();
    // Length of the piece that is left.
    let mut left_mm = piece.map_or(0.0, |piece| piece.length_mm);
    for length_mm in lengths_mm {
        let mut wanted_mm = length_mm * scale;
        let mut duration_s = 0.0;
        while let Some(Span { length_mm: piece_mm, duration_s: piece_s, .. }) = piece {
            let part_mm = wanted_mm.min(left_mm);
            duration_s += piece_s * part_mm / piece_mm;
            (wanted_mm, left_mm) = (wanted_mm - part_mm, left_mm - part_mm);
            if left_mm > 0.0 {
                break;
            }
            piece = pieces.next();
            left_mm = piece.map_or(0.0, |piece| piece.length_mm);
        }
        durations_s.push(duration_s);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ferrostep_oracle::reference::{InterpretOptions, ReferenceProfile, interpret};

    const fn span(line: u32, length_mm: f64, duration_s: f64, ends_move: bool) -> Span {
        Span { line, length_mm, duration_s, ends_move }
    }

    #[test]
    fn chords_have_the_times_of_the_pieces_beside_them() {
        let text = b"G28\nG1 X20 Y20 F6000\nG2 X40 Y20 I10 J0\nG1 X50\n";
        let job = interpret(text, &ReferenceProfile::cartesian(), InterpretOptions::default()).unwrap();
        // Two halves of the arc, the second one in three times the time; a parking move before.
        let spans = [
            span(2, 28.0, 0.5, true),
            span(2, 50.0, 9.0, false),
            span(3, 14.0, 1.0, false),
            span(3, 14.0, 3.0, true),
            span(4, 10.0, 0.25, true),
        ];
        let durations_s = durations_s(&job, &spans);
        assert_eq!(durations_s.len(), job.moves.len());
        let of_line = |line: u32| -> Vec<f64> {
            let moves = job.moves.iter().zip(&durations_s);
            moves.filter(|(one, _)| one.line == line).map(|(_, duration_s)| *duration_s).collect()
        };
        assert_eq!((of_line(2), of_line(4)), (vec![0.5], vec![0.25]));
        let arc = of_line(3);
        assert!((arc.iter().sum::<f64>() - 4.0).abs() < 1e-9, "{arc:?}");
        let half_s: f64 = arc[..arc.len() / 2].iter().sum();
        assert!((half_s - 1.0).abs() < 0.1, "{arc:?}");
        assert_eq!(after_own(&spans), [3]);
    }

    #[test]
    fn a_job_that_stops_has_no_time_for_what_it_lacks() {
        let job =
            interpret(b"G28\nG1 X20 F6000\nG1 X40\n", &ReferenceProfile::cartesian(), InterpretOptions::default());
        assert_eq!(durations_s(&job.unwrap(), &[span(2, 20.0, 0.5, true)]), [0.5, 0.0]);
    }
}
