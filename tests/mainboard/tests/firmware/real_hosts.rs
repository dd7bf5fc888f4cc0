//! printcore and OctoPrint print to an image, over the line that `serve` opens for them.
//!
//! They run on this computer's clock, which may be too slow for the machine's: then the machine
//! brakes for want of lines, and its steps are the desk's, but not their times.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use ferrostep_testkit::python;
use serde_json::Value;

use crate::firmware::images::{image_of, root};
use crate::firmware::job::Job;
use crate::firmware::rehearsal::Rehearsal;
use crate::firmware::same_steps::{LINES, Motion};

/// Seconds of the machine for each of ours, as far as this computer keeps up.
const SPEED: &str = "4";

/// One line in ten has a wrong bit, one in a hundred is lost: from when the hosts are connected, as
/// neither can send its first line again. (Of two wrong bits in a line the protocol's checksum
/// misses one pair in eight.)
const BAD_LINE: [&str; 2] = ["flip-line:10%@8", "drop-line:1%@8"];

/// Lines of the job in which a person acts, and after how many of them: in the skirt.
const LINES_WITH_A_PERSON: usize = 160;
const ACTS_AT: usize = 80;

/// An image on the virtual mainboard, at the line of this computer.
struct Served {
    process: Child,
    /// Kept open: the program must be able to write there.
    _messages: BufReader<std::process::ChildStderr>,
    port: PathBuf,
}

impl Served {
    fn bench(name: &str, faults: &[&str]) -> Self {
        let port = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        let mut process = Command::new(env!("CARGO_BIN_EXE_ferrostep-mainboard"))
            .current_dir(root())
            .args([
                "serve",
                "--board",
                "config/boards/bench.toml",
                "--profile",
                "config/profiles/cartesian.toml",
                "--via",
                "uart",
            ])
            .arg("--image")
            .arg(image_of("bench"))
            .args(["--speed", SPEED, "--pty"])
            .arg(&port)
            .args(faults.iter().flat_map(|fault| ["--fault", fault]))
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut messages = BufReader::new(process.stderr.take().unwrap());
        // The line is there before this is said.
        let mut first = String::new();
        messages.read_line(&mut first).unwrap();
        assert!(first.contains(" on "), "{first}");
        Self { process, _messages: messages, port }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // A signal that asks, so that it removes its line.
        let _ = Command::new("kill").arg(self.process.id().to_string()).status();
        let _ = self.process.wait();
    }
}

/// The job as a file for a host.
fn file(name: &str, lines: usize) -> (Job, PathBuf) {
    let job = Job::cube(lines).without_heating().without_homing();
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    // So that its last blocks do not leave look-ahead for want of more.
    std::fs::write(&path, job.text() + "M400\n").unwrap();
    (job, path)
}

/// printcore prints the job, and a person does something meanwhile.
fn printcore(action: &str, lines: usize, faults: &[&str]) -> (Value, Job) {
    let (job, file) = file(&format!("printcore-{action}.gcode"), lines);
    let served = Served::bench(&format!("printcore-{action}"), faults);
    let acts_at = ACTS_AT.to_string();
    let words = [served.port.to_str().unwrap(), file.to_str().unwrap(), action, &acts_at];
    (python::run("printcore_host.py", &words), job)
}

#[track_caller]
fn assert_printed(figures: &Value, job: &Job) {
    let line = figures.as_str().unwrap();
    let (seen, desk) = (Motion::parse(line), Rehearsal::of(job).figures);
    assert_eq!(seen.order_digest, desk.digests.order, "{line}");
    assert_eq!((seen.underruns, seen.planning_slowdowns), (0, 0), "{line}");
    if (seen.starvation_flushes, seen.idle_flushes) == (0, 0) {
        assert_eq!(seen.step_digest, desk.digests.step, "{line}");
    }
}

/// Nothing went wrong on the line, and nothing was refused but what the image heard half of while
/// it started, and the move in which M112 came.
#[track_caller]
fn assert_clean(seen: &Value) {
    assert_eq!((seen["resends"].as_u64(), seen["errors"].as_array().map(Vec::len)), (Some(0), Some(0)), "{seen}");
    let is_known = |refusal: &str| refusal.contains("echo:line 1:") || refusal.ends_with(": motion was stopped");
    assert!(seen["refusals"].as_array().unwrap().iter().all(|refusal| is_known(refusal.as_str().unwrap())), "{seen}");
}

/// Both targets are 0 in the last report.
#[track_caller]
fn assert_cold(report: &Value) {
    let report = report.to_string();
    assert!(report.contains("/0.00 B:") && report.contains("/0.00 @"), "{report}");
}

#[test]
fn printcore_prints_to_an_image() {
    let (seen, job) = printcore("prints", LINES, &[]);
    assert_clean(&seen);
    assert_printed(&seen["figures"], &job);
}

#[test]
fn printcore_prints_to_an_image_over_a_bad_line() {
    let (seen, job) = printcore("prints-over-a-bad-line", LINES_WITH_A_PERSON, &BAD_LINE);
    assert!(seen["resends"].as_u64() > Some(5), "{seen}");
    assert_printed(&seen["figures"], &job);
}

#[test]
fn printcore_pauses_and_resumes_an_image() {
    let (seen, job) = printcore("pauses-and-resumes", LINES_WITH_A_PERSON, &[]);
    assert_clean(&seen);
    let line = seen["figures"].as_str().unwrap();
    assert_eq!(Motion::parse(line).steps, Rehearsal::of(&job).figures.motor_steps, "{line}");
}

#[test]
fn printcore_cancels_and_stops_an_image() {
    let (seen, job) = printcore("cancels", LINES_WITH_A_PERSON, &[]);
    assert_clean(&seen);
    assert_cold(&seen["end"]);
    let line = seen["figures"].as_str().unwrap();
    let (steps, all) = (Motion::parse(line).steps, Rehearsal::of(&job).figures.motor_steps);
    assert!(steps[3] < all[3] * 3 / 4, "{line}: of {all:?}");

    let (seen, _) = printcore("stops", LINES_WITH_A_PERSON, &[]);
    assert!(seen["errors"].to_string().contains("Error:Printer halted. kill() called!"), "{seen}");
    assert_cold(&seen["end"]);
}

#[test]
fn printcore_comes_back_to_an_image_and_prints() {
    let (seen, job) = printcore("reconnects", LINES_WITH_A_PERSON, &[]);
    assert_clean(&seen);
    // The whole file once more, to its last place.
    let last = job.lines().filter(|line| line.starts_with("G1 X")).last().unwrap();
    let mm = |axis| -> f64 { last.split(' ').find_map(|word| word.strip_prefix(axis)).unwrap().parse().unwrap() };
    let place = format!("X:{:.2} Y:{:.2} ", mm('X'), mm('Y'));
    assert!(seen["end"].to_string().contains(&place), "{place}: {seen}");
    let steps = Motion::parse(seen["figures"].as_str().unwrap()).steps;
    assert!(steps[3] > Rehearsal::of(&job).figures.motor_steps[3] * 5 / 4, "{seen}");
}

/// By its buttons: print, pause and resume, cancel, emergency stop, new connection; then a print
/// over a bad line.
#[test]
fn octoprint_prints_pauses_cancels_and_stops_an_image() {
    let (job, file) = file("octoprint.gcode", LINES_WITH_A_PERSON);
    let (served, bad) = (Served::bench("octoprint-line", &[]), Served::bench("octoprint-bad-line", &BAD_LINE));
    let settings = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("octoprint");
    let _ = std::fs::remove_dir_all(&settings);
    let words = [&served.port, &file, &bad.port, &file, &settings].map(|path| path.to_str().unwrap());
    let seen = python::run("octoprint_host.py", &words);
    assert_clean(&seen);
    assert_printed(&seen["printed"], &job);
    assert_cold(&seen["cancelled"]);
    assert_cold(&seen["restarted"]);
    // The filament of a print with a pause in it is that of one without. (The way to the end stops
    // is another one.)
    let filament = Motion::parse(seen["paused"].as_str().unwrap()).steps[3];
    assert!(filament.abs_diff(2 * Rehearsal::of(&job).figures.motor_steps[3]) <= 1, "{seen}");
    assert!(seen["bad_line_resends"].as_u64() > Some(5), "{seen}");
    assert_printed(&seen["bad_line_printed"], &job);
}
