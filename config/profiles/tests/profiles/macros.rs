//! Macros: reading them, and refusing wrong ones by their lines.

use ferrostep_profiles::{builtin_text, parse};

/// A profile with these macros at its end, and the number of its lines before them.
fn read(macros: &str) -> Result<&'static str, String> {
    let text = format!("{}\n{macros}", builtin_text("cartesian").unwrap());
    let lines_before = text.lines().count() - macros.lines().count();
    let read = parse(&text, "p");
    read.map(|profile| profile.macros).map_err(|error| {
        // The place within the macros.
        let error = error.to_string();
        let (line, rest) = error.strip_prefix("p:").unwrap().split_once(": ").unwrap();
        format!("{}: {rest}", line.parse::<usize>().unwrap() - lines_before)
    })
}

fn refused(macros: &str, expected: &str) {
    assert_eq!(read(macros), Err(expected.to_owned()), "{macros}");
}

#[test]
fn a_macro_may_call_another_and_has_words_with_defaults() {
    let text = "[macro.START_PRINT]\ngcode = \"\"\"\n; first\nG28\nM190 S{BED=60}\n\nHEAT nozzle={NOZZLE=200}\nM117 {BED} is hot ; now\n\"\"\"\n\
                [macro.HEAT]\ngcode = '''\nM104 S{NOZZLE}\nM109 S{NOZZLE}\nG4 P{WAIT=5}\n'''\n";
    assert_eq!(
        read(text).unwrap(),
        "#START_PRINT BED=60 NOZZLE=200\n2 G28\n3 M190 S{BED}\nHEAT:1 M104 S{NOZZLE}\nHEAT:2 M109 S{NOZZLE}\n\
         HEAT:3 G4 P5\n6 M117 {BED} is hot\n#HEAT NOZZLE WAIT=5\n1 M104 S{NOZZLE}\n2 M109 S{NOZZLE}\n3 G4 P{WAIT}\n"
    );
    assert_eq!(read(""), Ok(""));
}

#[test]
fn a_macro_that_calls_itself_is_refused() {
    refused("[macro.AA]\ngcode = \"AA\"\n", "2: macro.AA.gcode = \"AA\": expected no macro that calls itself: AA, AA");
    refused(
        "[macro.AA]\ngcode = \"BB\"\n[macro.BB]\ngcode = \"\"\"\nG28\nCC\n\"\"\"\n[macro.CC]\ngcode = \"aa\"\n",
        "9: macro.CC.gcode = \"aa\": expected no macro that calls itself: AA, BB, CC, AA",
    );
}

#[test]
fn names_of_commands_and_malformed_ones_are_refused() {
    for name in ["PAUSE", "SET_PRESSURE_ADVANCE", "RESTORE_GCODE_STATE"] {
        let error = read(&format!("[macro.{name}]\ngcode = \"G28\"\n")).unwrap_err();
        assert!(error.ends_with(": expected another name: this one is a command of the firmware"), "{error}");
    }
    for name in ["start", "G28", "T0", "A", "PARK-IT"] {
        let error = read(&format!("[macro.{name}]\ngcode = \"G28\"\n")).unwrap_err();
        assert!(error.contains(": expected a name of 2 to 32 capitals"), "{error}");
    }
}

#[test]
fn lines_are_read_for_a_trial() {
    let one = |line: &str| format!("[macro.AA]\ngcode = \"\"\"\nG28\n{line}\n\"\"\"\n");
    for (line, expected) in [
        ("M106 S-5", "\"M106 S-5\": expected what can be executed: S: -5 is out of range, expected 0 to 255"),
        ("M106 S{T=-5}", "\"M106 S-5\": expected what can be executed: S: -5 is out of range, expected 0 to 255"),
        ("HOME_ALL", "\"HOME_ALL\": expected a command, or the name of a macro"),
        ("M105", "\"M105\": expected no M105: a host asks for temperatures by itself"),
        ("M24", "\"M24\": expected no command for the card: its print would go on within the macro"),
        ("M104 S{T", "\"M104 S{T\": expected a } for each {"),
        (
            "M104 S{t=5}",
            "\"M104 S{t=5}\": expected {KEY} or {KEY=DEFAULT}, the key in capitals and the default without blanks",
        ),
    ] {
        refused(&one(line), &format!("4: macro.AA.gcode = {expected}"));
    }
    refused(
        &one("M104 S{T=5}\nM140 S{T=6}"),
        "5: macro.AA.gcode = \"M140 S{T=6}\": expected one default for T: an earlier line has 5",
    );
}

#[test]
fn words_of_calls_are_known_and_complete() {
    let two = |call: &str| format!("[macro.AA]\ngcode = \"{call}\"\n[macro.BB]\ngcode = \"M106 S{{T}}\"\n");
    refused(&two("BB U=5"), "2: macro.AA.gcode = \"BB U=5\": expected words that BB knows: T");
    refused(&two("BB"), "2: macro.AA.gcode = \"BB\": expected T=, which BB needs");
    // The line of another macro is read with the words of the call.
    refused(
        &two("BB T=-1"),
        "2: macro.AA.gcode = \"BB:1: M106 S-1\": expected what can be executed: S: -1 is out of range, expected 0 to 255",
    );
}

#[test]
fn what_no_image_could_hold_is_refused() {
    let lines = "G1 X1 Y1 F6000\n".repeat(400);
    let error = read(&format!("[macro.AA]\ngcode = \"\"\"\n{lines}\"\"\"\n")).unwrap_err();
    assert!(error.contains("macro = ") && error.contains("expected at most 4096 bytes"), "{error}");
    // Nor does the reader itself run out of room.
    let deep: String = (0..2000).map(|n| format!("[macro.A_{n}]\ngcode = \"A_{}\"\n", n + 1)).collect();
    let error = read(&format!("{deep}[macro.A_2000]\ngcode = \"G28\"\n")).unwrap_err();
    assert!(error.contains("expected at most 8 levels of nested macros"), "{error}");
    let wide: String = (0..7)
        .map(|n| format!("[macro.A_{n}]\ngcode = \"\"\"\n{}\"\"\"\n", format!("A_{}\n", n + 1).repeat(90)))
        .collect();
    let error = read(&format!("{wide}[macro.A_7]\ngcode = \"G28\"\n")).unwrap_err();
    assert!(error.contains("expected at most 512 lines"), "{error}");
}

const TOOLS: &str = "[tools.t1]\nmotor = \"e1\"\noffset_mm = { x = 20, y = 0, z = 0 }\n";

/// A profile with two tools, macros at their change, and these macros.
fn at_change(keys: &str, macros: &str) -> Result<ferrostep_printer::Profile, String> {
    let text = format!("{}\n[tools]\n{keys}\n{TOOLS}\n{macros}", builtin_text("cartesian").unwrap());
    parse(&text, "p").map_err(|error| error.to_string().split_once(": ").unwrap().1.to_owned())
}

#[test]
fn a_change_of_the_tool_has_macros_that_know_both_tools() {
    let macros = "[macro.WIPE]\ngcode = \"M117 from T{FROM}\"\n[macro.CLEAN]\ngcode = '''\nG1 X{X=5}\nwipe FROM={FROM} ; again\n'''\n";
    let profile = at_change("before_change = \"wipe\"\nafter_change = \"CLEAN\"", macros).unwrap();
    let change = profile.tools.unwrap().0.change;
    assert_eq!((change.before, change.after), (Some("wipe"), Some("CLEAN")));
    assert_eq!(
        profile.macros,
        "#WIPE FROM TO=0\n1 M117 from T{FROM}\n#CLEAN X=5 FROM TO=0\n1 G1 X{X}\nWIPE:1 M117 from T{FROM}\n"
    );
    let none = at_change("", macros).unwrap().tools.unwrap().0.change;
    assert_eq!((none.before, none.after), (None, None));
}

#[test]
fn a_macro_at_a_change_that_cannot_be_one_is_refused() {
    let change =
        |line: &str| format!("[macro.WIPE]\ngcode = \"CLEAN\"\n[macro.CLEAN]\ngcode = '''\nG28\n{line}\n'''\n");
    let no_macro = "the name of a macro, as in [macro.NAME]";
    let changes = |line: &str| format!("a macro that does not change the tool itself: its line CLEAN:2 is \"{line}\"");
    let activate = "ACTIVATE_EXTRUDER EXTRUDER=extruder1";
    for (macros, expected) in [
        (String::new(), no_macro.to_owned()),
        ("[macro.OTHER]\ngcode = \"G28\"\n".to_owned(), no_macro.to_owned()),
        (change("T0"), changes("T0")),
        (change("T{FROM=1} S1"), changes("T1 S1")),
        (change(activate), changes(activate)),
        (
            "[macro.WIPE]\ngcode = \"M117 {FROM} {PLACE}\"\n".to_owned(),
            "a macro that needs no words but FROM and TO: this one needs PLACE=, give it a default".to_owned(),
        ),
    ] {
        let error = at_change("after_change = \"WIPE\"", &macros).unwrap_err();
        assert_eq!(error, format!("tools.after_change = \"WIPE\": expected {expected}"));
    }
    // A command that only names the tool does not change it.
    at_change("before_change = \"WIPE\"", &change("M104 T1 S0\nT")).unwrap();
}
