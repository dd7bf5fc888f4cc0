//! printcore, the host behind Pronterface, at the served printer.

use std::path::Path;

use ferrostep_testkit::program::repository;
use ferrostep_testkit::python;
use ferrostep_testkit::served::printer::Printer;
use ferrostep_testkit::served::{CUBE, print_of, print_of_cube};
use serde_json::{Value, json};

/// The host's record of a print, and the printer's.
struct Print {
    host: Value,
    printer: Value,
}

fn print(action: &str, arguments: &[&str]) -> Print {
    print_file(CUBE, action, arguments)
}

fn print_file(file: &str, action: &str, arguments: &[&str]) -> Print {
    let printer = Printer::at_pty(&[&["--speed", "max"], arguments].concat());
    let host = python::run("printcore_host.py", &[printer.port().to_str().unwrap(), file, action]);
    Print { host, printer: printer.end() }
}

#[track_caller]
fn assert_same(print: &Print, keys: &[&str]) {
    for key in keys {
        assert_eq!(print.printer[*key], print_of_cube()[*key], "{key}: {} {}", print.host, print.printer);
    }
}

const STEPS: [&str; 4] = ["motor_steps", "position_mm", "filament_mm", "clamped_moves"];

#[test]
fn a_print_makes_the_steps_of_print() {
    let print = print("prints", &[]);
    assert_eq!(print.host["errors"], json!([]));
    assert_eq!(print.host["resends"], 0);
    assert_eq!(print.host["refusals"], json!([]));
    assert_same(&print, &["step_digest", "order_digest", "underruns", "starvation_flushes", "moves"]);
    assert_same(&print, &STEPS);
}

/// One line in ten has a wrong bit, one in a hundred is lost.
#[test]
fn a_bad_line_costs_time_and_no_step() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let part = folder.path().join("part.gcode");
    let cube = std::fs::read_to_string(repository().join(CUBE)).unwrap();
    // Each lost line costs half a second.
    std::fs::write(&part, cube.lines().take(2_000).collect::<Vec<_>>().join("\n")).unwrap();
    let part = part.to_str().unwrap();
    let faults = ["--fault", "flip-line:10%@100", "--fault", "drop-line:1%@100"];
    let print = print_file(part, "prints-over-a-bad-line", &faults);
    assert!(print.host["resends"].as_u64().unwrap() > 100, "{}", print.host);
    assert!(print.host["asked"].as_u64().unwrap() > 5, "{}", print.host);
    let expected = print_of(Path::new(part));
    for key in ["step_digest", "order_digest", "motor_steps", "position_mm", "filament_mm"] {
        assert_eq!(print.printer[key], expected[key], "{key}: {}", print.host);
    }
}

#[test]
fn a_pause_costs_no_step() {
    let print = print("pauses-and-resumes", &[]);
    assert_eq!(print.host["errors"], json!([]));
    assert_same(&print, &STEPS);
}

#[test]
fn a_cancelled_print_ends_and_the_printer_goes_on() {
    let print = print("cancels", &[]);
    assert_eq!(print.host["errors"], json!([]));
    let end = print.host["end"].to_string();
    assert!(end.contains("/0.00 B:") && end.contains("/0.00 @"), "both heaters are off: {end}");
    let steps = |summary: &Value| summary["motor_steps"]["x"].as_u64().unwrap();
    assert!(steps(&print.printer) < steps(print_of_cube()) / 2);
}

#[test]
fn an_emergency_stop_switches_everything_off_until_the_restart() {
    let print = print("stops", &[]);
    let end = print.host["end"].to_string();
    assert!(end.contains("/0.00 B:") && end.contains("/0.00 @"), "both heaters are off: {end}");
    let errors = print.host["errors"].to_string();
    assert!(errors.contains("Error:Printer halted. kill() called!"), "{errors}");
}

#[test]
fn a_host_that_comes_back_can_print() {
    let print = print("reconnects", &[]);
    assert_eq!(print.host["errors"], json!([]));
    assert_eq!(print.host["refusals"], json!([]));
    assert_eq!(print.printer["position_mm"], print_of_cube()["position_mm"]);
}
