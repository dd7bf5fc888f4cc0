//! Standard output with `--json`: one JSON value and nothing else, for every command
//! that has the option.

use std::collections::BTreeSet;

use ferrostep_black_box::{Dump, Facts, RecordMemory, StepPast};
use ferrostep_step_player::{Past, PastSlot};

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// Moves, a remark, and a command that no printer knows.
const JOB: &str = "G28\nM109 S200\nG1 X20 F6000\nM9999\nG1 X30 Y10 E1\nG1 X10 Y10 E2\nM104 S0\n";

/// The words of each command that has `--json`, by the command's own help.
fn commands() -> BTreeSet<String> {
    let (mut open, mut found) = (vec![Vec::new()], BTreeSet::new());
    while let Some(words) = open.pop() {
        let help = ferrostep(words.iter().map(String::as_str).chain(["--help"])).stdout;
        let below = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
        // The lines of a long description are indented further.
        let names = below.filter_map(|line| line.strip_prefix("  ").filter(|line| !line.starts_with(' ')));
        let names = names.filter_map(|line| line.split(' ').next()).filter(|name| *name != "help");
        open.extend(names.map(|name| words.iter().cloned().chain([name.to_owned()]).collect()));
        if help.lines().any(|line| line.trim_start().starts_with("--json")) {
            found.insert(words.join(" "));
        }
    }
    found
}

/// A step queue that has not played yet.
struct NoSteps;

impl StepPast for NoSteps {
    fn past(&self) -> Past {
        Past { oldest: 0, next: 0, filled: 0, events_left: 0, directions: 0, is_kept: true, positions: [None; 2] }
    }

    fn slot(&self, _number: u32) -> Option<PastSlot> {
        None
    }
}

/// A board's answer to M791.
fn black_box() -> String {
    let memory = RecordMemory::new();
    memory.restart(0);
    let names = ["bench", "cartesian", "0.2.0"];
    let facts = Facts { both_edges: true, tick_hz: 84_000_000, pulse_ticks: 84, now_ms: 9_000, names };
    let mut dump = Dump::new(NoSteps, &memory, facts);
    let (mut log, mut line) = (String::new(), Default::default());
    while dump.next_line(&mut line) {
        log += &format!("{line}\n");
    }
    log
}

#[test]
fn every_command_with_the_option_prints_one_value() {
    let folder = directory();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    file(&folder, "job.gcode", JOB);
    file(&folder, "stops.gcode", "G28\nM112\nG1 X1\n");
    file(&folder, "box.log", black_box());
    let [job, stops, black_box] = ["job.gcode", "stops.gcode", "box.log"].map(path);
    let [trace, prepared, page, plot, profile] = ["a.trace", "a.gpre", "a.html", "a.svg", "a.toml"].map(path);
    let configuration = repository().join("tests/configurations/corexy.cfg");
    let configuration = configuration.to_str().unwrap();
    let runs: &[(&str, &[&str])] = &[
        ("print", &[&job, "--trace", &trace]),
        ("print", &[&job, "--strict"]),
        ("print", &[&stops]),
        ("preprocess", &[&job, "-o", &prepared]),
        ("estimate", &[&job]),
        ("sweep", &[&job, "--acceleration", "500,1000", "--plot", &plot]),
        ("compare", &[&job, "--set", "junction_deviation_mm=0.02", "-o", &page, "--no-open"]),
        ("simulate", &[&job]),
        ("simulate", &[&trace]),
        ("calibrate shaper", &["--waves", "5", "--over-mm", "10.2", "--speed", "100"]),
        ("papers", &["corexy"]),
        ("papers", &["--compare", &job]),
        ("import", &[configuration, "-o", &profile]),
        ("blackbox", &[&black_box]),
        ("post-process", &[&job]),
    ];
    for (command, arguments) in runs {
        let outcome = ferrostep(command.split(' ').chain(arguments.iter().copied()).chain(["--json"]));
        assert!(matches!(outcome.status, Some(0 | 1)), "{command} {arguments:?} {outcome:#?}");
        assert!(outcome.json().is_object(), "{command} {arguments:?} {outcome:#?}");
    }
    // `serve` prints its value when it is switched off: each of its tests (tests/serve/)
    // reads all of it.
    let served = cfg!(unix).then_some("serve");
    let run: BTreeSet<String> = runs.iter().map(|(command, _)| *command).chain(served).map(str::to_owned).collect();
    assert_eq!(commands(), run, "commands with --json, and those that were run");
}
