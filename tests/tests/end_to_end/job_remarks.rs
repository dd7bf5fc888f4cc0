//! Remarks of `print`, `estimate` and `preprocess` on a job: lines without effect, and findings
//! of the rehearsal.

use std::fs;

use serde_json::{Value, json};

use crate::end_to_end::command::{Outcome, directory, ferrostep, file, repository};
use crate::end_to_end::desk::{profile, rehearse_traced};

/// The text of a built-in profile with some of its text replaced.
fn changed(name: &str, changes: &[(&str, &str)]) -> String {
    let mut text = fs::read_to_string(repository().join(format!("config/profiles/{name}.toml"))).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    text
}

/// Runs a command on a job, with JSON.
fn run(command: &str, text: &str, profile: &str, more: &[&str]) -> Outcome {
    let directory = directory();
    let job = file(&directory, "job.gcode", text);
    let own = file(&directory, "own.toml", profile);
    let out = directory.path().join("job.gpre");
    let mut arguments = vec![command, job.to_str().unwrap(), "--profile", own.to_str().unwrap(), "--json"];
    if command == "preprocess" {
        arguments.extend(["-o", out.to_str().unwrap()]);
    }
    arguments.extend(more);
    ferrostep(arguments)
}

fn kinds(summary: &Value) -> Vec<&str> {
    summary["remarks"].as_array().unwrap().iter().map(|remark| remark["kind"].as_str().unwrap()).collect()
}

const JOB: &str = ";TIME:200
G91
G1 Z5 F600
G1 Z5
G90
G28
M109 S200
M140 S50
G29
M573
M240
M240
MY_MACRO A=1
M600
M205 X8 S5
G1 X250 Y10 Z0.2 F6000
G1 X20 E2 F600
G1 X40 E20 F6000
G1 X60 E22 F6000
M84
";

#[test]
fn a_rehearsal_lists_what_a_person_should_know() {
    let machine = changed("cartesian", &[("minimum_event", "max_volumetric_flow_mm3_per_s = 15\nminimum_event")]);
    let expected = [
        ("not_homed", 2, &[3, 4][..], "an axis moves that is not homed"),
        ("no_effect", 1, &[9], "G29: this machine has no probe"),
        ("no_effect", 1, &[10], "M573: not executed (mean flow"),
        ("unknown", 2, &[11, 12], "M240: not executed (trigger a camera): there is no such output"),
        ("unknown", 1, &[13], "MY_MACRO: unknown command"),
        ("pause", 1, &[14], "M600 asks the printer to wait for a person"),
        ("corner", 1, &[15], "M205: S has no effect; X has no effect"),
        ("soft_limit", 1, &[16], "outside the travel"),
        ("heater_on", 1, &[], "the nozzle is still on at the end, at 200 C: end the job with M104 S0"),
        ("heater_on", 1, &[], "the bed is still on at the end, at 50 C: end the job with M140 S0"),
        // 18 mm of 1.75 mm filament on 20 mm at 100 mm/s.
        ("flow", 1, &[18], "(15 mm^3/s, max_volumetric_flow_mm3_per_s): at most 216.5 mm^3/s, in line 18"),
    ];
    for command in ["print", "estimate", "preprocess"] {
        let outcome = run(command, JOB, &machine, &[]);
        assert_eq!(outcome.status, Some(0), "{command}: {outcome:#?}");
        let summary = outcome.json();
        let remarks: Vec<_> = summary["remarks"].as_array().unwrap().iter().collect();
        for (kind, count, lines, says) in expected {
            let found = remarks.iter().find(|remark| remark["message"].as_str().unwrap().contains(says));
            let found = found.unwrap_or_else(|| panic!("{command}: {says}: {remarks:#?}"));
            assert_eq!(
                [&found["kind"], &found["count"], &found["lines"]],
                [&json!(kind), &json!(count), &json!(lines)],
                "{command}: {says}"
            );
        }
        // M600 is unknown beside its pause, or is executed.
        assert!((expected.len()..=expected.len() + 1).contains(&remarks.len()), "{command}: {remarks:#?}");
        if command != "preprocess" {
            assert_eq!(summary["slicer_time_s"], 200.0, "{command}");
        }
        let strict = run(command, JOB, &machine, &["--strict"]);
        assert_eq!(strict.status, Some(1), "{command}: {strict:#?}");
        assert!(
            strict.stderr.contains("remarks, and none expected (--strict): 2 lines from 3 on: an axis moves"),
            "{strict:#?}"
        );
    }
}

#[test]
fn a_job_without_remarks_has_none() {
    let machine = changed("cartesian", &[("minimum_event", "max_volumetric_flow_mm3_per_s = 15\nminimum_event")]);
    let text = "G28\nM109 S200\nM190 S50\nM205 S0 T0 J0.02 Z0.4\nM73 P0\nM900 K0\nG1 X50 Y10 Z0.2 F6000\nG1 X70 E0.7 F1800\nG1 E-1\nM104 S0\nM140 S0\nM84\n";
    for command in ["print", "estimate", "preprocess"] {
        let outcome = run(command, text, &machine, &["--strict"]);
        assert_eq!(outcome.status, Some(0), "{command}: {outcome:#?}");
        assert_eq!(outcome.json()["remarks"], json!([]), "{command}");
    }
}

/// PrusaSlicer writes such a line into every file: it is listed, but not an error.
#[test]
fn limits_at_corners_that_the_profile_does_not_have_pass_strict() {
    let machine = changed("cartesian", &[]);
    let passes = run("print", "G28\nM205 X8.00 Y8.00 Z0.40 E1.50\n", &machine, &["--strict"]);
    assert_eq!(passes.status, Some(0), "{passes:#?}");
    let remarks = &passes.json()["remarks"];
    assert_eq!((&remarks[0]["kind"], remarks.as_array().map(Vec::len)), (&json!("corner"), Some(1)), "{remarks}");
    let fails = run("print", "G28\nM205 X8.00 Y0 Z0.40\n", &machine, &["--strict"]);
    assert_eq!(fails.status, Some(1), "{fails:#?}");
}

/// A remark is a line of the text.
#[test]
fn remarks_are_readable() {
    let directory = directory();
    let job =
        file(&directory, "job.gcode", "; estimated printing time (normal mode) = 1m 5s\nG28\nG29\nG29\nM140 S50\n");
    let outcome = ferrostep(["print".as_ref(), job.as_os_str()]);
    assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
    for line in [
        "  remark       2 lines from 3 on: G29: this machine has no probe, its bed must be level by itself; no effect",
        "  remark       the bed is still on at the end, at 50 C: end the job with M140 S0",
        " of it in motion; the slicer says 1 min 05 s)",
    ] {
        assert!(outcome.stdout.contains(line), "{line} in {}", outcome.stdout);
    }
}

/// M862.1 and M862.3 against a profile with nozzle and model; without these they are remarks.
#[test]
fn jobs_for_other_machines_stop() {
    let mini = changed("prusa-mini", &[("name = ", "nozzle_diameter_mm = 0.4\nname = ")]);
    let cartesian = changed("cartesian", &[]);
    for (line, says) in [
        ("M862.3 P \"MK4\"", "the job is for another printer, this machine is MINI: slice the job for it"),
        ("M862.1 P0.6", "the job is for a nozzle of 0.6 mm, this machine has one of 0.4 mm: slice the job for it"),
    ] {
        let outcome = run("print", &format!("G21\n{line}\nG1 X5\n"), &mini, &[]);
        assert_eq!(outcome.status, Some(1), "{line}: {outcome:#?}");
        assert_eq!(outcome.json()["stopped"]["line"], 2, "{line}");
        assert!(outcome.stderr.contains(says), "{line}: {outcome:#?}");
        let outcome = run("print", &format!("G21\n{line}\n"), &cartesian, &[]);
        assert_eq!(outcome.status, Some(0), "{line}: {outcome:#?}");
        assert_eq!(kinds(&outcome.json()), ["ignored"], "{line}");
    }
    for line in ["M862.3 P \"MINI\"", "M862.3 P mini", "M862.1 P0.4 A0 F0", "M862.1 P0.40"] {
        let outcome = run("print", &format!("{line}\n"), &mini, &[]);
        assert_eq!((outcome.status, kinds(&outcome.json())), (Some(0), vec![]), "{line}: {outcome:#?}");
    }
}

/// Purge lines beside the bed, as the slicer's start code of the MINI and the MK3S has them, are
/// drawn where they are asked for, on machines whose travel goes there.
#[test]
fn purge_lines_beside_the_bed_are_drawn_there() {
    let mk3s = changed(
        "cartesian",
        &[
            (
                "size_mm = { x = 200, y = 200, z = 200 }",
                "size_mm = { x = 250, y = 210, z = 210 }\nlower_end_mm = { x = 0, y = -4, z = 0 }",
            ),
            // The end stop of Y, after that of X.
            ("position_mm = 0\n", "position_mm = 0 # X\n"),
            ("position_mm = 0\n", "position_mm = -4\n"),
        ],
    );
    let mk3s = ferrostep_profiles::parse(&mk3s, "mk3s.toml").unwrap();
    let mini_line = "G1 Y-2 X179 F2400\nG1 Z3 F720\nG1 X170 F1000\nG1 Z0.2 F720\nG1 X110 E8 F900\nG1 X40 E10 F700\n";
    let mk3s_line = "G1 Z0.2 F720\nG1 Y-3 F1000\nG1 X60 E9 F1000\nG1 X100 E12.5 F1000\n";
    for (machine, text, end_mm) in
        [(profile("prusa-mini"), mini_line, [40.0, -2.0, 0.2]), (mk3s, mk3s_line, [100.0, -3.0, 0.2])]
    {
        let job = format!("G28\nM302 P1\nG90\nM82\nG92 E0\n{text}");
        let ended = rehearse_traced(&machine, &mut job.as_bytes());
        assert!(ended.outcome.is_ok(), "{}: {:?}", machine.name, ended.outcome);
        assert_eq!((ended.tally.clamped_moves, &ended.notices[..]), (0, &[][..]), "{}", machine.name);
        let [x, y, z, _] = ended.logical_10nm.map(|length_10nm| length_10nm as f64 / 100_000.0);
        assert_eq!([x, y, z], end_mm, "{}", machine.name);
    }
    // The line is drawn at the travel's edge on a machine whose travel ends at the bed, and
    // a remark says so.
    let outcome = run("print", "G28\nG1 Y-3 F1000\nM84\n", &changed("cartesian", &[]), &[]);
    assert_eq!(kinds(&outcome.json()), ["soft_limit"], "{outcome:#?}");
}
