//! A refused line changes nothing: the lines after it are executed as if it were absent.

use std::cell::RefCell;

use ferrostep_gcode::Reply;
use ferrostep_planner::StepDigests;
use ferrostep_printer::{Profile, Replies};
use ferrostep_session::Session;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;

use crate::end_to_end::desk::profile;

/// Keeps the printer's replies, line by line.
#[derive(Debug, Default)]
pub struct Collector(RefCell<Vec<String>>);

impl Collector {
    /// Takes the lines so far.
    pub fn take(&self) -> Vec<String> {
        self.0.take()
    }
}

impl Replies for Collector {
    fn send(&self, reply: Reply<'_>) {
        self.0.borrow_mut().extend(reply.to_string().lines().map(str::to_owned));
    }
}

/// A machine's state after some lines.
#[derive(Debug, PartialEq)]
struct Done {
    digests: StepDigests,
    motor_steps: [u64; 4],
    motion_time_s: f64,
    logical_10nm: [i64; 4],
    /// Positions as reported in the middle and at the end.
    replies: Vec<String>,
}

/// Executes lines as a host sends them: a refused one is followed by the next. Returns the state,
/// and true for each line that was refused.
fn execute<'a>(profile: &Profile, lines: impl IntoIterator<Item = &'a str>) -> (Done, Vec<bool>) {
    let session = Session::print(*profile, LOOK_AHEAD_BLOCKS, (), Collector::default());
    let mut printer = session.printer();
    let mut refused = Vec::new();
    let mut reports = Vec::new();
    for (number, line) in (1..).zip(lines) {
        refused.push(session.run(printer.execute(number, line)).is_err());
        let replies = session.replies().take();
        assert_eq!(replies.iter().filter(|reply| reply.starts_with("ok")).count(), 1, "{line}: {replies:?}");
        reports.extend(replies.into_iter().filter(|reply| reply.starts_with("X:") || reply.starts_with("FR:")));
    }
    session.run(printer.finish()).unwrap();
    let logical_10nm = printer.logical_10nm();
    let figures = session.figures();
    let done = Done {
        digests: figures.digests,
        motor_steps: figures.motor_steps,
        motion_time_s: figures.motion_time_s,
        logical_10nm,
        replies: reports,
    };
    (done, refused)
}

/// Compares a program with one bad line in its middle with the program without it.
#[track_caller]
fn changes_nothing(profile: &Profile, before: &[&str], bad: &str, after: &[&str]) {
    let (expected, refused) = execute(profile, before.iter().chain(after).copied());
    assert!(!refused.contains(&true), "the program itself is good: {refused:?}");
    let (done, refused) = execute(profile, before.iter().chain(&[bad]).chain(after).copied());
    assert!(refused[before.len()], "{bad} is refused");
    assert_eq!(done, expected, "{bad}");
}

#[test]
fn a_refused_line_keeps_position_feed_and_limits() {
    let profile = profile("cartesian");
    let before = ["G28", "G1 X10 Y20 Z3 F3000", "G1 X20 Y30"];
    let after = ["M220", "G1 X40", "M114", "G1 Y60 Z3.5", "G1 X10", "G91", "G1 X5 Y5", "G2 I4 J3", "M114"];
    for bad in [
        "G1 X99 Y1.2.3",
        "G1 X99 Y1 F6000 E5",
        "G1 X6000 F600",
        "G0 F0.1 X99",
        "G2 X60 Y60 I1 J2 F9000",
        "G3 X60 F9000",
        "G2 X40 Y40 R3 F9000",
        "G2 X40 Y30 I10 J0 E4 F9000",
        "G92 X99 Y6000",
        "G92 X3 E.",
        "M220 S1000",
        "M221 S0",
        "M203 X1 Y9999999",
        "M201 X5 Y0.001",
        "G5 X60 Y60 I1 J1 P1 Q1",
        "G53 G1 X60",
        "G10 L2 X5",
        "M200 D1.75",
        "M204 S5 T9999999",
        "M205 J100",
        "M207 S1 Z500",
        "M104 S900",
        "G10",
        "T3",
        "M155 S61",
        "G20 X1.2.3",
        "G91 #",
    ] {
        changes_nothing(&profile, &before, bad, &after);
    }
}

/// An arc may leave the reach of the planner between ends that are well inside.
#[test]
fn a_refused_arc_makes_no_chord() {
    let profile = profile("cartesian");
    let before = ["G1 X4990 Y0 F60000"];
    changes_nothing(&profile, &before, "G3 X4990 Y100 I0 J50", &["M114", "G1 X4980 Y5", "M114"]);
}

#[test]
fn a_refused_line_keeps_the_extruder_position() {
    let profile = profile("cartesian");
    let before = ["G28", "M302 P1", "G1 X10 Y20 E2 F3000"];
    let after = ["G1 X20 E3", "M83", "G1 X30 E1", "M114"];
    for bad in ["G1 X99 E1500", "G1 E-1100 F100", "G1 X5 E1..2", "G2 X99 Y20 I44.5 E9999999", "M221 S2000"] {
        changes_nothing(&profile, &before, bad, &after);
    }
}
