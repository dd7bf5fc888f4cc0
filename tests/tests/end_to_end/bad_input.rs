//! Wrong files, options and profiles: the command names the mistake, its place and the cure.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::end_to_end::command::{Outcome, directory, example, ferrostep, file, gzip, repository};

/// Homes and moves, so that any effect of a bad line would show.
const PROLOGUE: &str = "G28\nG1 X10 Y20 Z3 F3000\n";

#[track_caller]
fn print(path: &Path) -> Outcome {
    ferrostep(["print".as_ref(), path.as_os_str(), "--json".as_ref()])
}

#[track_caller]
fn position(summary: &Value) -> Value {
    let at = &summary["position_mm"];
    json!([at["x"], at["y"], at["z"], at["e"]])
}

/// Prints [`PROLOGUE`], `line` and one more move; the job must end at `line` and the machine
/// stay where it was.
#[track_caller]
fn stops_at(line: impl AsRef<[u8]>, says: &[&str]) {
    let line = line.as_ref();
    let directory = directory();
    let text = [PROLOGUE.as_bytes(), line, b"\nG1 X99\n"].concat();
    let outcome = print(&file(&directory, "job.gcode", text));
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    for text in ["error:", "job.gcode", "line 3:"].iter().chain(says) {
        assert!(outcome.stderr.contains(text), "{text:?} is missing in {:?}", outcome.stderr);
    }
    let summary = outcome.json();
    assert_eq!(summary["stopped"]["line"], 3);
    for text in says {
        let message = summary["stopped"]["message"].as_str().unwrap();
        assert!(message.contains(text), "{text:?} is missing in {message:?}");
    }
    assert_eq!((&summary["lines"], &summary["moves"]), (&json!(3), &json!(1)));
    assert_eq!(position(&summary), json!([10.0, 20.0, 3.0, 0.0]));
}

#[test]
fn unreadable_lines_stop_the_job() {
    for (line, says) in [
        ("G1 X20 Y1.2.3", ["G1 X20 Y1.2.3", "Y: \"1.2.3\" is not a number, expected"]),
        ("G1 X20 Y--4", ["G1 X20 Y--4", "Y: \"--4\" is not a number, expected"]),
        ("G1 Xnan Y20", ["G1 Xnan Y20", "X: \"nan\" is not a number, expected"]),
        ("M104 Snan", ["M104 Snan", "S: \"nan\" is not a number, expected"]),
        ("G1 X20 #4", ["G1 X20 #4", "unexpected character '#', expected"]),
        ("G1 X99999999999", ["G1 X99999999999", "X: 99999999999 is too large, expected"]),
        ("G2 X20 Y20", ["G2 X20 Y20", "expected I and J, or R"]),
        ("G18", ["\"G18\"", "use G17 (XY)"]),
        ("M106 S-1", ["M106 S-1", "S: -1 is out of range, expected 0 to 255"]),
        ("M221 S0", ["M221 S0", "S: 0 is out of range, expected more than 0"]),
        ("G1 20 Y5", ["\"G1 20 Y5\"", "unexpected character '2', expected a letter"]),
        ("X20 Y5", ["\"X20 Y5\"", "a coordinate without a command: write G1"]),
        ("N3 G1 X20*5", ["G1 X20", "checksum mismatch"]),
        ("N3 G1 X20*x", ["G1 X20", "malformed checksum, expected"]),
    ] {
        stops_at(line, &says);
    }
}

/// A job without these commands would be printed at another place, or with another
/// amount of filament.
#[test]
fn commands_that_must_not_be_skipped_stop_the_job() {
    for (line, says) in [
        ("G5 X20 Y20 I1 J1 P1 Q1", ["\"G5", "G5: not supported, the curve would be missing; let the slicer"]),
        ("G5.1 X20 Y20 I1 J1", ["\"G5.1", "not supported, the move would be missing; use"]),
        ("G2 X10 Y20 I5 P2", ["\"G2", "G2 and G3 with P other than 0 and 1: not supported"]),
        ("G10 L2 P1 X5", ["\"G10", "not supported, the part would lie elsewhere"]),
        ("G52 X5", ["\"G52", "G52: not supported"]),
        ("G53 G1 X5", ["\"G53", "G53 with a move: not supported"]),
        ("G55", ["\"G55", "G55 to G59: not supported"]),
        ("G68 R45", ["\"G68", "G68: not supported"]),
        ("G92.1", ["\"G92.1", "G92.x: not supported"]),
        ("M200 D1.75", ["\"M200", "volumes in E would be read as mm of filament; switch"]),
        ("M200 S1", ["\"M200", "M200: not supported"]),
    ] {
        stops_at(line, &says);
    }
}

#[test]
fn impossible_commands_stop_the_job() {
    for (line, says) in [
        ("G1 X20 E5", ["G1 X20 E5", "cold extrusion prevented, the nozzle is at 22.0 C, expected at least 170 C"]),
        ("G1 Z1 E-1", ["G1 Z1 E-1", "cold extrusion prevented"]),
        ("G10", ["\"G10\"", "cold extrusion prevented"]),
        ("G2 X20 Y20 I5 J0 E1", ["G2 X20", "cold extrusion prevented"]),
        ("G1 X20 Y5000.001", ["G1 X20 Y5000.001", "coordinates are limited to +-5 m"]),
        ("G1 X-6000", ["G1 X-6000", "coordinates are limited to +-5 m"]),
        ("G1 X20 F0.001", ["G1 X20 F0.001", "expected at least 0.6 mm/min"]),
        ("G2 X20 Y20 I1 J0", ["G2 X20 Y20 I1 J0", "both must be the same"]),
        ("G2 X20 Y20 R1", ["G2 X20 Y20 R1", "R: an arc of radius 1.000 mm"]),
        ("G2 X10 Y20 R5", ["G2 X10 Y20 R5", "give I and J for a full circle"]),
        ("M104 S500", ["M104 S500", "S: 500 C is too hot, expected less than 275 C"]),
        ("M104 S274.99999999", ["M104 S274.99999999", "is too hot"]),
        ("M104 S275", ["M104 S275", "S: 275 C is too hot, expected less than 275 C"]),
        ("M109 S400", ["M109 S400", "S: 400 C is too hot, expected less than 275 C"]),
        ("M140 S200", ["M140 S200", "S: 200 C is too hot, expected less than 125 C"]),
        ("M190 R126", ["M190 R126", "S: 126 C is too hot"]),
        ("M205 J50", ["M205 J50", "J: 50 is out of range, expected"]),
        ("T1", ["\"T1\"", "one extruder, T0: slice the job for one"]),
    ] {
        stops_at(line, &says);
    }
}

#[test]
fn lines_that_are_not_text_stop_the_job() {
    stops_at(format!("G1 X20{}", " ".repeat(300)), &["expected at most 256 characters"]);
    stops_at(format!("G1 X20 F{}", "1".repeat(300)), &["expected at most 256 characters"]);
    stops_at(b"G1 X20 Y\xff", &["not text: byte 0xff", "expected UTF-8"]);
    // Comments may hold anything, and be of any length.
    let directory = directory();
    let long = "x".repeat(100_000);
    // The text of a message may do so as well.
    let message = [b"M117 Gr\xfc\xdfe ", long.as_bytes(), b"\nM118 \xff\n"].concat();
    let comment = [PROLOGUE.as_bytes(), b"G1 X20 ; \xff\xfe", long.as_bytes(), b"\n", &message].concat();
    let outcome = print(&file(&directory, "comment.gcode", comment));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert_eq!(outcome.json()["position_mm"]["x"], 20.0);
}

#[test]
fn the_last_line_needs_no_line_end() {
    let directory = directory();
    let outcome = print(&file(&directory, "job.gcode", format!("{PROLOGUE}G1 X20 Y-")));
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    assert!(outcome.stderr.contains("line 3: \"G1 X20 Y-\": Y: \"-\" is not a number"), "{outcome:#?}");
    assert_eq!(position(&outcome.json()), json!([10.0, 20.0, 3.0, 0.0]));
}

#[test]
fn bytes_that_are_not_text_late_in_the_file() {
    let directory = directory();
    let mut text = PROLOGUE.repeat(5_000).into_bytes();
    text.extend(b"G1 X20\0\nG1 X99\n");
    let outcome = print(&file(&directory, "job.gcode", text));
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    assert!(outcome.stderr.contains("line 10001:") && outcome.stderr.contains("byte 0x00"), "{outcome:#?}");
    assert_eq!(position(&outcome.json()), json!([10.0, 20.0, 3.0, 0.0]));
}

/// Cold extrusion is refused also if the filament is pushed bit by bit along an arc.
#[test]
fn too_much_filament_in_a_move_stops_the_job() {
    let directory = directory();
    for line in ["G1 X20 E1500", "G1 E-1001", "G2 X20 Y20 I5 J0 E9999999"] {
        let outcome = print(&file(&directory, "job.gcode", format!("M302 P1\n{PROLOGUE}{line}\nG1 X99\n")));
        assert_eq!(outcome.status, Some(1), "{outcome:#?}");
        assert!(outcome.stderr.contains(&format!("line 4: {line:?}: E: too long extrusion prevented")), "{outcome:#?}");
        assert_eq!(position(&outcome.json()), json!([10.0, 20.0, 3.0, 0.0]), "{line}");
    }
}

#[test]
fn m112_in_a_file_stops_the_job() {
    let directory = directory();
    let outcome = print(&file(&directory, "job.gcode", format!("{PROLOGUE}M112\nG1 X99\n")));
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    assert!(outcome.stderr.contains("line 3:") && outcome.stderr.contains("M999"), "{outcome:#?}");
    assert!(outcome.json()["position_mm"]["x"].as_f64().unwrap() <= 10.0);
}

#[test]
fn damaged_gzip_is_refused() {
    let directory = directory();
    let packed = gzip(&example("cube.gcode"));
    let cut = print(&file(&directory, "cut.gcode.gz", &packed[..packed.len() / 2]));
    assert_eq!(cut.status, Some(1), "{cut:#?}");
    let summary = cut.json();
    let line = summary["stopped"]["line"].as_u64().unwrap();
    assert!(line > 100, "most lines are printed: {line}");
    assert!(summary["moves"].as_u64().unwrap() > 100, "{summary}");
    assert!(cut.stderr.contains(&format!("after line {line}:")) && cut.stderr.contains("cut.gcode.gz"), "{cut:#?}");

    let mut flipped = packed.clone();
    let checksum = packed.len() - 8;
    flipped[checksum] ^= 1;
    let flipped = print(&file(&directory, "flipped.gcode.gz", flipped));
    assert_eq!(flipped.status, Some(1), "{flipped:#?}");
    assert!(flipped.json()["stopped"]["message"].as_str().unwrap().contains("cannot be read"), "{flipped:#?}");

    for length in [2, 5, 12] {
        let head = print(&file(&directory, "head.gcode.gz", &packed[..length]));
        refused(&head, &["head.gcode.gz"]);
    }
}

/// Checks that the job did not start: nothing on standard output, the reason on standard error.
#[track_caller]
fn refused(outcome: &Outcome, says: &[&str]) {
    assert_eq!((outcome.status, outcome.stdout.as_str()), (Some(2), ""), "{outcome:#?}");
    for text in ["error:"].iter().chain(says) {
        assert!(outcome.stderr.contains(text), "{text:?} is missing in {:?}", outcome.stderr);
    }
}

#[test]
fn files_that_are_not_jobs_are_refused() {
    let directory = directory();
    refused(&print(&directory.path().join("missing.gcode")), &["missing.gcode", "cannot be read"]);
    refused(&print(directory.path()), &["cannot be read"]);
    refused(
        &print(&file(&directory, "empty.gcode", "")),
        &["empty.gcode", "the file is empty: expected G-code or a prepared job"],
    );
    refused(&print(&file(&directory, "empty.gz", gzip(b""))), &["empty.gz", "the file is empty"]);
    let binary = b"\x7fELF\x02\x01\x01\0\0\0\0\0\0";
    refused(&print(&file(&directory, "binary.gcode", binary)), &["not a text file", "expected G-code"]);
    refused(&print(&file(&directory, "binary.gz", gzip(binary))), &["not a text file"]);
    refused(&print(&file(&directory, "nul.gcode", b"G28\nG1 X5\0\n")), &["byte 0x00 at offset 9"]);
    let estimate = ferrostep(["estimate".as_ref(), directory.path().join("missing.gcode").as_os_str()]);
    refused(&estimate, &["missing.gcode"]);
}

#[test]
fn a_job_without_commands_is_done() {
    let directory = directory();
    for text in ["\n", "; only a comment", "\r\n\r\n", "G21\n"] {
        let outcome = print(&file(&directory, "job.gcode", text));
        assert_eq!(outcome.status, Some(0), "{text:?}: {outcome:#?}");
        let summary = outcome.json();
        assert_eq!((&summary["moves"], position(&summary)), (&json!(0), json!([0.0, 0.0, 0.0, 0.0])), "{text:?}");
    }
}

#[test]
fn unknown_options_are_refused() {
    let job = "examples/cube.gcode";
    let cases: [&[&str]; 8] = [
        &["print"],
        &["polish", job],
        &["print", job, "--fast"],
        &["print", job, "extra"],
        &["print", job, "--look-ahead", "1"],
        &["print", job, "--look-ahead", "many"],
        &["print", job, "--trace"],
        &["print", job, "--json", "--trace", "no/such/directory/trace"],
    ];
    for arguments in cases {
        let outcome = ferrostep(arguments);
        assert_eq!((outcome.status, outcome.stdout.as_str()), (Some(2), ""), "{arguments:?}: {outcome:#?}");
        assert!(!outcome.stderr.is_empty(), "{arguments:?}");
    }
}

#[test]
fn wrong_profiles_are_refused() {
    let directory = directory();
    let cartesian = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let with = |profile: &Path| {
        ferrostep(["print".as_ref(), "examples/cube.gcode".as_ref(), "--profile".as_ref(), profile.as_os_str()])
    };
    refused(&with(Path::new("delta")), &["delta"]);
    refused(&with(directory.path()), &["cannot read profile"]);
    for (from, to, says) in [
        ("jerk_mm_per_s3 = 10000", "jerk_mm_per_s3 = 10000\nwarp_factor = 9", ["warp_factor", ":"]),
        ("junction_deviation_mm = 0.1\n", "", ["junction_deviation_mm", "missing"]),
        ("y = 80, z = 400", "z = 400", ["y", "missing"]),
        ("steps_per_mm = { x = 80", "steps_per_mm = { x = 0", ["steps_per_mm", "0"]),
        ("steps_per_mm = { x = 80", "steps_per_mm = { x = -80", ["steps_per_mm", "-80"]),
        ("steps_per_mm = { x = 80", "steps_per_mm = { x = nan", ["steps_per_mm", "x"]),
        ("junction_deviation_mm = 0.1", "junction_deviation_mm = \"wide\"", ["junction_deviation_mm", "wide"]),
        ("kinematics = \"cartesian\"", "kinematics = \"delta\"", ["delta", "corexy"]),
        ("max_celsius = 275", "max_celsius = 1e9", ["max_celsius", ""]),
        ("end = \"min\"", "end = \"middle\"", ["middle", "min"]),
        ("jerk_mm_per_s3 = 10000", "jerk_mm_per_s3 = = 10000", ["profile.toml", ""]),
    ] {
        let changed = cartesian.replacen(from, to, 1);
        assert_ne!(changed, cartesian, "{from}");
        let outcome = with(&file(&directory, "profile.toml", changed));
        refused(&outcome, &["profile.toml", says[0], says[1]]);
    }
    refused(&with(&file(&directory, "latin1.toml", b"name = \"\xe9\"\n")), &["latin1.toml"]);
}

#[test]
fn soft_limits_hold_homed_axes() {
    let directory = directory();
    let run = |text: &str| {
        let outcome = print(&file(&directory, "job.gcode", text));
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        let echoes = outcome.stderr.lines().filter(|line| line.starts_with("echo:")).map(str::to_owned).collect();
        let summary = outcome.json();
        (position(&summary), summary["clamped_moves"].as_u64().unwrap(), echoes)
    };
    let (at, clamped, echoes): (_, _, Vec<String>) = run("G28\nG1 Y7 F6000\nG1 X500\n");
    assert_eq!((at, clamped, echoes.len()), (json!([200.0, 7.0, 0.0, 0.0]), 1, 1), "{echoes:?}");
    assert!(echoes[0].contains("line 3") && echoes[0].contains(" X ") && !echoes[0].contains(" Y "), "{echoes:?}");

    let (at, clamped, echoes) = run("G28\nG1 X500 Y-3 F6000\nG1 X250 Y5\nG1 X150\n");
    assert_eq!((at, clamped, echoes.len()), (json!([150.0, 5.0, 0.0, 0.0]), 2, 2), "{echoes:?}");
    assert!(echoes[0].contains(" X ") && echoes[0].contains(" Y "), "{echoes:?}");

    // The limits are those of the machine, not of the coordinates.
    let (at, clamped, _) = run("G28\nG1 X150 F6000\nG92 X0\nG1 X100\n");
    assert_eq!((at, clamped), (json!([50.0, 0.0, 0.0, 0.0]), 1));

    for unlimited in ["G1 X500 F6000\n", "G28 Y\nG1 X500 F6000\n", "G28\nM211 S0\nG1 X500 F6000\n"] {
        let (at, clamped, echoes) = run(unlimited);
        assert_eq!((&at[0], clamped, echoes.len()), (&json!(500.0), 0, 0), "{unlimited}: {echoes:?}");
    }
}

#[test]
fn unknown_commands_are_listed_once_and_skipped() {
    let directory = directory();
    let text = "G28\nM7777 X1\nG1 X5 F3000\nM7777 X1\nG123\nM7777 X2\nO100\n";
    let outcome = print(&file(&directory, "job.gcode", text));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let summary = outcome.json();
    assert_eq!(summary["unknown_commands"], json!(["G123", "M7777 X1", "M7777 X2", "O100"]));
    let echoes: Vec<_> = outcome.stderr.lines().collect();
    let unknown = |text: &str| format!("echo:Unknown command: \"{text}\"");
    assert_eq!(echoes, ["M7777 X1", "G123", "M7777 X2", "O100"].map(unknown));
    assert_eq!(position(&summary), json!([5.0, 0.0, 0.0, 0.0]));
}

/// The likeliest name of a key or a profile is suggested.
#[test]
fn misspelt_names_are_answered_with_the_likeliest() {
    let directory = directory();
    let job = file(&directory, "job.gcode", "G28\n");
    let text = fs::read_to_string(repository().join("config/profiles/corexy.toml")).unwrap();
    let profile = file(&directory, "mine.toml", text.replace("\nsteps_per_mm", "\nstep_per_mm"));
    for (profile, expected) in [
        (profile.to_str().unwrap(), "unknown key \"step_per_mm\": did you mean \"steps_per_mm\"?"),
        ("Prusa-MINI", "(cartesian, corexy, prusa-mini): did you mean prusa-mini?"),
        ("corxy", "did you mean corexy?"),
    ] {
        let outcome = ferrostep(["print", job.to_str().unwrap(), "--profile", profile]);
        assert_eq!(outcome.status, Some(2), "{outcome:#?}");
        assert!(outcome.stderr.contains(expected), "{outcome:#?}");
    }
}

/// A line that cannot be read is not shown as an empty one.
#[test]
fn a_line_that_is_no_text_is_named_without_a_text() {
    let directory = directory();
    let outcome = ferrostep(["print".as_ref(), file(&directory, "job.gcode", b"G28\nG1 X\xff5\n").as_os_str()]);
    assert!(outcome.stderr.contains("job.gcode: line 2: not text: byte 0xff"), "{outcome:#?}");
}

/// A file of comments alone is hardly the one that was meant.
#[test]
fn a_file_of_comments_is_remarked() {
    let directory = directory();
    let job = file(&directory, "job.gcode", "; only\n; comments\n");
    let outcome = ferrostep(["print".as_ref(), job.as_os_str(), "--strict".as_ref()]);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    assert!(outcome.stdout.contains("remark       no line of the file is a command"), "{outcome:#?}");
    assert!(!outcome.stdout.contains("times faster"), "{outcome:#?}");
    assert_eq!(print(&job).json()["remarks"][0]["kind"], "no_commands");
}
