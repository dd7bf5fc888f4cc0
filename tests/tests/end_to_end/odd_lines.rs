//! Odd lines of slicers and of programs for other machines: the print continues as on Marlin, and
//! one echo, or a remark of the summary, reports the part that was ignored.

use serde_json::Value;

use crate::end_to_end::command::{Outcome, directory, ferrostep, file};

const PROLOGUE: &str = "G28\nG1 X10 Y20 Z3 F3000\n";
const EPILOGUE: &str = "G1 X40\nG1 Y50\n";

/// The result of a `ferrostep` command for a job.
#[track_caller]
fn run(command: &str, text: &str) -> Outcome {
    let directory = directory();
    let job = file(&directory, "job.gcode", text);
    let out = directory.path().join("job.gpre");
    match command {
        "preprocess" => {
            let outcome = ferrostep(["preprocess".as_ref(), job.as_os_str(), "-o".as_ref(), out.as_os_str()]);
            assert_eq!(outcome.status, Some(0), "{outcome:#?}");
            // The prepared job can be printed.
            ferrostep(["print".as_ref(), out.as_os_str(), "--json".as_ref()])
        }
        command => ferrostep([command.as_ref(), job.as_os_str(), "--json".as_ref()]),
    }
}

/// Remarks of a summary: lines and texts.
fn remarks(outcome: &Outcome) -> Vec<(Vec<u64>, String)> {
    let summary = outcome.json();
    let remarks = summary["remarks"].as_array().unwrap().iter();
    let lines =
        |remark: &Value| remark["lines"].as_array().unwrap().iter().map(|line| line.as_u64().unwrap()).collect();
    remarks.map(|remark| (lines(remark), remark["message"].as_str().unwrap().to_owned())).collect()
}

/// The end of a print that begins with a dwell without a time, before everything is switched off.
#[test]
fn a_bare_dwell_does_not_stop_a_job() {
    let text =
        format!("{PROLOGUE}M104 S60\nM140 S40\nM106 S99\n{EPILOGUE}G4 ; wait\nM104 S0\nM140 S0\nM107\nG1 X50\nM84\n");
    for command in ["print", "estimate", "preprocess"] {
        let outcome = run(command, &text);
        assert_eq!(outcome.status, Some(0), "{command}: {outcome:#?}");
        let summary = outcome.json();
        assert_eq!(summary["stopped"], Value::Null, "{command}");
        assert_eq!(summary["position_mm"]["x"], 50.0, "{command}: {summary}");
        assert_eq!(summary["unknown_commands"], serde_json::json!([]), "{command}");
        let says = "G4: without P or S: waits until all motion has ended".to_owned();
        assert_eq!(remarks(&outcome), [(vec![8], says)], "{command}");
    }
}

/// An odd line, three times, beside the line whose meaning it gets.
#[test]
fn odd_lines_are_read_as_marlin_reads_them() {
    for (odd, as_if, says) in [
        ("G4", "M400", "without P or S: waits until all motion has ended"),
        ("G1 X20 E", "G1 X20", "E without a number is ignored"),
        ("G1 X20 F0", "G1 X20", "F is not above 0 and is ignored"),
        ("G1 X20 F-5", "G1 X20", "F is not above 0 and is ignored"),
        ("G1 Y", "", "Y without a number is ignored"),
        ("G92 E", "G92 E0", "E without a number is read as 0"),
        ("G4 600", "M400", "a number without its letter is ignored"),
        ("M205 J0.02 S5", "M205 J0.02", "S has no effect"),
        ("M104 S0 T1", "", "this machine has one extruder"),
        ("M106 P1 S255", "", "this machine has no such fan"),
        ("M221 S", "", "S without a number is ignored"),
        ("G28 X0 R5", "G28 X0", "R has no effect"),
        ("G28 M420 S1", "G28", "the second and everything after it is ignored"),
        ("G29", "", "this machine has no probe"),
        ("M900 K0.05 L0.1", "M900 K0.05", "L has no effect"),
        ("M573", "", "not executed (mean flow"),
        ("@pause", "", "a line with @ is for the host"),
        ("// layer 3", "", "not a comment"),
        ("'M104 S0'", "", "unknown command"),
        ("100", "", "unknown command"),
        ("Tx", "", "unknown command"),
        ("T-1", "", "unknown command"),
        ("M204 P700 T0", "M204 P700", "T is not above 0 and is ignored"),
        ("M201 X0 Y500", "M201 Y500", "X is not above 0 and is ignored"),
        ("M203 Y0", "", "Y is not above 0 and is ignored"),
        ("M205 J0", "", "J is not above 0 and is ignored"),
        ("M220 S0", "", "S is not above 0 and is ignored"),
        ("M106 P127.5", "", "P must be whole, the fraction is dropped; this machine has no such fan"),
        ("M106 S300", "M106", "S is too large and becomes the largest value"),
        ("G91 G0 X5", "G91", "the second and everything after it is ignored"),
        ("G1 X20 M106", "G1 X20", "the second and everything after it is ignored"),
        ("%", "", "%: unknown command"),
    ] {
        let job = |line: &str| format!("{PROLOGUE}{}{EPILOGUE}", format!("{line}\n").repeat(3));
        let [outcome, expected] = [odd, as_if].map(|line| run("print", &job(line)));
        assert_eq!(outcome.status, Some(0), "{odd}: {outcome:#?}");
        let told = remarks(&outcome);
        assert!(told.len() == 1 && told[0].0 == [3, 4, 5] && told[0].1.contains(says), "{odd}: {told:?}");
        assert_eq!(remarks(&expected), [], "{as_if}");
        let [summary, expected] = [outcome.json(), expected.json()];
        for key in ["moves", "position_mm", "filament_mm", "motor_steps", "motion_time_s", "step_digest"] {
            assert_eq!(summary[key], expected[key], "{odd}: {key}");
        }
        let estimate = run("estimate", &job(odd));
        assert_eq!(estimate.status, Some(0), "{odd}: {estimate:#?}");
        let prepared = run("preprocess", &job(odd));
        assert_eq!(prepared.status, Some(0), "{odd}: {prepared:#?}");
        assert_eq!(prepared.json()["step_digest"], summary["step_digest"], "{odd}");
    }
}

/// Another job on the same connection gets its echo anew.
#[test]
fn remarks_come_once_a_job() {
    use crate::end_to_end::hosts::{Conversation, machine};
    let machine = machine(&crate::end_to_end::desk::profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    for _ in 0..2 {
        assert_eq!(conversation.say("M110 N0"), ["ok"]);
        let told = conversation.say("G4");
        assert_eq!((told.len(), told[1].as_str()), (2, "ok"), "{told:?}");
        assert!(told[0].starts_with("echo:line ") && told[0].contains("\"G4\""), "{told:?}");
        assert_eq!(conversation.say("G4"), ["ok"]);
        // Another kind, and another word.
        assert_eq!(conversation.say("G1 F0").len(), 2);
        assert_eq!(conversation.say("M204 T0").len(), 2);
        assert_eq!(conversation.say("M204 T0"), ["ok"]);
    }
}
