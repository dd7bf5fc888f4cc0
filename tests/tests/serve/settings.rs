//! Settings of the served printer: stored, switched off, on again.

use std::path::Path;
use std::process::Command;

use ferrostep_testkit::program::{program, repository};
use ferrostep_testkit::served::printer::{Host, Printer};

/// The commands that M503 reports.
fn reported(host: &mut Host) -> Vec<String> {
    let lines = host.say("M503");
    lines.iter().filter_map(|line| line.strip_prefix("echo:  ")).map(str::to_owned).collect()
}

fn at(file: &Path) -> Printer {
    Printer::at_tcp(&["--profile", "prusa-mini", "--speed", "max", "--settings", file.to_str().unwrap()])
}

#[test]
fn settings_are_there_when_the_printer_is_switched_on_again() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let file = folder.path().join("settings");
    let changes = [
        "M92 E330",
        "M203 X150.5",
        "M906 Z300",
        "M913 Z5",
        "M914 X120",
        "M593 X F48 P\"ei\"",
        "M900 K0.055",
        "M851 Z-1.25",
        "M569 S0 Y",
    ];
    let printer = at(&file);
    let mut host = printer.connect();
    assert!(host.say("M115").contains(&"Cap:EEPROM:1".to_owned()));
    let of_profile = reported(&mut host);
    for line in changes {
        assert_eq!(host.say(line), ["ok"], "{line}");
    }
    let changed = reported(&mut host);
    assert_ne!(changed, of_profile);
    let said = host.say("M500");
    assert!(said[0].starts_with("echo:Settings Stored (") && said.len() == 2, "{said:?}");
    host.say("M906 Z250");
    printer.end();

    let printer = at(&file);
    let mut host = printer.connect();
    assert_eq!(reported(&mut host), changed);
    // A host sends what M503 has printed: the machine is as its profile again.
    for line in &of_profile {
        assert_eq!(host.say(line), ["ok"], "{line}");
    }
    assert_eq!(reported(&mut host), of_profile);
    assert_eq!(host.say("M501"), ["echo:stored settings retrieved (10 values, 0 faults)", "ok"]);
    assert_eq!(reported(&mut host), changed);
    assert_eq!(host.say("M502"), ["echo:Hardcoded Default Settings Loaded", "ok"]);
    assert_eq!(reported(&mut host), of_profile);
    // M500 stores nothing while a heater is on.
    host.say("M140 S40");
    assert!(host.say("M500")[0].starts_with("echo:M500: nothing is stored while heaters are on"));
    host.say("M140 S0");
    assert!(host.say("M500")[0].starts_with("echo:Settings Stored ("));
    assert_eq!(host.say("M504"), ["echo:M504: stored are 0 values, 0 faults", "ok"]);
    printer.end();
}

/// The rows of the mesh.
fn mesh_of(host: &mut Host) -> Vec<String> {
    let lines = host.say("M420 V");
    lines.into_iter().skip_while(|line| !line.contains("Grid")).take_while(|line| !line.starts_with("echo:")).collect()
}

/// Slicers write M420 S1 after G28, for the mesh that M500 has stored.
#[test]
fn a_mesh_is_there_when_the_printer_is_switched_on_again() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let file = folder.path().join("settings");
    let printer = at(&file);
    let mut host = printer.connect();
    assert!(host.say("G28").contains(&"ok".to_owned()));
    assert!(host.say("G29").contains(&"echo:Bed Leveling ON".to_owned()));
    assert_eq!(host.say("M421 I1 J2 Z0.123"), ["ok"]);
    assert!(host.say("M420 Z7").contains(&"echo:Fade Height 7.00".to_owned()));
    let measured = mesh_of(&mut host);
    assert_eq!(measured.len(), 6, "a heading, numbers and four rows: {measured:#?}");
    assert!(host.say("M503").iter().any(|line| line.starts_with("echo:; Bed Leveling: a mesh of 4 x 4 points")));
    assert!(host.say("M500")[0].starts_with("echo:Settings Stored ("));
    printer.end();

    let printer = at(&file);
    let mut host = printer.connect();
    let stored = "0 values, 0 faults, a mesh of 4 x 4 points";
    assert!(host.say("M504").contains(&format!("echo:M504: stored are {stored}")));
    assert!(host.say("G28").contains(&"ok".to_owned()));
    assert_eq!(host.say("M420"), ["echo:Bed Leveling OFF", "echo:Fade Height 7.00", "ok"]);
    assert_eq!(host.say("M420 S1"), ["echo:Bed Leveling ON", "echo:Fade Height 7.00", "ok"]);
    assert_eq!(mesh_of(&mut host), measured);
    // Statistics of the print and its motion are stored beside the mesh, and leave it unchanged.
    host.say("M84");
    assert_eq!(host.say("M502"), ["echo:Hardcoded Default Settings Loaded", "ok"]);
    assert!(host.say("G28").contains(&"ok".to_owned()));
    let failed = host.say("M420 S1");
    assert!(failed[0].starts_with("echo:Failed to enable Bed Leveling: "), "{failed:?}");
    assert_eq!(host.say("M501"), [&format!("echo:stored settings retrieved ({stored})"), "ok"]);
    assert_eq!(mesh_of(&mut host), measured);
    printer.end();
}

#[test]
fn without_a_memory_a_print_goes_on() {
    let printer = Printer::at_tcp(&["--speed", "max"]);
    let mut host = printer.connect();
    assert!(host.say("M115").contains(&"Cap:EEPROM:0".to_owned()));
    let answer = ["echo:M500, M501, M504: this machine has no memory for settings: write them into the profile", "ok"];
    assert_eq!(host.say("M500"), answer);
    printer.end();
}

#[test]
fn a_file_that_is_something_else_is_refused_and_stays() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let file = folder.path().join("part.gcode");
    std::fs::write(&file, "G28\n").unwrap();
    let out = Command::new(program())
        .args(["serve", "--tcp", "0", "--settings", file.to_str().unwrap()])
        .current_dir(repository())
        .output()
        .unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(!out.status.success() && said.contains("4 bytes, expected 8192: name a file"), "{said}");
    assert_eq!(std::fs::read(&file).unwrap(), b"G28\n");
}
