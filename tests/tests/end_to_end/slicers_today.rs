//! Lines of today's slicers with which the firmware they are written for continues: the print
//! continues here as well, with one remark at most.

use serde_json::Value;

use crate::end_to_end::command::{Outcome, directory, ferrostep, file};

/// Prints a job that ends, and its remarks: lines and text.
#[track_caller]
fn prints(text: &str) -> (Value, Vec<(u64, String)>) {
    let outcome = print(text);
    assert_eq!(outcome.status, Some(0), "{text}: {outcome:#?}");
    let summary = outcome.json();
    let remarks = remarks(&summary);
    (summary, remarks)
}

fn print(text: &str) -> Outcome {
    let directory = directory();
    let job = file(&directory, "job.gcode", text);
    ferrostep(["print".as_ref(), job.as_os_str(), "--json".as_ref()])
}

fn remarks(summary: &Value) -> Vec<(u64, String)> {
    let remarks = summary["remarks"].as_array().unwrap().iter();
    let line = |remark: &Value| remark["lines"].get(0).and_then(Value::as_u64).unwrap_or_default();
    remarks.map(|remark| (line(remark), remark["message"].as_str().unwrap().to_owned())).collect()
}

/// X, Y and Z.
fn place(summary: &Value) -> [f64; 3] {
    ["x", "y", "z"].map(|axis| summary["position_mm"][axis].as_f64().unwrap())
}

#[test]
fn a_spiral_lift_is_once_around() {
    let job = |arc: &str| format!("G28\nG1 X50 Y50 Z0.2 F3000\n{arc}\nG1 X60\n");
    let (plain, _) = prints(&job("G3 Z0.6 I1.217 J0 F42000"));
    let digest = plain["order_digest"].clone();
    assert_eq!((place(&plain), &digest), ([60.0, 50.0, 0.6], &Value::from("9d4ec34fa4271e15")));
    for arc in ["G3 Z0.6 I1.217 J0 P1 F42000", "G3 Z0.6 I1.217 P0 F42000", "G91\nG3 Z0.4 I1.217 P1 F42000\nG90"] {
        let (summary, remarks) = prints(&job(arc));
        assert_eq!((summary["order_digest"].clone(), remarks), (digest.clone(), vec![]), "{arc}");
    }
    let outcome = print(&job("G3 Z0.6 I1.217 J0 P2 F42000"));
    assert_eq!(outcome.status, Some(1));
    assert!(outcome.stderr.contains("line 3") && outcome.stderr.contains("P other than 0 and 1"), "{outcome:#?}");
}

#[test]
fn numbers_that_are_no_tools_are_remarked() {
    for tool in ["T1000", "T1100", "T255", "T254", "T1001", "T65535", "T-1"] {
        let (summary, remarks) = prints(&format!("G28\n{tool}\nG1 X20 F3000\n"));
        assert_eq!((summary["moves"].as_u64(), place(&summary)[0]), (Some(1), 20.0), "{tool}");
        assert_eq!(remarks.len(), 1, "{tool}: {remarks:?}");
        assert!(remarks[0].0 == 2 && remarks[0].1.contains("unknown command"), "{remarks:?}");
    }
    for tool in ["T1", "T4", "T99"] {
        let outcome = print(&format!("G28\n{tool}\nG1 X20 F3000\n"));
        assert!(outcome.status == Some(1) && outcome.stderr.contains("slice the job for one"), "{outcome:#?}");
    }
}

#[test]
fn an_arc_with_its_centre_far_away_is_nearly_a_line() {
    let job = |arc: &str| format!("G28\nG1 X100 Y100 Z5 F3000\n{arc}\nG1 X60\n");
    let (line, _) = prints(&job("G1 X100.005 Y105"));
    for arc in [
        "G3 X100.005 Y105 I-3356.99 J3.1 F3000",
        "G3 X100.001 Y105 I-9999 J2.5",
        "G2 X100 Y105 R9999",
        "G3 X100 Y105 R250000",
    ] {
        let (summary, remarks) = prints(&job(arc));
        let [x, y, z] = place(&summary);
        assert_eq!(([x, y, z], summary["moves"].as_u64(), remarks), ([60.0, 105.0, 5.0], Some(3), vec![]), "{arc}");
        let [arc_s, line_s] = [&summary, &line].map(|summary| summary["motion_time_s"].as_f64().unwrap());
        assert!((arc_s - line_s).abs() < 0.01, "{arc}: {arc_s} {line_s}");
    }
}

#[test]
fn a_k_of_linear_advance_1_is_remarked() {
    for k in ["K30", "K45", "K-1", "K30 T0"] {
        let (summary, remarks) = prints(&format!("G28\nM109 S200\nM83\nM900 {k} ; LA 1.0\nG1 X20 E1 F1200\nM104 S0\n"));
        assert_eq!(summary["filament_mm"], 1.0);
        assert_eq!(remarks.len(), 1, "{remarks:?}");
        assert!(remarks[0].0 == 4 && remarks[0].1.contains("the advance stays"), "{remarks:?}");
    }
}

#[test]
fn an_unknown_word_of_klippers_is_remarked() {
    let (_, remarks) = prints("G28\nSET_PRESSURE_ADVANCE ADVANCE=0.0660 ADVANCE_LOOKAHEAD_TIME=0.010\nG1 X20 F3000\n");
    assert_eq!(remarks, [(2, "SET_PRESSURE_ADVANCE: ADVANCE_LOOKAHEAD_TIME has no effect".to_owned())]);
}

#[test]
fn klippers_offset_of_z_shifts_the_print() {
    let motor_z = |summary: &Value| summary["motor_steps"]["z"].clone();
    let steps = |z: &str| motor_z(&prints(&format!("G28\nG1 X20 Z{z} F3000\n")).0);
    let (summary, remarks) = prints("G28\nSET_GCODE_OFFSET Z=-0.005\nG1 X20 Z0.2 F3000\n");
    assert_eq!((motor_z(&summary), place(&summary)[2], remarks), (steps("0.195"), 0.2, vec![]));
    let before = prints("SET_GCODE_OFFSET Z=0.1\nG28\nG1 X20 F3000\nG1 Z0.2\n").0;
    assert_eq!((motor_z(&before), before["clamped_moves"].as_u64()), (steps("0.3"), Some(0)));
    let at_once = prints("G28\nG1 X20 Z0.2 F3000\nSET_GCODE_OFFSET Z_ADJUST=0.1 MOVE=1\n").0;
    assert_eq!(motor_z(&at_once), steps("0.3"));
}

#[test]
fn m30_alone_ends_a_program() {
    for end in ["M30", "M30  ", "M30 (end)"] {
        let (summary, remarks) = prints(&format!("G28\nG1 X20 F3000\n{end}\n"));
        assert_eq!(place(&summary)[0], 20.0);
        assert!(remarks.len() == 1 && remarks[0].1.starts_with("M30: without a file's name"), "{remarks:?}");
    }
}

#[test]
fn m400_waits_for_a_time() {
    let time = |line: &str| prints(&format!("G28\nG1 X20 F3000\n{line}\nG1 X30\n")).0["print_time_s"].as_f64().unwrap();
    let [none, seconds, milliseconds] = ["M400", "M400 S2", "M400 P500"].map(time);
    assert!((seconds - none - 2.0).abs() < 0.01 && (milliseconds - none - 0.5).abs() < 0.01, "{none} {seconds}");
}

/// Heaters that the rest of the file would have switched off.
#[test]
fn a_job_that_stopped_has_no_remarks_about_its_end() {
    let outcome = print("M140 S60\nM104 S200\nG28\nT1\nM104 S0\nM140 S0\n");
    assert_eq!(outcome.status, Some(1));
    assert_eq!(remarks(&outcome.json()), [], "{outcome:#?}");
    let (_, remarks) = prints("M140 S60\nG28\n");
    assert!(remarks[0].1.contains("the bed is still on at the end"), "{remarks:?}");
}

#[test]
fn a_limit_that_is_not_allowed_itself_is_called_so() {
    for (line, limit) in [("M140 S125", "125"), ("M190 S125", "125"), ("M104 S275", "275"), ("M109 R275", "275")] {
        let outcome = print(&format!("G28\n{line}\n"));
        let says = format!("{limit} C is too hot, expected less than {limit} C");
        assert!(outcome.status == Some(1) && outcome.stderr.contains(&says), "{outcome:#?}");
    }
    prints("G28\nM140 S124.9\nM104 S274.9\nM104 S0\nM140 S0\n");
}

#[test]
fn an_arc_says_how_far_it_leaves_the_travel() {
    let outcome = print("G28\nG1 X195 Y90 F3000\nG3 X195 Y110 I0 J10\n");
    assert_eq!(outcome.status, Some(0));
    let says = "echo:line 3: outside the soft limits, X goes to 205.00 (allowed 0.00 to 200.00)";
    assert!(outcome.stderr.contains(says), "{outcome:#?}");
    let expected = (3, "the arc leaves the travel and is drawn in to its edge".to_owned());
    assert_eq!(remarks(&outcome.json()), [expected]);
}

/// Outlines of objects have thousands of characters.
#[test]
fn a_command_without_effect_may_have_any_length() {
    let directory = directory();
    for length in [200, 216, 217, 218, 300, 9000] {
        let outline = format!("EXCLUDE_OBJECT_DEFINE NAME=a POLYGON={}", "1".repeat(length));
        let job = format!("{outline}\nG28\n; a\n{outline}\nG1 X50 F3000\n");
        let (summary, remarks) = prints(&job);
        assert_eq!(place(&summary)[0], 50.0, "{length}");
        assert!(remarks.len() == 1 && remarks[0].1.contains("EXCLUDE_OBJECT_DEFINE"), "{length}: {remarks:?}");
        let (job, out) = (file(&directory, "long.gcode", job), directory.path().join("long.gpre"));
        let _ = std::fs::remove_file(&out);
        let prepared = ferrostep(["preprocess".as_ref(), job.as_os_str(), "-o".as_ref(), out.as_os_str()]);
        assert_eq!(prepared.status, Some(0), "{length}: {prepared:#?}");
    }
    let (_, remarks) = prints(&format!("SOMETHING_UNKNOWN A={}\nG28\n", "1".repeat(300)));
    assert!(remarks[0].1.contains("unknown command"), "{remarks:?}");
    for line in [format!("G1 X{}1", "0".repeat(300)), format!("SET_VELOCITY_LIMIT ACCEL=500 A={}", "1".repeat(300))] {
        let outcome = print(&format!("G28\n{line}\nG1 X5 F3000\n"));
        assert!(outcome.status == Some(1) && outcome.stderr.contains("line 2: the line is too long"), "{outcome:#?}");
    }
}
