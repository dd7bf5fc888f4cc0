use super::*;
use crate::motion::homing::tests::rig::{Rig, execute};

const MACROS: &str =
    "#PARK\n1 G28\n#START BED=60 NOZZLE\n1 M140 S{BED}\nHEAT:2 G4 P{NOZZLE}{BED}\n#LONG WORD=x\n1 M117 {WORD}\n";

/// The lines of a call, and why it ends.
fn lines(text: &str) -> (Vec<String>, Option<String>) {
    let (mut call, mut room, mut lines) = (call(MACROS, text).unwrap(), MacroLine::new(), Vec::new());
    loop {
        match call.next_line(&mut room) {
            Ok(true) => lines.push(format!("{} {}", call.place(), room.as_str())),
            Ok(false) => return (lines, None),
            Err(error) => return (lines, Some(error.to_string())),
        }
    }
}

#[test]
fn words_of_the_call_go_before_defaults() {
    assert_eq!(lines("PARK"), (vec!["1 G28".to_owned()], None));
    let both = ["1 M140 S75", "HEAT:2 G4 P20075"].map(str::to_owned).to_vec();
    assert_eq!(lines("start  NOZZLE=200\tbed=75"), (both, None));
    assert_eq!(lines("START NOZZLE=1").0[0], "1 M140 S60");
}

#[test]
fn words_that_are_missing_unknown_or_too_long_end_it() {
    for (text, error) in [
        ("START", "START: expected NOZZLE"),
        ("START NOZZLE=1 BET=60", "START: unknown word \"BET=60\", expected one or more of BED=60 NOZZLE"),
        ("START NOZZLE=", "START: unknown word \"NOZZLE=\", expected one or more of BED=60 NOZZLE"),
        ("PARK X1", "PARK: unknown word \"X1\": the macro takes no words"),
    ] {
        assert_eq!(lines(text), (vec![], Some(error.to_owned())));
    }
    let long = format!("LONG WORD={}", "y".repeat(MACRO_LINE));
    assert_eq!(lines(&long).1.unwrap(), "LONG: expected shorter values: a line has at most 96 characters");
}

#[test]
fn other_lines_call_none() {
    for text in ["", "G1 X1", "P", "PARKS", "STAR", "M104 S60", ";PARK", "#PARK", "1 M140 S{BED}"] {
        assert!(call(MACROS, text).is_none(), "{text}");
    }
    assert!(call("", "PARK").is_none());
}

#[test]
fn its_lines_are_executed_and_a_failure_ends_it_with_its_place() {
    let rig =
        Rig::new(|profile| profile.macros = "#GO Y=20\n1 G28\n2 G1 X10 Y{Y}\n#FAIL\n1 G1 X12\n7 G1 X6000\n9 G1 X13\n");
    let mut printer = rig.printer();
    execute(&mut printer, "go y=30").unwrap();
    assert_eq!(rig.believed_mm(), [10.0, 30.0, 0.0]);
    execute(&mut printer, "GO").unwrap();
    assert_eq!(rig.believed_mm(), [10.0, 20.0, 0.0]);
    rig.last_texts();
    assert!(execute(&mut printer, "FAIL").is_err());
    assert_eq!(rig.believed_mm(), [12.0, 20.0, 0.0]);
    let said = rig.last_texts();
    assert_eq!(said[0], "echo:line 1: FAIL, line 7: \"G1 X6000\" ends the macro");
    assert!(said[1].starts_with("echo:line 1: "), "{said:?}");
    // The next line is one as ever.
    execute(&mut printer, "G1 X14").unwrap();
    assert_eq!(rig.believed_mm()[0], 14.0);
}

/// M112, M410 and heat: between the lines of a macro all is as between the lines of a host.
#[test]
fn stops_pauses_and_halts_work_between_its_lines() {
    use crate::commands::tuning::tests::{World, execute as run};
    let mut world = World::new();
    world.change(|profile| profile.macros = "#PP\n1 G4 S1\n2 M601\n3 G4 S1\n4 M220 S50\n#HH\n1 G4 S100\n2 M220 S70\n");
    let mut printer = world.printer();
    // A person resumes it.
    assert!(run(&world, &mut printer, "PP", |seconds| {
        if seconds > 20 {
            world.signals().end_wait();
        }
    }));
    let said = world.said().join("\n");
    assert!(said.contains("//action:paused") && said.ends_with("ok"), "{said}");
    run(&world, &mut printer, "M220", |_| {});
    assert!(world.said().join("\n").contains("FR:50%"));
    // M112 in its first line.
    assert!(!run(&world, &mut printer, "HH", |seconds| {
        if seconds > 3 {
            world.signals().halt();
        }
    }));
    assert!(world.said().join("\n").contains("HH, line 1: \"G4 S100\" ends the macro"));
    run(&world, &mut printer, "M220", |_| {});
    assert!(world.said().join("\n").contains("FR:50%"));
}
