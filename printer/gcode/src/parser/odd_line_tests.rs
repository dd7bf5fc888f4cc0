//! Lines that are not quite right, not executed, or refused.

use super::tests::{number, reads, reads_with, refused, some};
use super::*;
use crate::{ArcForm, AxisFlags, AxisWords, Decimal, Remarks};

/// A remark says why a command is not executed; `tests` of `not_executed` go through
/// the table itself.
#[test]
fn commands_without_effect_say_why() {
    for (text, says) in [
        ("G17", "arcs lie in it as it is"),
        ("G53 (machine)", "alone in its line it moves nothing"),
        ("G54", "it is the only one, and in force"),
        ("M486 Acube.stl (Instance 1)", "all are printed"),
        ("M862.2 P300", "not checked"),
    ] {
        let mut remarks = Remarks::default();
        assert_eq!(parse_with_remarks(text, &mut remarks), Ok(Command::Accepted), "{text}");
        assert!(remarks.to_string().ends_with(says) && !remarks.is_unknown(), "{text}: {remarks}");
    }
    // The machine already is as they ask.
    reads("M862.1 P0.4 A0", Command::CheckNozzle(some("0.4")));
    reads_with("M862.1 Q", Command::CheckNozzle(None), "Q has no effect");
    for text in ["M862.3 P \"MK4\"", "M862.3 PMK4", "M862.3 P MK4 "] {
        reads(text, Command::CheckModel("MK4"));
    }
    reads("M862.3 Q", Command::CheckModel(""));
    reads_with("M569 P0 S1", Command::Accepted, "P: drivers are named by X, Y, Z and E here; no effect");
    reads("G5", Command::Unknown("G5"));
    for text in ["M240", "M428", "G27 P2"] {
        let mut remarks = Remarks::default();
        assert_eq!(parse_with_remarks(text, &mut remarks), Ok(Command::Unknown(text)), "{text}");
        assert!(remarks.is_unknown(), "{text}: {remarks}");
    }
}

/// Lines that are not commands end no job; those that could have moved something do.
#[test]
fn stray_lines() {
    reads_with("@BEDLEVELVISUALIZER", Command::Accepted, "a line with @ is for the host; no effect");
    let says = "not a comment, which begins with ;, and not a command; no effect";
    reads_with(" // end of print", Command::Accepted, says);
    for text in [
        "'M104 S0'",
        "5",
        "100",
        "\u{e9}5",
        "/ 5",
        "<html>",
        "{if x}G28",
        "MY_PRINT",
        "start EXTRUDER=210",
        "GCode",
        "Start GCode begin",
        "G-code by hand",
        "MESH_ON",
        "M_X",
        "NOT_EXCLUDE_OBJECT NAME=a",
        "Xmas",
        "\u{feff}G28",
    ] {
        reads(text, Command::Unknown(text));
    }
    for text in ["X10", "X10 Y20", "y-5", "Z .3", "E+1"] {
        let says = "a coordinate without a command: write G1 before it";
        assert_eq!(refused(text), says, "{text}");
    }
    reads_with(
        "G4 600",
        Command::Dwell { milliseconds: 0 },
        "without P or S: waits until all motion has ended; a number without its letter is ignored",
    );
    reads_with(
        "M84 5 X",
        Command::DisableMotors(AxisFlags { x: true, ..AxisFlags::default() }),
        "a number without its letter is ignored",
    );
    for (text, found) in [("G1 10 Y5", '1'), ("G2 I1 -5", '-'), ("G92 0", '0'), ("M290 .1", '.'), ("M851 -1", '-')] {
        assert_eq!(
            refused(text),
            format!("unexpected character '{found}', expected a letter and its number"),
            "{text}"
        );
    }
    assert_eq!(refused("M84 1.2.3"), "unexpected character '1', expected a letter and its number");
}

/// Lines that do not stop a print: a remark names what is ignored.
#[test]
fn odd_lines_are_read_as_in_marlin() {
    let line = |axes, feed| Command::Linear { rapid: false, axes, feed };
    let (none, x) = (AxisWords::default(), AxisWords { x: some("5"), ..AxisWords::default() });
    let second = "one command a line: the second and everything after it is ignored";
    reads_with("G4", Command::Dwell { milliseconds: 0 }, "without P or S: waits until all motion has ended");
    reads_with(
        "G4 P",
        Command::Dwell { milliseconds: 0 },
        "P without a number is ignored; without P or S: waits until all motion has ended",
    );
    reads_with("G1 X5 E", line(x, None), "E without a number is ignored");
    reads_with("G1 YX5", line(x, None), "Y without a number is ignored");
    reads_with("G1 Y", line(none, None), "Y without a number is ignored");
    // Words that follow do not take a number away.
    reads("G1 X5 X", line(x, None));
    reads_with("G1 X5 F0", line(x, None), "F is not above 0 and is ignored");
    reads_with("G1 X5 F-100", line(x, None), "F is not above 0 and is ignored");
    reads_with("G1 X5 F", line(x, None), "F without a number is ignored");
    let form = ArcForm::Centre { i: number("1"), j: Decimal::ZERO };
    let arc = Command::Arc { clockwise: true, axes: none, form, feed: None };
    reads_with("G2 I1 J F0", arc, "J without a number is ignored; F is not above 0 and is ignored");
    reads_with("G90 G0 X5", Command::AbsolutePositioning, second);
    reads_with("G28 G1 Z5", Command::Home { axes: AxisFlags::default(), unless_homed: false }, second);
    reads_with("G1 X5 M106 S99", line(x, None), second);
    for text in ["%", "% O1", " %"] {
        reads(text, Command::Unknown(text.trim()));
    }
}

#[test]
fn commands_that_must_not_be_skipped_are_refused() {
    for (text, says) in [
        ("G5 X5 Y5 I1 J1 P1 Q1", "G5: not supported, the curve would be missing"),
        ("G18", "G18 and G19: not supported"),
        ("G5.1 I1 J1", "G0.x to G6.x: not supported"),
        ("G1.5 X1", "G0.x to G6.x: not supported"),
        ("G6 I1 S1", "G6: not supported"),
        ("G10 L2 P1 X5", "G10 with an offset: not supported"),
        ("G10 P0 X5", "G10 with an offset: not supported"),
        ("G16", "G16: not supported"),
        ("G38.2 Z-5", "G38: not supported"),
        ("G38", "G38: not supported"),
        ("G41 D1", "G41 and G42: not supported"),
        ("G43 H1", "G43 and G44: not supported"),
        ("G51 X2", "G51: not supported"),
        ("G52 X5", "G52: not supported"),
        ("G53 G1 X5", "G53 with a move: not supported"),
        ("G55", "G55 to G59: not supported"),
        ("G59.3", "G55 to G59: not supported"),
        ("G68 R45", "G68: not supported"),
        ("G81 X5 Z-5 R2", "G73 to G89: not supported"),
        ("G92.1", "G92.x: not supported"),
        ("G93", "G93: not supported"),
        ("G95", "G95: not supported"),
        ("M149 F", "M149 F and K: not supported"),
        ("M200 D1.75", "M200: not supported"),
        ("M200 S1", "M200: not supported"),
    ] {
        let text_of_error = refused(text);
        assert!(text_of_error.starts_with(says) && text_of_error.contains("; "), "{text}: {text_of_error}");
    }
    for text in ["M200", "M200 D0", "M200 D1.75 S0", "M200 S0", "M149", "M149 C"] {
        reads(text, Command::Accepted);
    }
}
