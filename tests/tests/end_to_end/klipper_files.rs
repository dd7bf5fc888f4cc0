//! Files that people slice for Klipper: macros that the profile lacks, and commands of state, are
//! stood in for on the desk.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::end_to_end::command::{Outcome, directory, ferrostep, file, repository};

/// The files in the manner of slicers for Klipper.
fn cases() -> Vec<PathBuf> {
    let folder = repository().join("tests/cases/klipper-files");
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

fn run_file(command: &str, job: &Path, more: &[&str]) -> Outcome {
    ferrostep([command, job.to_str().unwrap(), "--json"].iter().chain(more))
}

fn run(command: &str, text: &str, more: &[&str]) -> Outcome {
    let directory = directory();
    run_file(command, &file(&directory, "job.gcode", text), more)
}

/// The summary of a print that ends.
#[track_caller]
fn prints(text: &str) -> Value {
    let outcome = run("print", text, &[]);
    assert_eq!(outcome.status, Some(0), "{text}: {outcome:#?}");
    outcome.json()
}

/// The remarks of a kind.
fn remarks(summary: &Value, kind: &str) -> Vec<String> {
    let remarks = summary["remarks"].as_array().unwrap().iter();
    let of_kind = remarks.filter(|remark| remark["kind"] == kind);
    of_kind.map(|remark| remark["message"].as_str().unwrap().to_owned()).collect()
}

/// The steps and their order.
fn motion(summary: &Value) -> [Value; 3] {
    ["motor_steps", "order_digest", "position_mm"].map(|key| summary[key].clone())
}

#[test]
fn files_for_klipper_end_with_a_time_and_say_what_was_assumed() {
    let expected = [
        ("bare-macro", vec!["homed, the nozzle where the next move begins; --strict"], 0),
        ("k1-creality", vec!["nozzle at 220 C (by its words); bed at 55 C (by its words)"], 1),
        ("macros-in-the-middle", vec!["nozzle at 200 C (by its words); bed at 50 C"], 1),
        ("mainsail-orca", vec!["nozzle at 215 C (by its words); bed at 60 C (by its words)"], 1),
        ("temperatures-in-comments", vec!["nozzle at 225 C (by the slicer's comments); bed at 65 C"], 1),
        ("temperatures-nowhere", vec!["nozzle at 180 C (a little above the lowest for extruding"], 1),
        ("two-macros", vec!["nozzle at 230 C (by its words); bed at 70 C (by its words)"], 1),
        ("voron-superslicer", vec!["nozzle at 240 C (by its words); bed at 100 C (by its words)"], 1),
    ];
    let cases = cases();
    let names: Vec<_> = cases.iter().map(|case| case.file_stem().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, expected.iter().map(|(name, ..)| *name).collect::<Vec<_>>());
    for (case, (name, assumed, strict_status)) in cases.iter().zip(&expected) {
        let (printed, estimated) = (run_file("print", case, &[]), run_file("estimate", case, &[]));
        for outcome in [&printed, &estimated] {
            assert_eq!(outcome.status, Some(0), "{name}: {outcome:#?}");
            let said = remarks(&outcome.json(), "assumed");
            assert_eq!(said.len(), assumed.len(), "{name}: {said:?}");
            for (said, assumed) in said.iter().zip(assumed) {
                assert!(said.contains(assumed) && said.contains("--strict-macros"), "{name}: {said}");
            }
        }
        let (printed, estimated) = (printed.json(), estimated.json());
        let layers = printed["layers"].as_u64().unwrap();
        assert!(printed["motion_time_s"].as_f64().unwrap() > 2.0 && layers > 0, "{name}: {printed:#}");
        let times_s = [&printed, &estimated].map(|summary| summary["motion_time_s"].as_f64().unwrap());
        assert!((times_s[0] - times_s[1]).abs() < 1e-6 * times_s[0], "{name}: {times_s:?}");
        assert_eq!(printed["moves"], estimated["moves"], "{name}");
        assert!(remarks(&printed, "not_homed").is_empty(), "{name}");
        let strict = run_file("estimate", case, &["--strict-macros"]);
        // A file that heats by itself prints without its start.
        assert_eq!(strict.status, Some(*strict_status), "{name}: {strict:#?}");
    }
}

#[test]
fn the_start_moves_nothing_and_the_next_move_says_where_it_begins() {
    let steps = |start: &str| {
        let text = format!("{start}\nG90\nM83\nG1 X20 Y30 F6000\nG1 Z0.2 F600\nG1 X60 E2 F1200\nG1 Y35 E1\n");
        prints(&text)["motor_steps"].clone()
    };
    // 40 mm of X at 80 steps/mm and 5 mm of Y.
    let drawn = steps("START_PRINT EXTRUDER_TEMP=200");
    assert_eq!((&drawn["x"], &drawn["y"], &drawn["z"]), (&3200.into(), &400.into(), &0.into()));
    assert_eq!(steps("start_print extruder_temp=200"), drawn);
    assert_eq!(steps("MY_OWN_BEGINNING HOTEND=200 BED=0"), drawn);
    // Relative moves and arcs begin at home.
    let relative = prints("PRINT_START NOZZLE=200\nG91\nG1 X10 F6000\nG90\nG1 X30\n");
    assert_eq!(relative["motor_steps"]["x"], 2400);
    let inches = prints("PRINT_START NOZZLE=200\nG20\nG1 X1 Y1 F300\nG1 X2\n");
    assert_eq!((&inches["motor_steps"]["x"], &inches["motor_steps"]["y"]), (&2032.into(), &0.into()));
}

#[test]
fn a_machine_that_the_file_has_started_itself_stays_as_it_is() {
    let own = "G28\nM190 S40\nM109 S200\nM83\n";
    let rest = "G1 X20 Y20 Z0.2 F6000\nG1 X60 E2 F1200\n";
    let plain = prints(&format!("{own}{rest}"));
    let unknown = prints(&format!("{own}LINE_PURGE\n{rest}"));
    assert_eq!(motion(&unknown), motion(&plain));
    assert_eq!((remarks(&unknown, "assumed"), remarks(&unknown, "unknown").len()), (vec![], 1));
    let known = prints(&format!("{own}START_PRINT\n{rest}"));
    assert_eq!(motion(&known), motion(&plain));
    let said = remarks(&known, "no_effect");
    assert_eq!(said, ["START_PRINT: other lines home and heat the machine: no effect"]);
    // Homed and heated after it.
    let before = prints(&format!("LINE_PURGE\n{own}{rest}"));
    assert_eq!((motion(&before), remarks(&before, "assumed")), (motion(&plain), vec![]));
    // Homed once more: the axes only counted as homed.
    let again = prints("START_PRINT EXTRUDER=200\nG1 X30 Y30 Z5 F6000\nG28\nG1 X20 F6000\nG28 X\nG1 X10\n");
    assert_eq!((&again["position_mm"]["x"], remarks(&again, "not_homed").len()), (&10.0.into(), 0));
    // Klipper's own commands start no machine, nor does a macro after the first filament.
    for text in ["BED_MESH_PROFILE LOAD=default\nG28\nG1 X5 E1 F600\n", "SET_GCODE_VARIABLE MACRO=A\nG1 X5 E1 F600\n"] {
        assert_eq!(run("print", text, &[]).status, Some(1), "{text}");
    }
    let late = format!("{own}{rest}M104 S0\nM109 R50\nSTART_PRINT EXTRUDER=210\nG1 X70 E1\n");
    let outcome = run("print", &late, &[]);
    assert!(outcome.status == Some(1) && outcome.stderr.contains("cold extrusion"), "{outcome:#?}");
}

#[test]
fn a_macro_of_the_profile_is_executed() {
    let directory = directory();
    let text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let own = file(
        &directory,
        "own.toml",
        text + "\n[macro.START_PRINT]\ngcode = \"\"\"\nG28\nM109 S{EXTRUDER_TEMP=190}\nG1 X5 Y5 Z1 F3000\n\"\"\"\n",
    );
    let job = "START_PRINT EXTRUDER_TEMP=210\nM83\nG1 X20 E1 F1200\n";
    let summary = run("print", job, &["--profile", own.to_str().unwrap()]).json();
    assert_eq!((&summary["stopped"], remarks(&summary, "assumed").len()), (&Value::Null, 0), "{summary:#}");
    assert_eq!(summary["position_mm"]["y"], 5.0);
}

#[test]
fn a_temperature_that_the_machine_refuses_stops_the_job_with_its_line() {
    let outcome = run("print", "; a\nSTART_PRINT EXTRUDER_TEMP=900\nG1 X1\n", &[]);
    let said = "line 2: \"START_PRINT EXTRUDER_TEMP=900\": M104 S900: S: 900 C is too hot";
    assert!(outcome.status == Some(1) && outcome.stderr.contains(said), "{outcome:#?}");
}

#[test]
fn strict_macros_are_those_of_a_board() {
    for (text, said) in [
        ("START_PRINT EXTRUDER_TEMP=200\nG1 X5 E1 F600\n", "cold extrusion prevented"),
        ("G28\nSAVE_GCODE_STATE\nRESTORE_GCODE_STATE\n", "write G90 or G91"),
        ("G28\nSET_GCODE_OFFSET X=1\nG1 X20 F3000\n", "the part would lie elsewhere"),
    ] {
        let outcome = run("print", text, &["--strict-macros"]);
        assert!(outcome.status == Some(1) && outcome.stderr.contains(said), "{text}: {outcome:#?}");
    }
    let directory = directory();
    let job = file(&directory, "job.gcode", "START_PRINT EXTRUDER_TEMP=200\nG1 X5 Y5 E1 F600\nG1 X15 E1\nG1 X5 E1\n");
    let (job, page) = (job.to_str().unwrap(), directory.path().join("page.html"));
    let page = page.to_str().unwrap();
    for arguments in [
        &["show", job, "-o", page, "--no-open"][..],
        &["compare", job, "--set", "junction_deviation_mm=0.02", "--no-open"],
        &["sweep", job, "--acceleration", "500,1000"],
        &["simulate", job],
    ] {
        let usual = ferrostep(arguments);
        assert_eq!(usual.status, Some(0), "{usual:#?}");
        let strict = ferrostep(arguments.iter().chain(&["--strict-macros"]));
        let said = format!("{}{}", strict.stdout, strict.stderr);
        assert!(said.contains("cold extrusion prevented"), "{arguments:?}: {strict:#?}");
    }
}

#[test]
fn a_prepared_job_assumes_nothing() {
    let directory = directory();
    let job = file(&directory, "job.gcode", "START_PRINT EXTRUDER_TEMP=200\nG1 X5 E1 F600\n");
    let out = directory.path().join("job.gpre");
    let outcome = ferrostep(["preprocess".as_ref(), job.as_os_str(), "-o".as_ref(), out.as_os_str()]);
    assert!(outcome.status == Some(1) && !out.exists(), "{outcome:#?}");
}

/// Two files that make the same steps; and the same in time, if both end so.
#[track_caller]
fn same(one: &str, other: &str) {
    let [one, other] = [one, other].map(|text| (text, prints(text)));
    assert_eq!(motion(&one.1), motion(&other.1), "{}\n{}", one.0, other.0);
}

#[test]
fn a_noted_state_comes_back() {
    let begin = "G28\nG1 X50 Y50 Z1 F3000\n";
    same(
        &format!(
            "{begin}SAVE_GCODE_STATE NAME=a\nG91\nG1 X5 F900\nRESTORE_GCODE_STATE NAME=a MOVE=1 MOVE_SPEED=50\nG1 X60\n"
        ),
        &format!("{begin}G91\nG1 X5 F900\nG90\nG1 X50 F3000\nG1 X60\n"),
    );
    // Without MOVE the nozzle stays, and the next move counts from the place where it is.
    same(
        &format!("{begin}SAVE_GCODE_STATE\nG91\nG1 X5\nRESTORE_GCODE_STATE\nG1 Y60\n"),
        &format!("{begin}G1 X55\nG1 Y60\n"),
    );
    // One within the other, and one of a name again.
    same(
        &format!(
            "{begin}SAVE_GCODE_STATE NAME=a\nG1 X55\nSAVE_GCODE_STATE NAME=b\nG91\nG1 X5\nRESTORE_GCODE_STATE NAME=b MOVE=1\n\
             SAVE_GCODE_STATE NAME=b\nG1 Y55\nRESTORE_GCODE_STATE NAME=a MOVE=1\n"
        ),
        &format!("{begin}G1 X55\nG1 X60\nG1 X55\nG1 Y55\nG1 X50 Y50\n"),
    );
    // What G92, M220, M221 and SET_GCODE_OFFSET have changed.
    same(
        &format!(
            "{begin}SAVE_GCODE_STATE NAME=a\nG92 X0 Y0\nM220 S50\nM221 S90\nSET_GCODE_OFFSET X=2 Z=0.1\nG1 X10\n\
             RESTORE_GCODE_STATE NAME=a\nG1 X70 Z1\n"
        ),
        &format!("{begin}G1 X62 Z1\nG1 X70 Z1\n"),
    );
    // E keeps the value that it had.
    let heat = "M109 S200\nG28\nG1 X50 Y50 Z1 F3000\nG92 E0\n";
    let summary = prints(&format!(
        "{heat}G1 X60 E2 F1200\nSAVE_GCODE_STATE NAME=a\nG91\nG1 E-1\nRESTORE_GCODE_STATE NAME=a\nG1 X70 E4\nM104 S0\n"
    ));
    assert_eq!((&summary["filament_mm"], &summary["position_mm"]["e"]), (&3.0.into(), &4.0.into()));
    // In inches.
    same(
        &format!("{begin}G20\nSAVE_GCODE_STATE\nG91\nG1 X1\nRESTORE_GCODE_STATE MOVE=1\nG21\nG1 X60\n"),
        &format!("{begin}G1 X75.4\nG1 X50\nG1 X60\n"),
    );
}

#[test]
fn a_state_that_was_not_noted_stops_the_job() {
    for (line, said) in [
        ("RESTORE_GCODE_STATE NAME=purge", "no state \"purge\" is noted: write SAVE_GCODE_STATE NAME=purge before"),
        ("RESTORE_GCODE_STATE", "no state \"default\" is noted"),
        ("SAVE_GCODE_STATE\nRESTORE_GCODE_STATE MOVE=1 MOVE_SPEED=0", "MOVE_SPEED takes a speed above 0"),
        ("SAVE_GCODE_STATE\nRESTORE_GCODE_STATE MOVE=yes", "MOVE=yes: expected a number"),
        ("SET_GCODE_OFFSET X=far", "X=far: expected a number"),
        ("SET_GCODE_OFFSET X=1 Z=5", "SET_GCODE_OFFSET Z=5.00000: Z"),
        ("SET_VELOCITY_LIMIT ACCEL=0", "a number above 0"),
        ("SET_VELOCITY_LIMIT VELOCITY=0 ACCEL=500", "a number above 0"),
    ] {
        let outcome = run("print", &format!("G28\nG1 X20 F3000\n{line}\nG1 X30\n"), &[]);
        assert!(outcome.status == Some(1) && outcome.stderr.contains(said), "{line}: {outcome:#?}");
        let summary = outcome.json();
        assert_eq!((&summary["position_mm"]["x"], &summary["moves"]), (&20.0.into(), &1.into()), "{line}");
    }
}

#[test]
fn offsets_shift_what_follows() {
    let begin = "G28\nG1 X50 Y50 Z1 F3000\n";
    same(
        &format!("{begin}SET_GCODE_OFFSET X=1 Y=-0.5\nG1 X60 Y60\nG92 X61 Y59.5\n"),
        &format!("{begin}G1 X61 Y59.5\n"),
    );
    same(
        &format!(
            "{begin}SET_GCODE_OFFSET X_ADJUST=1 MOVE=1\nSET_GCODE_OFFSET X_ADJUST=1 MOVE=1 MOVE_SPEED=50\nG1 X60\nG92 X62\n"
        ),
        &format!("{begin}G1 X51\nG1 X52\nG1 X62\n"),
    );
    same(
        &format!("{begin}SET_GCODE_OFFSET X=1 Z=0.1 MOVE=1 MOVE_SPEED=5\nSET_GCODE_OFFSET X=0 Z=0\nG1 X50 Z1\n"),
        &format!("{begin}G1 X51 Z1.1 F300\nG1 X50 Z1\n"),
    );
    // Through homing; before it nothing moves, and a remark says so.
    let before = "SET_GCODE_OFFSET X=1 MOVE=1\nG28\nG1 X20 F3000\nG92 X21\n";
    same(before, "G28\nG1 X21 F3000\n");
    let said = remarks(&prints(before), "ignored");
    assert!(said.len() == 1 && said[0].contains("no axis that is not homed"), "{said:?}");
    same(
        "SET_GCODE_OFFSET X=1 Y=1\nG28\nG1 X20 Y20 F3000\nG28 X\nG1 X10\nG92 X11 Y21\n",
        "G28\nG1 X21 Y21 F3000\nG28 X\nG1 X11\n",
    );
    let filament = prints(&format!("M109 S200\n{begin}G92 E0\nSET_GCODE_OFFSET E=1\nG1 X60 E2\nM104 S0\n"));
    assert_eq!((&filament["filament_mm"], &filament["position_mm"]["e"]), (&3.0.into(), &2.0.into()));
}

#[test]
fn commands_with_a_g_code_of_their_own_are_that_g_code() {
    let begin = "M109 S200\nG28\nG1 X50 Y50 Z1 F3000\n";
    same(
        &format!("{begin}SET_RETRACTION RETRACT_LENGTH=1.5 RETRACT_SPEED=20\nG10\nG1 X60\nG11\nM104 S0\n"),
        &format!("{begin}M207 S1.5 F1200\nG10\nG1 X60\nG11\nM104 S0\n"),
    );
    let summary = prints("G28\nSET_DISPLAY_TEXT MSG=\"Layer 1 of 9\"\nG1 X5 F3000\n");
    assert_eq!((&summary["remarks"], &summary["unknown_commands"]), (&serde_json::json!([]), &serde_json::json!([])));
}

#[test]
fn a_file_that_is_cut_anywhere_ends_or_names_a_line() {
    for case in cases() {
        let text = fs::read_to_string(&case).unwrap();
        let cuts = (0..=text.len()).step_by(text.len() / 12).filter(|cut| *cut > 0);
        for cut in cuts {
            let outcome = run("estimate", &text[..cut], &[]);
            let names_line = outcome.stderr.contains("line ");
            assert!(
                outcome.status == Some(0) || outcome.status == Some(1) && names_line,
                "{case:?} {cut}: {outcome:#?}"
            );
        }
    }
}
