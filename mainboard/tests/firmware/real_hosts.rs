//! printcore and OctoPrint print to an image, over the line that `serve` opens for them.
//!
//! They run on this computer's clock, which may be too slow for the machine's: then the machine brakes for want of lines, and its
//! steps are the desk's, but not their times.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;

use serde_json::Value;

use crate::images::{image_of, root};
use crate::job::Job;
use crate::rehearsal::Rehearsal;
use crate::same_steps::{LINES, Motion};

/// Seconds of the machine for each of ours, as far as this computer keeps up.
const SPEED: &str = "4";

/// An image on the virtual mainboard, at the line of this computer.
struct Served {
    process: Child,
    /// Kept open: the program must be able to write there.
    _messages: BufReader<std::process::ChildStderr>,
    port: PathBuf,
}

impl Served {
    fn bench(name: &str) -> Self {
        let port = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        let mut process = Command::new(env!("CARGO_BIN_EXE_ferrostep-mainboard"))
            .current_dir(root())
            .args(["serve", "--board", "boards/bench.toml", "--profile", "profiles/cartesian.toml", "--via", "uart"])
            .arg("--image")
            .arg(image_of("bench"))
            .args(["--speed", SPEED, "--pty"])
            .arg(&port)
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

/// The hosts' Python.
fn python() -> &'static Path {
    static PYTHON: OnceLock<PathBuf> = OnceLock::new();
    PYTHON.get_or_init(|| {
        let folder = std::env::var("FERROSTEP_HOSTS").unwrap_or_else(|_| {
            let output = Command::new("cargo").args(["xtask", "hosts"]).current_dir(root()).output().unwrap();
            assert!(output.status.success(), "cargo xtask hosts: {}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8(output.stdout).unwrap().lines().next().unwrap().to_owned()
        });
        Path::new(&folder).join("bin/python")
    })
}

/// Runs a host of `tests/hosts/`; what it has seen.
fn run(script: &str, arguments: &[&str]) -> Value {
    let script = root().join("tests/hosts").join(script);
    let output = Command::new(python()).arg(script).args(arguments).current_dir(root()).output().unwrap();
    let (said, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{arguments:?}: {said}{errors}");
    serde_json::from_str(said.lines().next_back().unwrap_or_default())
        .unwrap_or_else(|error| panic!("{error} in {said}"))
}

/// The job as a file for a host.
fn file(name: &str) -> (Job, PathBuf) {
    let job = Job::cube(LINES).without_heating();
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, job.text()).unwrap();
    (job, path)
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

#[test]
fn printcore_prints_to_an_image() {
    let (job, file) = file("printcore.gcode");
    let served = Served::bench("printcore-line");
    let seen = run("printcore_host.py", &[served.port.to_str().unwrap(), file.to_str().unwrap(), "prints"]);
    assert_eq!((seen["resends"].as_u64(), seen["errors"].as_array().map(Vec::len)), (Some(0), Some(0)), "{seen}");
    assert_printed(&seen["figures"], &job);
}

#[test]
fn octoprint_prints_to_an_image() {
    let (job, file) = file("octoprint.gcode");
    let served = Served::bench("octoprint-line");
    let settings = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("octoprint");
    let _ = std::fs::remove_dir_all(&settings);
    let words = [&served.port, &file, &settings].map(|path| path.to_str().unwrap());
    let seen = run("octoprint_host.py", &words);
    assert_eq!((seen["resends"].as_u64(), seen["errors"].as_array().map(Vec::len)), (Some(0), Some(0)), "{seen}");
    assert_printed(&seen["printed"], &job);
}
