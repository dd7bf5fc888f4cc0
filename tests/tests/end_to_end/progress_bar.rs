//! The progress bar as a terminal of 80 columns shows it.

use std::fs::File;
use std::io::Read;
use std::process::{Command, Stdio};

use rustix::termios::{Winsize, tcsetwinsize};

use crate::end_to_end::command::{directory, ferrostep, program, repository};
use crate::end_to_end::pty_board::Pty;

/// Drawings of the command: the contents of the last line, each time that it is drawn.
fn drawn(arguments: &[&str]) -> Vec<String> {
    let terminal = Pty::new();
    let size = Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 };
    let side = || File::options().read(true).write(true).open(terminal.path()).unwrap();
    tcsetwinsize(side(), size).unwrap();
    let mut command = Command::new(program());
    command.current_dir(repository()).args(arguments).env("TERM", "xterm");
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(side()).spawn().unwrap();
    drop(command);
    let mut master = File::from(terminal.into_master());
    let reading = std::thread::spawn(move || {
        let mut all = Vec::new();
        // The end of the line is an error here.
        let _ = master.read_to_end(&mut all);
        String::from_utf8_lossy(&all).into_owned()
    });
    let mut result = String::new();
    child.stdout.take().unwrap().read_to_string(&mut result).unwrap();
    assert!(child.wait().unwrap().success());
    let all = reading.join().unwrap();
    all.split(['\r', '\n']).map(plain).filter(|line| !line.trim().is_empty()).collect()
}

/// A text without escape sequences.
fn plain(text: &str) -> String {
    let mut parts = text.split("\x1b[");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |all, part| {
        all + part.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';' || c == '?').get(1..).unwrap_or_default()
    })
}

/// The number before a word.
fn percent(line: &str) -> Option<u32> {
    line.split(" %").next()?.rsplit([' ', '=', '>']).next()?.parse().ok()
}

/// Seconds of the clock after a word.
fn clock(line: &str, word: &str) -> Option<u32> {
    let text = line.split_once(word)?.1.trim_start().split(' ').next()?;
    text.split(':').try_fold(0, |sum, part| Some(sum * 60 + part.parse::<u32>().ok()?))
}

/// The lines that the bar shows: percent, seconds printed, seconds left; some of them lie in the
/// middle of the print. Checks that the share only rises and the remaining time only falls.
#[track_caller]
fn shown(arguments: &[&str]) -> Vec<(u32, u32, u32)> {
    let lines = drawn(arguments);
    assert!(lines.iter().all(|line| line.trim_end().len() <= 80), "{lines:#?}");
    let shown: Vec<_> =
        lines.iter().filter_map(|line| Some((percent(line)?, clock(line, "printed")?, clock(line, "left")?))).collect();
    assert!(shown.iter().any(|(percent, ..)| (5..95).contains(percent)), "{lines:#?}");
    assert!(shown.is_sorted_by_key(|(percent, ..)| *percent), "{lines:#?}");
    assert!(shown.is_sorted_by(|before, after| before.2 >= after.2), "{lines:#?}");
    shown
}

/// All of the file is read in one portion. The printed and the remaining time make up the time of
/// the whole print.
#[test]
fn the_bar_follows_packed_gcode() {
    let whole = ferrostep(["print", "examples/supports.gcode.gz", "--json"]).json()["print_time_s"].as_f64().unwrap();
    for (_, printed, left) in shown(&["print", "examples/supports.gcode.gz"]) {
        assert!((f64::from(printed + left) - whole).abs() < 2.0, "{printed} s printed, {left} s left of {whole} s");
    }
}

/// The header says the time of all motion; 8 s of homing and 2 min of heat are beside it.
#[test]
fn the_bar_of_a_prepared_job_is_exact() {
    let directory = directory();
    let job = directory.path().join("job.gpre");
    let job = job.to_str().unwrap();
    let prepared = ferrostep(["preprocess", "examples/supports.gcode.gz", "-o", job, "--json"]).json();
    let motion_s = prepared["motion_time_s"].as_f64().unwrap();
    for (percent, printed, left) in shown(&["print", job]) {
        let done = motion_s - f64::from(left);
        assert!((f64::from(percent) / 100.0 - done / motion_s).abs() < 0.02, "{percent} % with {left} s left");
        let beside = f64::from(printed) - done;
        assert!((-1.0..150.0).contains(&beside), "{printed} s printed, {left} s left of {motion_s}");
    }
}
