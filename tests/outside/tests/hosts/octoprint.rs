//! OctoPrint, without its window, at the served printer.

use ferrostep_testkit::python;
use ferrostep_testkit::served::printer::Printer;
use ferrostep_testkit::served::{part, print_of_cube, print_of_lines};

/// A value of M797's line.
fn figure<'a>(line: &'a str, name: &str) -> &'a str {
    let value = line.split_once(&format!("{name}:")).unwrap_or_else(|| panic!("no {name} in {line}")).1;
    value.split(' ').next().unwrap()
}

/// Print, pause and resume, cancel, emergency stop, new connection: by its buttons. And a print
/// over a line on which one line in a hundred is lost and another has a wrong bit.
#[test]
fn octoprint_prints_pauses_cancels_and_stops() {
    let printer = Printer::at_pty(&["--speed", "max"]);
    // One start of OctoPrint for both: it takes half a minute. The damage begins in the print,
    // since OctoPrint cannot send its first line, M110, again.
    let bad_line = Printer::at_pty(&["--speed", "max", "--fault", "flip-line:1%@100", "--fault", "drop-line:1%@100"]);
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let (file, mut lines) = (folder.path().join("part.gcode"), part());
    lines.push("M400".to_owned());
    std::fs::write(&file, lines.join("\n")).unwrap();
    let [port, bad_port] = [&printer, &bad_line].map(|printer| printer.port().to_str().unwrap());
    let [part, settings] = [file.as_path(), folder.path()].map(|path| path.to_str().unwrap());
    let seen = python::run("octoprint_host.py", &[port, "examples/cube.gcode", bad_port, part, settings]);
    let text = |key: &str| seen[key].as_str().unwrap_or_else(|| panic!("no {key} in {seen}"));

    let first = text("printed");
    assert_eq!(figure(first, "step_digest"), print_of_cube()["step_digest"], "{seen}");
    assert_eq!(figure(first, "order_digest"), print_of_cube()["order_digest"]);
    assert_eq!(figure(first, "idle_flushes"), "0");
    assert_eq!((seen["resends"].as_u64(), seen["errors"].as_array().map(Vec::len)), (Some(0), Some(0)), "{seen}");
    assert_eq!(seen["refusals"].as_array().map(Vec::len), Some(0), "{seen}");

    // The filament of a print with a pause in it is that of one without. (The way to the end stops
    // is another one.)
    let filament = |line: &str| figure(line, "E").parse::<i64>().unwrap();
    assert!((filament(text("paused")) - 2 * filament(first)).abs() <= 1, "{seen}");

    let is_cold = |line: &str| line.contains("/0.00 B:") && line.contains("/0.00 @");
    assert!(is_cold(text("cancelled")) && is_cold(text("restarted")), "{seen}");
    assert!(seen["bad_line_resends"].as_u64() > Some(10), "{seen}");
    let (printed_part, end) = (print_of_lines(&lines), bad_line.end());
    // OctoPrint asks for a lost line after 2 s at the soonest, by when the printer has braked: its
    // steps are the same, not their times.
    for key in ["order_digest", "motor_steps", "position_mm", "filament_mm", "merged_moves", "underruns"] {
        assert_eq!(end[key], printed_part[key], "{key}: {seen}");
    }
    assert!(printer.end()["moves"].as_u64() > print_of_cube()["moves"].as_u64().map(|moves| 2 * moves));
}
