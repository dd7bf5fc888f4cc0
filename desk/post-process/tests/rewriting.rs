//! Files of all kinds get the times of their print, and keep everything else.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use ferrostep_post_process::{
    Additions, Changes, Failure, Options, PrintTimes, Report, RewriteError, post_process, rewrite,
};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input::Input;
use ferrostep_session::{JobReplies, Session};
use proptest::prelude::*;

/// Begins a job on a warm, homed machine.
const START: &str = "M302 P1\nG28\nG92 E0\nM83\n";

fn times(text: &[u8]) -> PrintTimes {
    let mut input = Input::of_bytes(Arc::from(text)).unwrap();
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, JobReplies::new(|_: &str| {}));
    PrintTimes::of(&mut input, &session, |_, _| {}).unwrap()
}

/// Adds M73 to a file without.
const PROGRESS: Additions<'_> = Additions { progress: true, mark: None };

fn with(text: &[u8], additions: Additions<'_>) -> (Vec<u8>, Changes) {
    let mut out = Vec::new();
    let changes = rewrite(text, &mut out, &times(text), additions).unwrap();
    (out, changes)
}

/// The corrected text, which a second run does not change.
#[track_caller]
fn corrected(text: &str) -> String {
    let (first, changes) = with(text.as_bytes(), PROGRESS);
    let (second, none) = with(&first, PROGRESS);
    assert_eq!(String::from_utf8_lossy(&first), String::from_utf8_lossy(&second), "the second run");
    assert!(!none.differs && none.added_lines == 0);
    assert_eq!(changes.differs, first != text.as_bytes());
    String::from_utf8(first).unwrap()
}

#[test]
fn a_comment_tells_the_time_up_to_its_line() {
    let text = format!(
        ";TIME:5\n{START};LAYER:0\n;TIME_ELAPSED:1.00\nG4 S60\n;TIME_ELAPSED:2.00\n;REMAINING_TIME: 0\nG1 X60 F600\nG4 S30\n\
         ;TIME_ELAPSED:3.00\nG1 X0 F600\n"
    );
    let text = corrected(&text);
    let seconds = |key: &str| -> Vec<f64> {
        text.lines().filter_map(|line| line.strip_prefix(key)).map(|time| time.trim().parse().unwrap()).collect()
    };
    let (elapsed, total, left) = (seconds(";TIME_ELAPSED:"), seconds(";TIME:"), seconds(";REMAINING_TIME:"));
    let way_s = elapsed[2] - elapsed[1] - 30.0;
    assert_eq!((elapsed[1] - elapsed[0] * 1.0).round(), 60.0, "{text}");
    assert!((6.0..6.1).contains(&way_s), "60 mm at 10 mm/s: {way_s} in {text}");
    assert!((total[0] - elapsed[2] - way_s).abs() <= 0.6, "{text}");
    assert!((left[0] - (total[0] - elapsed[1])).abs() <= 1.0, "{text}");
}

#[test]
fn parts_of_a_print_have_their_own_times() {
    let text = format!(
        "; model printing time: 1s; total estimated time: 2s\n{START}G4 S100\n;LAYER_CHANGE\nG1 X10 F600\nG4 S200\n;LAYER_CHANGE\nG4 \
         S300\nG1 X20\n; estimated first layer printing time (normal mode) = 9s\n; estimated printing time (normal mode) = 9s\n; \
         estimated printing time (silent mode) = 9s\n"
    );
    let text = corrected(&text);
    let line = |start: &str| text.lines().find(|line| line.starts_with(start)).unwrap().to_owned();
    let total = line("; estimated printing time (normal").split_once(" = ").unwrap().1.to_owned();
    assert_eq!(line("; model"), format!("; model printing time: 8m 22s; total estimated time: {total}"));
    assert_eq!(line("; estimated first"), "; estimated first layer printing time (normal mode) = 3m 21s");
    assert_eq!(line("; estimated printing time (silent"), format!("; estimated printing time (silent mode) = {total}"));
}

#[test]
fn progress_of_a_slicer_is_corrected_where_it_stands() {
    let text = format!(
        "M73 P9 R9\nM73 Q9 S9\n{START}M73 C9\nG1 X10 F600\nG4 S600\nM73 P9 R9 ; half\nM600\nM73 D9\nG4 S600\nG1 X0\nM73 P9 R9"
    );
    let text = corrected(&text);
    let progress: Vec<&str> = text.lines().filter(|line| line.starts_with("M73")).collect();
    let [first, silent, pause, half, after, end] = progress[..] else { panic!("{text}") };
    assert_eq!(first.replace('P', "Q").replace('R', "S"), silent);
    assert_eq!((pause, half, after, end), ("M73 C10", "M73 P49 R10 ; half", "M73 D9", "M73 P100 R0"), "{text}");
    assert_eq!(with(text.as_bytes(), PROGRESS).1.kept_pause_words, 1);
    assert!(!text.ends_with('\n'));
}

#[test]
fn a_file_without_progress_gets_one_line_a_minute() {
    let text = format!("; a slicer\n\n{START}{}", "G4 S30\nG1 X1\nG1 X0\n".repeat(9));
    let text = corrected(&text);
    let progress: Vec<&str> = text.lines().filter(|line| line.starts_with("M73")).collect();
    let minutes: Vec<u32> = progress.iter().map(|line| line.split_once('R').unwrap().1.parse().unwrap()).collect();
    assert!(minutes.is_sorted_by(|a, b| a >= b) && minutes[0] >= 5, "{text}");
    assert_eq!(minutes.len() as u32, minutes[0] + 2, "each minute, and the end: {text}");
    assert!(text.starts_with("; a slicer\n\nM73 P0 R") && text.ends_with("\nM73 P100 R0\n"), "{text}");
    assert_eq!(with(b"G28\nG1 X9\n", Additions::default()).0, b"G28\nG1 X9\n");
}

#[test]
fn line_ends_marks_and_bytes_stay() {
    for newline in ["\n", "\r\n", "\r"] {
        for (mark, last) in [("", newline), ("\u{feff}", ""), ("\u{feff}", newline)] {
            let lines = ["G28", ";TIME:1", "G1 X5 ; \u{e9}", "G4 S61", "G1 X0"].join(newline);
            let text = format!("{mark}{lines}{last}");
            let text = corrected(&text);
            let lines: Vec<&str> = text.split(newline).collect();
            assert_eq!(lines.concat().find(['\r', '\n']), None, "{text:?}");
            assert!(text.starts_with(&format!("{mark}M73 P0 R")), "{text:?}");
            assert!(text.ends_with(&format!("G1 X0{newline}M73 P100 R0{last}")), "{text:?}");
        }
    }
    // Comments in Latin-1, the first with a number that is no time alone.
    let latin = b"G28\n;TIME:1 \xe9\n;\xe9\nG1 X5\n";
    let (out, changes) = with(latin, Additions::default());
    assert_eq!((out, changes.comments), (latin.to_vec(), 0));
}

#[test]
fn a_mark_ends_a_file_once() {
    let marked = Additions { progress: true, mark: Some("corrected by a test") };
    for last in ["", "\r\n"] {
        let text = format!("G28\r\nG1 X5{last}");
        let (out, changes) = with(text.as_bytes(), marked);
        let expected = format!("\r\nM73 P100 R0\r\n; corrected by a test{last}");
        assert!(out.ends_with(expected.as_bytes()) && changes.differs, "{}", String::from_utf8_lossy(&out));
        let (again, changes) = with(&out, marked);
        assert!(again == out && !changes.differs);
    }
}

#[test]
fn numbered_lines_get_no_line_between_them() {
    let text = b"N1 G28*18\nN2 G1 X5*103\n";
    let outcome = rewrite(&text[..], &mut Vec::new(), &times(text), PROGRESS);
    assert!(matches!(outcome, Err(RewriteError::Numbered(1))), "{outcome:?}");
    let text = b"N1 G28*18\nN2 M73 P9 R9*23\nN3 G1 X5*102\n";
    let (out, _) = with(text, PROGRESS);
    assert!(out.starts_with(b"N1 G28*18\nN2 M73 P") && out != text, "{}", String::from_utf8_lossy(&out));
    times(&out);
}

/// Takes some bytes, then says that the disk is full.
struct Full(usize);

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.0 == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let length = bytes.len().min(self.0);
        self.0 -= length;
        Ok(length)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_wherever_it_is_full() {
    let text = b";TIME:1\nG28\nG1 X5\nM73 P0 R9";
    let times = times(text);
    let whole = with(text, PROGRESS).0.len();
    for room in 0..whole {
        let outcome = rewrite(&text[..], &mut Full(room), &times, PROGRESS);
        assert!(matches!(outcome, Err(RewriteError::Write(_))), "{room}: {outcome:?}");
    }
    assert!(rewrite(&text[..], &mut Full(whole), &times, PROGRESS).is_ok());
}

fn process(file: &Path) -> Result<Report, Failure> {
    let options = Options { file, out: None, additions: PROGRESS, protected: &[] };
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, JobReplies::new(|_: &str| {}));
    post_process(&options, &session, |_, _, _| {})
}

#[test]
fn a_file_that_cannot_be_corrected_stays() {
    let folder = tempfile::tempdir().unwrap();
    for (text, reason) in [
        (&b"G28\nG1 X10 F600\nG1 X20 ;TIME:1\nG1 X30 E5\n"[..], "line 4"),
        (b"; a comment\n;TIME:5\n", "no motion"),
        (b"M140 S0\n", "no motion"),
        (b"", "empty"),
        (b"\x1f\x8b\x08\0", "packed with gzip"),
        (b"PK\x03\x04", "a zip archive"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "not a text file"),
    ] {
        let file = folder.path().join("job.gcode");
        fs::write(&file, text).unwrap();
        let Err(Failure::Job(said) | Failure::Start(said)) = process(&file) else { panic!("{reason}") };
        assert!(said.contains(reason), "{said}");
        assert_eq!(fs::read(&file).unwrap(), text);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "{reason}: a file is left");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Lines that tell no time stay, in their order, with their ends; and the second run changes
    /// nothing.
    #[test]
    fn everything_else_stays(
        lines in prop::collection::vec(
            prop_oneof![
                Just("G1 X5 F6000"), Just("G1 X90"), Just("G4 S20"), Just(";TIME:1"), Just(";TIME_ELAPSED:1.5"), Just(""), Just("  ; x=1"),
                Just("M73 P1 R1"), Just("M73 Q1 S1"), Just("M117 TIME:5"), Just("; estimated printing time (normal mode) = 1h 2m 3s"),
            ],
            0..40
        ),
        ends in prop::collection::vec(prop_oneof![Just("\n"), Just("\r\n"), Just("\r")], 40),
        is_open: bool,
    ) {
        let mut text = "G28\n".to_owned();
        lines.iter().zip(&ends).for_each(|(line, end)| text = format!("{text}{line}{end}"));
        if is_open {
            text += "G1 X7";
        }
        let (out, _) = with(text.as_bytes(), PROGRESS);
        let (again, changes) = with(&out, PROGRESS);
        prop_assert_eq!(&out, &again);
        prop_assert!(!changes.differs);
        let tells = |line: &&str| line.starts_with("M73 P") || line.starts_with("M73 Q") || line.contains("TIME") || line.contains("time");
        let rest = |text: &str| -> Vec<String> {
            text.split(['\r', '\n']).filter(|line| !tells(line)).map(str::to_owned).collect()
        };
        let out = String::from_utf8(out).unwrap();
        let kept = |text: &str| -> Vec<String> { rest(text).into_iter().filter(|line| !line.is_empty()).collect() };
        prop_assert_eq!(kept(&out), kept(&text));
        // Line ends are bytes of the file, too: without the lines that tell a time, all bytes are
        // those of before.
        let untold = |text: &str| -> usize { text.bytes().filter(|byte| *byte == b'\r').count() };
        if !text.contains("\r") {
            prop_assert_eq!(untold(&out), 0);
        }
    }
}
