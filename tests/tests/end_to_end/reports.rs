//! The printer's reports, read with the regular expressions of hosts.

use std::cell::RefCell;

use ferrostep_gcode::TimingFigures;
use ferrostep_printer::Timing;
use ferrostep_testkit::program::repository;

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, machine};
use regex_lite::Regex;

fn regex(text: &str) -> Regex {
    Regex::new(text).unwrap()
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

/// Each sensor of a line with its value and its target, as OctoPrint finds them.
pub fn temperatures(line: &str) -> Vec<(String, f64, f64)> {
    let sensors = regex(r"(B|C|T[0-9]*|[A-Za-z]+):\s*([-+]?[0-9]*\.?[0-9]+)\s*/\s*([-+]?[0-9]*\.?[0-9]+)");
    sensors.captures_iter(line).map(|found| (found[1].to_owned(), number(&found[2]), number(&found[3]))).collect()
}

#[test]
fn temperatures_on_request() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    let cold = conversation.say("M105");
    assert_eq!(cold, ["ok T:22.00 /0.00 B:22.00 /0.00 @:0 B@:0"]);
    assert_eq!(temperatures(&cold[0]), [("T".into(), 22.0, 0.0), ("B".into(), 22.0, 0.0)]);

    assert_eq!(conversation.say("M104 S210"), ["ok"]);
    assert_eq!(conversation.say("M140 S60"), ["ok"]);
    conversation.say("G4 S20");
    let warm = conversation.say("M105");
    let [nozzle, bed] = temperatures(&warm[0]).try_into().unwrap();
    assert!(nozzle.1 > 30.0 && nozzle.1 < 210.0 && nozzle.2 == 210.0, "{warm:?}");
    assert!(bed.1 > 25.0 && bed.1 < 60.0 && bed.2 == 60.0, "{warm:?}");
    assert!(warm[0].ends_with(" @:127 B@:127"), "full power while it is far from hot: {warm:?}");
}

#[test]
fn position_report() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    // Pronterface looks for ` Count `, OctoPrint for the letters.
    let position =
        regex(r"^X:\s*([-0-9.]+)\s*Y:\s*([-0-9.]+)\s*Z:\s*([-0-9.]+)\s*E:\s*([-0-9.]+) Count X:(\S+) Y:(\S+) Z:(\S+)$");
    let read = |line: &str, conversation: &mut Conversation<'_>| -> Vec<f64> {
        let replies = conversation.say(line);
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{replies:?}");
        let found = replies.iter().find_map(|reply| position.captures(reply)).unwrap_or_else(|| panic!("{replies:?}"));
        (1..8).map(|group| number(&found[group])).collect()
    };
    assert_eq!(read("G28", &mut conversation), [0.0; 7]);
    conversation.say("M302 P1");
    conversation.say("G1 X10.125 Y20 Z0.5 E3 F6000");
    conversation.say("M400");
    assert_eq!(read("M114", &mut conversation), [10.13, 20.0, 0.5, 3.0, 810.0, 1600.0, 200.0]);
    conversation.say("G92 X-1.5 E0");
    assert_eq!(read("M114", &mut conversation), [-1.5, 20.0, 0.5, 0.0, 810.0, 1600.0, 200.0]);
    assert_eq!(read("G28 X", &mut conversation), [0.0, 20.0, 0.5, 0.0, 0.0, 1600.0, 200.0]);
}

#[test]
fn corexy_motors_are_reported_as_a_and_b() {
    let machine = machine(&profile("corexy"));
    let mut conversation = Conversation::new(&machine);
    conversation.say("G28");
    conversation.say("G1 X290 F6000");
    conversation.say("M400");
    let replies = conversation.say("M114");
    assert_eq!(replies, ["X:290.00 Y:300.00 Z:0.00 E:0.00 Count A:94400 B:-1600 Z:0", "ok"]);
}

#[test]
fn firmware_report_and_capabilities() {
    let machine = machine(&profile("prusa-mini"));
    let mut conversation = Conversation::new(&machine);
    let replies = conversation.say("M115");
    let (ok, replies) = replies.split_last().unwrap();
    assert_eq!(ok, "ok");
    // OctoPrint: a key in capitals after a blank, its value up to the next key.
    let keys = regex(r"(?:^|\s)([A-Z][A-Z0-9_]*):");
    let keys: Vec<String> = keys.captures_iter(&replies[0]).map(|found| found[1].to_owned()).collect();
    for key in ["FIRMWARE_NAME", "PROTOCOL_VERSION", "MACHINE_TYPE", "KINEMATICS", "EXTRUDER_COUNT", "UUID"] {
        assert!(keys.iter().any(|found| found == key), "{key} in {replies:?}");
    }
    assert!(replies[0].contains("MACHINE_TYPE:prusa-mini ") && replies[0].contains("EXTRUDER_COUNT:1"), "{replies:?}");
    let version =
        regex(r"^FIRMWARE_NAME:Ferrostep \d+\.\d+\.\d+ \(commit ([0-9a-f]{7,}(-dirty)?|unknown)\) PROTOCOL_VERSION:");
    assert!(version.is_match(&replies[0]), "{replies:?}");
    assert!(replies[0].contains(&format!("Ferrostep {} ", ferrostep_session::VERSION)), "{replies:?}");
    // The sources' address once the project has one, and until then no empty word.
    let manifest = std::fs::read_to_string(repository().join("Cargo.toml")).unwrap();
    let address = manifest.lines().find_map(|line| line.strip_prefix("repository = \"")?.strip_suffix('"')).unwrap();
    let named = keys.iter().any(|key| key == "SOURCE_CODE_URL");
    assert_eq!(named, !address.is_empty(), "{replies:?}");
    assert!(address.is_empty() || replies[0].contains(&format!(" SOURCE_CODE_URL:{address} ")), "{replies:?}");
    let capability = regex(r"^Cap:([A-Z0-9_]+):([01])$");
    let capabilities: Vec<(String, bool)> = replies
        .iter()
        .filter_map(|line| capability.captures(line))
        .map(|found| (found[1].to_owned(), &found[2] == "1"))
        .collect();
    let has = |name: &str| capabilities.iter().find(|(found, _)| found == name).map(|(_, has)| *has);
    assert_eq!(has("AUTOREPORT_TEMP"), Some(true));
    assert_eq!(has("ARCS"), Some(true));
    assert_eq!(has("Z_PROBE"), Some(true));
    assert!(replies[0].ends_with(" UUID:46737001-5649-5254-5541-4c424f415244"), "{replies:?}");
    // No bytes are read ahead here, and the answer says so.
    assert_eq!(has("EMERGENCY_PARSER"), Some(false));
    let area = "area:{full:{min:{x:-2.00,y:-3.00,z:0.00},max:{x:180.40,y:180.00,z:185.00}}";
    assert!(replies.last().unwrap().starts_with(area), "{replies:?}");
    assert_eq!(replies.len(), 1 + capabilities.len() + 1);
}

#[test]
fn end_stop_report() {
    for (name, names) in [
        ("cartesian", ["x_min", "y_min", "z_min"]),
        ("corexy", ["x_max", "y_max", "z_min"]),
        ("prusa-mini", ["x_max", "y_min", "z_probe"]),
    ] {
        let machine = machine(&profile(name));
        let mut conversation = Conversation::new(&machine);
        let expect = |states: [&str; 3]| {
            let lines = names.iter().zip(states).map(|(name, state)| format!("{name}: {state}"));
            let first = "Reporting endstop status".to_owned();
            [first].into_iter().chain(lines).chain(["ok".to_owned()]).collect::<Vec<_>>()
        };
        assert_eq!(conversation.say("M119"), expect(["open"; 3]), "{name}");
        // The MINI homes Z with X and Y homed only, and ends above the bed.
        conversation.say(if name == "prusa-mini" { "G28" } else { "G28 X Z" });
        conversation.say("G1 Z0 F300");
        conversation.say("M400");
        // A stall is over when the motor is at rest.
        let x = if name == "prusa-mini" { "open" } else { "TRIGGERED" };
        assert_eq!(conversation.say("M119"), expect([x, "open", "TRIGGERED"]), "{name}");
        conversation.say("G1 Z2 F300");
        conversation.say("M400");
        assert_eq!(conversation.say("M119"), expect([x, "open", "open"]), "{name}");
    }
}

/// Queries report the settings that were made.
#[test]
fn settings() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    let off = "echo:  Min:  X0.00 Y0.00 Z0.00   Max:  X200.00 Y200.00 Z200.00";
    for (set, query, answer) in [
        ("M220 S80", "M220", vec!["FR:80%"]),
        ("M221 S95", "M221", vec!["echo:E0 Flow: 95%"]),
        ("M113 S5", "M113", vec!["echo:M113 S5"]),
        ("M302 S160", "M302", vec!["echo:Cold extrudes are disabled (min temp 160C)"]),
        ("M302 P1", "M302", vec!["echo:Cold extrudes are enabled (min temp 160C)"]),
        ("M211 S0", "M211", vec!["echo:; Soft endstops:", "echo:  M211 S0 ; OFF", off]),
    ] {
        let before = conversation.say(query);
        assert_eq!(conversation.say(set), ["ok"], "{set}");
        let after = conversation.say(query);
        assert_ne!(before, after, "{set} changes something");
        assert_eq!(after, [answer, vec!["ok"]].concat(), "{query}");
    }
    assert_eq!(conversation.say("M118 E1 hello"), ["echo:hello", "ok"]);
    assert_eq!(conversation.say("M118 A1 action:pause"), ["//action:pause", "ok"]);
    assert_eq!(conversation.say("M118 hello"), ["hello", "ok"]);
    assert_eq!(conversation.say("M117 printing"), ["//action:notification printing", "ok"]);
}

/// Hosts forgive lines that begin with `Error:` only if they are about line numbers and checksums.
#[test]
fn notices_are_not_errors() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    conversation.say("G28");
    for line in ["G1 X500", "G1 X5 E5", "G1 X..", "T3", "M7777", "M104 S900", "G2 X5 Y5", "G1 X6000", "%"] {
        let replies = conversation.say(line);
        assert!(replies.len() >= 2, "{line:?} deserves a word: {replies:?}");
        let forgiven = |reply: &String| !reply.starts_with("Error") && !reply.starts_with("!!") && reply != "start";
        assert!(replies.iter().all(forgiven), "{line:?}: {replies:?}");
    }
}

#[test]
fn the_desk_refuses_to_measure_times() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    for line in ["M798", "M798 S1", "M798 R"] {
        assert_eq!(conversation.say(line), ["echo:timing: this machine has no timer", "ok"], "{line}");
    }
    assert_eq!(conversation.say("M798 S2"), ["echo:line 4: S: 2 is out of range, expected 0 to 1", "ok"]);
}

/// A board that notes its calls.
#[derive(Debug, Default)]
struct Noted(RefCell<Vec<&'static str>>);

impl Timing for Noted {
    fn switch(&self, on: bool) {
        self.0.borrow_mut().push(if on { "on" } else { "off" });
    }

    fn clear(&self) {
        self.0.borrow_mut().push("clear");
    }

    fn figures(&self) -> [TimingFigures; 3] {
        ["a", "b", "c"].map(|name| TimingFigures { name, unit: "ticks", ..TimingFigures::default() })
    }
}

#[test]
fn m798_s1_clears_earlier_times() {
    let machine = machine(&profile("cartesian"));
    let board = Noted::default();
    let mut printer = machine.printer();
    printer.set_timing(&board);
    for (line, asked) in [
        ("M798 S1", vec!["clear", "on"]),
        ("M798 S1 R", vec!["clear", "on"]),
        ("M798 R", vec!["clear"]),
        ("M798 R S0", vec!["off", "clear"]),
        ("M798 S0", vec!["off"]),
    ] {
        machine.run(printer.execute(1, line)).unwrap();
        assert_eq!(board.0.take(), asked, "{line}");
        assert_eq!(machine.replies().take(), ["ok"], "{line}");
    }
    machine.run(printer.execute(1, "M798")).unwrap();
    assert!(board.0.take().is_empty());
    let lines = ["a", "b", "c"].map(|name| format!("echo:timing {name} count:0 p50:0 p99:0 p99.9:0 max:0 unit:ticks"));
    assert_eq!(machine.replies().take(), [lines.as_slice(), &["ok".to_owned()]].concat());
}
