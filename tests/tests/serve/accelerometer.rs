//! The served printer's accelerometer: a host shakes an axis, and `calibrate shaper` finds the
//! frame that the profile has.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use ferrostep_testkit::program::{program, repository};
use ferrostep_testkit::served::printer::{Host, Printer};
use serde_json::Value;
use tempfile::TempDir;

/// The frame of X and Y, Hz.
const FRAME_HZ: [f64; 2] = [52.3, 38.7];

/// Samples a second.
const RATE_HZ: f64 = 800.0;

fn folder() -> TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

/// A machine that knows its frame.
fn profile(folder: &TempDir) -> PathBuf {
    let mut text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    for (axis, frequency_hz) in ["x", "y"].into_iter().zip(FRAME_HZ) {
        text +=
            &format!("\n[frame.{axis}]\nfrequency_hz = {frequency_hz}\nfrequency_uncertainty_hz = 1\ndamping = 0.06\n");
    }
    let path = folder.path().join("framed.toml");
    fs::write(&path, text).unwrap();
    path
}

fn printer(profile: &Path) -> Printer {
    Printer::at_tcp(&["--profile", profile.to_str().unwrap(), "--speed", "max"])
}

/// A host that has heard the printer's start.
fn connected(printer: &Printer) -> Host {
    let mut host = printer.connect();
    host.say("M110 N0");
    host
}

/// Shakes an axis to and fro, half a second each at frequencies around its own, and returns
/// everything that the printer has said.
fn shake(host: &mut Host, axis: usize) -> String {
    let letter = ['X', 'Y'][axis];
    let middle_hz = FRAME_HZ[axis].round();
    let mut said = Vec::new();
    let mut say = |line: &str| said.extend(host.say(line));
    say("M956 P0 S65535 A1");
    for half_hz in -36..=50 {
        let frequency_hz = middle_hz + f64::from(half_hz) / 2.0;
        // A move from rest to rest over a length L at an acceleration a takes 2 (L/a)^0.5,
        // half of a period.
        let acceleration = 100.0 * frequency_hz;
        let length_mm = acceleration / (16.0 * frequency_hz * frequency_hz);
        say(&format!("M204 T{acceleration}"));
        for _ in 0..(frequency_hz / 2.0) as u32 {
            say(&format!("G1 {letter}{:.4}", 100.0 + length_mm));
            say(&format!("G1 {letter}100"));
        }
    }
    say("M400");
    say("M956 S0");
    // Lines that the port sends after the last answer come before the next one.
    say("M400");
    said.join("\n")
}

fn calibrate(record: &Path, axis: &str) -> Output {
    let arguments = ["calibrate", "shaper", record.to_str().unwrap(), "--axis", axis, "--json"];
    Command::new(program()).args(arguments).output().unwrap()
}

#[test]
fn a_host_that_shakes_an_axis_finds_its_frame() {
    let folder = folder();
    let printer = printer(&profile(&folder));
    let mut host = connected(&printer);
    let settings = "Accelerometer 0 type ADXL345 with orientation 20 samples at 800Hz with 13-bit resolution";
    assert_eq!(host.say("M955 P0 S700"), [settings, "ok"]);
    assert!(host.say("M955 S5000")[0].contains("S: 5000 is out of range, expected 25 to 3200"));
    assert_eq!(host.say("M955"), [settings, "ok"]);
    for line in ["G28", "G1 X100 Y100 F6000", "M201 X20000 Y20000", "M400"] {
        host.say(line);
    }
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        let said = shake(&mut host, axis);
        let samples = said.lines().filter(|line| line.starts_with(|first: char| first.is_ascii_digit())).count();
        assert!((30_000..60_000).contains(&samples), "{samples} samples");
        assert_eq!(said.matches("Rate 800, overflows 0").count(), 1, "{}", said.get(said.len() - 500..).unwrap());
        let record = folder.path().join(format!("{name}.log"));
        fs::write(&record, &said).unwrap();
        let output = calibrate(&record, name);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let measured: Value = serde_json::from_slice(&output.stdout).unwrap();
        let frequency_hz = measured["mode"]["frequency_hz"].as_f64().unwrap();
        let away_hz = frequency_hz - FRAME_HZ[axis];
        println!("{name}: {frequency_hz:.3} Hz of {} Hz", FRAME_HZ[axis]);
        assert!(away_hz.abs() < 0.5, "{frequency_hz} Hz, and the frame is at {} Hz", FRAME_HZ[axis]);
        let source = measured["source"].as_str().unwrap();
        assert!(source.ends_with(&format!("of {RATE_HZ:.0} samples a second")), "{source}");

        // The record of the other axis is recognised by its contents.
        let other = ["y", "x"][axis];
        let output = calibrate(&record, other);
        assert_ne!(output.status.code(), Some(0));
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(message.contains(&format!("give --axis {name}")), "{message}");
    }
    printer.end();
}

#[test]
fn what_cannot_be_recorded_is_refused_by_its_name() {
    let folder = folder();
    let framed = printer(&profile(&folder));
    let mut host = connected(&framed);
    for (line, says) in [
        ("M956", "M956: expected S with the number of samples"),
        ("M956 S100 X", "M956 of some axes: not supported, a record has X, Y and Z; name all of them or none"),
        ("M956 S70000", "S: 70000 is out of range, expected 0 to 65535"),
        ("M956 P1 S100", "P: 1 is out of range, expected 0 to 0"),
    ] {
        let said = host.say(line);
        assert!(said[0].ends_with(says) && said.len() == 2, "{said:?}");
    }
    let mut said = host.say("M956 S1000");
    said.extend(host.say("G4 S2"));
    let record = folder.path().join("short.csv");
    fs::write(&record, said.join("\n")).unwrap();
    let output = calibrate(&record, "x");
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("s long, expected at least 2 s: record more samples"), "{message}");
    framed.end();

    let plain = Printer::at_tcp(&["--profile", "cartesian", "--speed", "max"]);
    let mut host = connected(&plain);
    for line in ["M955", "M956 S100"] {
        let said = host.say(line);
        assert!(
            said[0].contains("this board has no accelerometer: a board has one where its file has the table"),
            "{said:?}"
        );
    }
    plain.end();
}
