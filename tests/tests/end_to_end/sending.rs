//! `ferrostep send` to a terminal with a virtual board at its other end.

use std::path::{Path, PathBuf};

use ferrostep_gpre::{Encoding, EntrySpeed};
use ferrostep_testkit::hand_made;
use serde_json::Value;
use tempfile::TempDir;

use crate::end_to_end::command::{Outcome, directory, example, ferrostep, file, gzip, start};
use crate::end_to_end::desk::profile;
use crate::end_to_end::prepared::{SQUARE, prepared, says};
use crate::end_to_end::pty_board::{Pty, PtyBoard, Served, Settings};

/// The first lines of a print.
const LINES: usize = 1_500;

/// A board for the machine of the jobs here.
fn board() -> Settings {
    Settings::new(profile("cartesian"))
}

/// The G-code of a part of a print, which takes more than a few frames.
fn part() -> String {
    let text = String::from_utf8(example("cube.gcode")).unwrap();
    text.lines().take(LINES).map(|line| format!("{line}\n")).collect()
}

/// Prepares G-code for a machine, into a file.
fn job(directory: &TempDir, name: &str, machine: &str, gcode: &str) -> PathBuf {
    file(directory, name, prepared(&profile(machine), gcode.as_bytes(), Encoding::Compact).unwrap())
}

fn send(job: &Path, port: &str, fallback: Option<&Path>) -> Outcome {
    let mut arguments = vec!["send", job.to_str().unwrap(), "--port", port];
    arguments.extend(fallback.iter().flat_map(|path| ["--fallback", path.to_str().unwrap()]));
    ferrostep(arguments)
}

/// The report of `print` for a file.
fn printed(path: &Path) -> Value {
    let outcome = ferrostep(["print", path.to_str().unwrap(), "--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    outcome.json()
}

/// Checks that the board has made the steps of `print`, each at its time.
#[track_caller]
fn assert_printed(served: &Served, path: &Path) {
    let printed = printed(path);
    let digests = served.figures.digests;
    assert_eq!(printed["step_digest"], format!("{:016x}", digests.step), "{:#?}", served.said);
    assert_eq!(printed["order_digest"], format!("{:016x}", digests.order));
    assert_eq!(served.figures.underruns, 0);
}

#[track_caller]
fn assert_nothing_moved(served: &Served) {
    assert_eq!(served.figures.motor_steps, [0; 4], "{:#?}", served.said);
}

#[test]
fn a_job_is_sent_and_printed() {
    let directory = directory();
    let job = job(&directory, "part.gpre", "cartesian", &part());
    let board = PtyBoard::start(board());
    let outcome = send(&job, board.port(), None);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    says(&outcome.stderr, "printed");
    assert_eq!(outcome.stdout, "");
    let served = board.end();
    assert_eq!(served.jobs, 1);
    assert_printed(&served, &job);
}

#[test]
fn a_job_for_another_machine_is_refused() {
    let directory = directory();
    let job = job(&directory, "square.gpre", "corexy", SQUARE);
    let board = PtyBoard::start(board());
    let outcome = send(&job, board.port(), None);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "prepared for another machine (profile ");
    says(&outcome.stderr, "the board refuses the job");
    assert_nothing_moved(&board.end());
}

#[test]
fn packets_are_refused() {
    let directory = directory();
    let job = prepared(&profile("cartesian"), SQUARE.as_bytes(), Encoding::Wide).unwrap();
    let job = file(&directory, "square.gpre", job);
    let board = PtyBoard::start(board());
    let outcome = send(&job, board.port(), None);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "prepare the job with `ferrostep preprocess --format compact`");
    says(&outcome.stderr, "the board refuses the job");
    assert_nothing_moved(&board.end());
}

#[test]
fn the_fallback_is_printed_if_the_board_refuses_the_job() {
    let directory = directory();
    let job = job(&directory, "part.gpre", "corexy", &part());
    // G-code as slicers and people write it: comments, blank lines, letters of old
    // code pages; packed.
    let text = [part().as_bytes(), b"\n; caf\xe9\nM117 \xc2\xb5 \n"].concat();
    let plain = file(&directory, "part.gcode", text);
    let packed = file(&directory, "part.gcode.gz", gzip(part().as_bytes()));
    for gcode in [&plain, &packed] {
        let board = PtyBoard::start(board());
        let outcome = send(&job, board.port(), Some(gcode));
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        says(&outcome.stderr, "the board refuses the job");
        says(&outcome.stderr, "sending the G-code instead");
        says(&outcome.stderr, "lines sent");
        assert_printed(&board.end(), &packed);
    }
}

#[test]
fn gcode_is_sent_line_by_line() {
    let directory = directory();
    let text = file(&directory, "part.gcode", part());
    for job in [&text, &file(&directory, "part.gcode.gz", gzip(part().as_bytes()))] {
        let board = PtyBoard::start(board());
        let outcome = send(job, board.port(), None);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        says(&outcome.stderr, "lines sent");
        assert_printed(&board.end(), &text);
    }
}

/// Sends G-code with `--meatpack`.
fn send_packed(gcode: &Path, port: &str) -> Outcome {
    ferrostep(["send", gcode.to_str().unwrap(), "--port", port, "--meatpack"])
}

#[test]
fn packed_gcode_prints_the_same_in_fewer_bytes() {
    let directory = directory();
    let text = file(&directory, "part.gcode", part());
    let plain = {
        let board = PtyBoard::start(board());
        assert_eq!(send(&text, board.port(), None).status, Some(0));
        board.end()
    };
    let board = PtyBoard::start(board());
    // The next host finds the line unpacked, as before.
    for _ in 0..2 {
        let outcome = send_packed(&text, board.port());
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        says(&outcome.stderr, "lines sent, packed");
    }
    let served = board.end();
    assert_eq!(served.said.iter().filter(|line| line.as_str() == "[MP] PV01 ON ESP").count(), 2);
    assert_eq!(served.said.last().unwrap(), "[MP] PV01 OFF ESP");
    assert!(!served.said.iter().any(|line| line.starts_with("Resend:")), "{:#?}", served.said);
    let share = served.taken as f64 / 2.0 / plain.taken as f64;
    assert!(share < 0.75, "{share}");
}

#[test]
fn packed_gcode_makes_the_steps_of_print() {
    let directory = directory();
    let text = file(&directory, "part.gcode", part());
    let board = PtyBoard::start(board());
    assert_eq!(send_packed(&text, board.port()).status, Some(0));
    assert_printed(&board.end(), &text);
}

#[test]
fn a_printer_that_does_not_unpack_gets_text() {
    let directory = directory();
    let text = file(&directory, "square.gcode", SQUARE);
    let board = PtyBoard::start(Settings { unpacks: false, ..board() });
    let outcome = send_packed(&text, board.port());
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    says(
        &outcome.stderr,
        "note: the printer does not know MeatPack (M115 does not say Cap:MEATPACK:1): sending plain text",
    );
    assert_printed(&board.end(), &text);
}

#[test]
fn the_fallback_is_not_sent_after_a_job_has_begun() {
    let directory = directory();
    let gcode = file(&directory, "other.gcode", "G28\nG1 X100 F6000\n");
    let square = job(&directory, "square.gpre", "cartesian", SQUARE);
    let sound = PtyBoard::start(board());
    let outcome = send(&square, sound.port(), Some(&gcode));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(!outcome.stderr.contains("instead"), "{outcome:#?}");
    assert_printed(&sound.end(), &square);

    // Beyond the end of the axis, when half of it is done.
    let moves = [(40, EntrySpeed::Bound), (400, EntrySpeed::Bound)];
    let stops = file(&directory, "stops.gpre", hand_made::job(profile("cartesian").plan_hash, &moves));
    let stopped = PtyBoard::start(board());
    let outcome = send(&stops, stopped.port(), Some(&gcode));
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "X: outside the soft limits");
    says(&outcome.stderr, "the board stopped in frame 2 at byte ");
    assert!(!outcome.stderr.contains("instead"), "{outcome:#?}");
    let served = stopped.end();
    assert!(!served.said.iter().any(|line| line.starts_with("X:100")), "{:#?}", served.said);
}

#[test]
fn a_bad_fallback_is_refused_before_sending() {
    let directory = directory();
    let job = job(&directory, "square.gpre", "corexy", SQUARE);
    let board = PtyBoard::start(board());
    for (fallback, expected) in [
        (&job, "this is a prepared job, and --fallback takes G-code"),
        (&directory.path().join("none.gcode"), "none.gcode: cannot be read: No such file"),
    ] {
        let outcome = send(&job, board.port(), Some(fallback));
        assert_eq!(outcome.status, Some(2), "{outcome:#?}");
        says(&outcome.stderr, expected);
    }
    assert_eq!(board.end().taken, 0);
}

#[test]
fn a_fallback_that_halts_the_machine_ends() {
    let directory = directory();
    let job = job(&directory, "square.gpre", "corexy", SQUARE);
    let gcode = file(&directory, "halts.gcode", "G28\nM112\nG1 X100 F6000\n");
    let board = PtyBoard::start(board());
    let outcome = send(&job, board.port(), Some(&gcode));
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "error: the board has halted: Error:Printer halted");
    // This answers M112; nothing was sent after it.
    assert_eq!(board.end().said.iter().filter(|line| line.contains("is halted")).count(), 1);
}

#[test]
fn a_board_without_job_support_is_given_up() {
    let directory = directory();
    let job = job(&directory, "square.gpre", "cartesian", SQUARE);
    let gcode = file(&directory, "square.gcode", SQUARE);
    let no_jobs = Settings { takes_jobs: false, ..board() };
    let halted = Settings { before: &["M112"], ..board() };
    for (settings, expected) in
        [(no_jobs, "M790 works on a board's serial or USB port only"), (halted, "M999 restarts it")]
    {
        let board = PtyBoard::start(settings);
        let outcome = send(&job, board.port(), Some(&gcode));
        assert_eq!(outcome.status, Some(1), "{outcome:#?}");
        says(&outcome.stderr, "error: the board does not take the job; its last lines:");
        says(&outcome.stderr, expected);
        assert_nothing_moved(&board.end());
    }
}

#[test]
fn a_silent_board_is_given_up() {
    let directory = directory();
    let job = job(&directory, "square.gpre", "cartesian", SQUARE);
    let silent = Pty::new();
    let outcome = send(&job, silent.path().to_str().unwrap(), None);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "error: the board does not answer");
}

#[test]
fn a_missing_port_is_an_error() {
    let directory = directory();
    let job = job(&directory, "square.gpre", "cartesian", SQUARE);
    let outcome = send(&job, "/dev/no-such-port", None);
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    says(&outcome.stderr, "/dev/no-such-port: there is no such port");
}

/// Sends a job and kills the host when the board has read this many bytes.
fn send_and_kill(job: &Path, board: &PtyBoard, bytes: u64) {
    board.hold_after(bytes);
    let mut host = start(["send", job.to_str().unwrap(), "--port", board.port()]);
    board.wait_until_held();
    host.kill().unwrap();
    let outcome: Outcome = host.wait_with_output().unwrap().into();
    assert_eq!(outcome.status, None, "it was not killed in the middle: {outcome:#?}");
}

#[test]
fn a_killed_host_can_resume() {
    let directory = directory();
    let job = job(&directory, "part.gpre", "cartesian", &part());
    let length = std::fs::metadata(&job).unwrap().len();
    let board = PtyBoard::start(board());
    send_and_kill(&job, &board, length / 2);
    board.release();
    let outcome = send(&job, board.port(), None);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    says(&outcome.stderr, "printed");
    let served = board.end();
    assert_eq!(served.jobs, 1, "it did not go on but begin anew");
    // The bytes of the first host were not sent again: frames are a tenth longer
    // than their content.
    assert!(served.taken < length * 13 / 10, "{} bytes for a job of {length}", served.taken);
    assert_printed(&served, &job);
}

#[test]
fn a_different_job_is_not_resumed() {
    let directory = directory();
    let first = job(&directory, "part.gpre", "cartesian", &part());
    let other = job(&directory, "square.gpre", "cartesian", SQUARE);
    let board = PtyBoard::start(board());
    send_and_kill(&first, &board, 2_000);
    board.release();
    let outcome = send(&other, board.port(), None);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "error: the board does not take the job; its last lines:");
    says(&outcome.stderr, "echo:gpre: another job is being received");
    let outcome = send(&first, board.port(), None);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert_printed(&board.end(), &first);
}

#[test]
fn a_silent_host_is_given_up_and_the_next_one_served() {
    let directory = directory();
    let first = job(&directory, "part.gpre", "cartesian", &part());
    let next = job(&directory, "square.gpre", "cartesian", SQUARE);
    let board = PtyBoard::start(board());
    send_and_kill(&first, &board, 3_000);
    // Half a minute of silence takes a third of a second.
    board.set_hurries(true);
    board.release();
    board.wait_until_said("gpre:stopped ");
    board.set_hurries(false);
    let outcome = send(&next, board.port(), None);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    says(&outcome.stderr, "printed");
    let served = board.end();
    assert_eq!(served.jobs, 2);
    let silence = "echo:gpre: nothing from the host for 30 s";
    assert!(served.said.iter().any(|line| line == silence), "{:#?}", served.said);
}

/// A person at a terminal: lines on the port, without a frame of a job.
fn at_terminal(board: &PtyBoard, said: &[u8], answer: &str) {
    let mut port = std::fs::OpenOptions::new().write(true).open(board.port()).unwrap();
    std::io::Write::write_all(&mut port, said).unwrap();
    board.wait_until_said(answer);
}

/// `M790` by hand: every line is answered, and the port is free again soon, however long a
/// silence was asked for.
#[test]
fn text_lines_during_a_transfer_are_answered() {
    let board = PtyBoard::start(board());
    at_terminal(&board, b"M790 S1000 T3600\n", "gpre:");
    at_terminal(&board, b"M114\n", "echo:gpre: a prepared job is being received");
    board.set_hurries(true);
    board.wait_until_said("echo:gpre: nothing from the host for 30 s");
    board.wait_until_said("gpre:refused");
    board.set_hurries(false);
    at_terminal(&board, b"M114\n", "X:");
    let said = board.end().said;
    assert_eq!(said.iter().filter(|line| *line == "ok").count(), 3, "{said:?}");
}

/// Text after a transfer that ended in mid-frame by silence is a line, and gets its `ok`.
#[test]
fn a_line_after_half_a_frame_is_answered() {
    let board = PtyBoard::start(board());
    at_terminal(&board, b"M790 S1000 T5\n", "gpre:");
    at_terminal(&board, b"\x7eD\x01\x02", "gpre:");
    board.set_hurries(true);
    board.wait_until_said("gpre:refused");
    board.set_hurries(false);
    at_terminal(&board, b"M114\n", "X:");
    let said = board.end().said;
    assert_eq!(said.iter().filter(|line| *line == "ok").count(), 2, "{said:?}");
}
