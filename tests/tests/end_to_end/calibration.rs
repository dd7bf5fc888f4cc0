//! `calibrate`: from a measurement to keys of a profile.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;

use crate::command::{directory, ferrostep, file, repository};

/// A record by RepRapFirmware of X, whose frame swings at 60 Hz with a damping of 0.08: every 0.1 s the acceleration changes.
fn record() -> String {
    let (omega, damping, rate_hz) = (TAU * 60.0, 0.08, 1600.0);
    let mut text = "Sample,X,Y,Z\n".to_owned();
    let (mut place, mut speed) = (0.0, 0.0);
    let (mut random, mut acceleration) = (1_u64, 0.0);
    for sample in 0..48_000 {
        // Knuth's generator of numbers that look random.
        if sample % 160 == 0 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            acceleration = (random >> 60) as f64 * 300.0;
        }
        let mut of_mass = 0.0;
        for _ in 0..10 {
            let h = 1.0 / (10.0 * rate_hz);
            speed += h * (-2.0 * damping * omega * speed - omega * omega * place - acceleration);
            place += h * speed;
            of_mass = -2.0 * damping * omega * speed - omega * omega * place;
        }
        writeln!(text, "{sample},{:.5},{:.5},1.00000", of_mass / 9806.65, 0.02 * of_mass / 9806.65).unwrap();
    }
    writeln!(text, "Rate {rate_hz:.0}, overflows 0").unwrap();
    text
}

#[test]
fn a_record_becomes_keys_that_a_profile_takes() {
    let directory = directory();
    let record = file(&directory, "x.csv", record());
    let plot = directory.path().join("x.svg");
    let arguments = ["calibrate", "shaper", record.to_str().unwrap(), "--plot", plot.to_str().unwrap()];
    let outcome = ferrostep(arguments);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let json = ferrostep(arguments.into_iter().chain(["--json"])).json();
    let frequency_hz = json["mode"]["frequency_hz"].as_f64().unwrap();
    let uncertainty_hz = json["mode"]["frequency_uncertainty_hz"].as_f64().unwrap();
    assert!((frequency_hz - 60.0).abs() < uncertainty_hz.min(2.0), "{json:#}");
    let (_, keys) = outcome.stdout.split_once("In the profile:\n\n").unwrap();
    let profile = fs::read_to_string(repository().join("profiles/cartesian.toml")).unwrap();
    let own = file(&directory, "own.toml", format!("{profile}\n{keys}"));
    let job = file(&directory, "job.gcode", "G28\nG1 X50 F6000\n");
    let printed = ferrostep(["print", job.to_str().unwrap(), "--profile", own.to_str().unwrap()]);
    assert_eq!(printed.status, Some(0), "{printed:#?}");
    let drawn = fs::read_to_string(&plot).unwrap();
    assert_eq!(drawn.matches("<path d=\"M").count(), 2 + 9, "{drawn}");
    assert!(drawn.contains("as recorded"), "{drawn}");
}

#[test]
fn waves_on_a_print_become_keys() {
    let outcome =
        ferrostep(["calibrate", "shaper", "--axis", "y", "--waves", "5", "--over-mm", "10.2", "--speed", "100"]);
    assert!(outcome.stdout.contains("frame in Y  49.02 Hz +- 1.44 Hz"), "{}", outcome.stdout);
    assert!(outcome.stdout.contains("[input_shaper.y]\nkind = \"zv\"\nfrequency_hz = 49.0\n"), "{}", outcome.stdout);
}

#[test]
fn what_measures_nothing_is_refused_and_no_plot_is_left() {
    let directory = directory();
    let good = file(&directory, "good.csv", record());
    let job = file(&directory, "job.gcode", "G28\n");
    let plot = directory.path().join("plot.svg");
    let good = good.to_str().unwrap();
    for (arguments, says) in [
        (&[good, "--axis", "y"][..], "this is a record of X"),
        (&[job.to_str().unwrap()], "line 1: \"G28\": expected a record of an accelerometer"),
        (&["nowhere.csv"], "nowhere.csv: "),
        (&[], "expected a record of an accelerometer, or --waves, --over-mm and --speed"),
        (&["--waves", "5", "--over-mm", "10"], "expected a record of an accelerometer, or --waves"),
        (&["--waves", "5", "--over-mm", "0", "--speed", "100"], "these waves are no frequency between 10 and 200 Hz"),
        (
            &["--waves", "5", "--over-mm", "10", "--speed", "100", "--plot", plot.to_str().unwrap()],
            "--plot draws a record",
        ),
        (&[good, "--waves", "5"], "cannot be used with"),
        (&[good, "--plot", good], "the record"),
    ] {
        let outcome = ferrostep(["calibrate", "shaper"].into_iter().chain(arguments.iter().copied()));
        assert_eq!(outcome.status, Some(2), "{arguments:?} {outcome:#?}");
        assert!(outcome.stderr.contains(says), "{arguments:?} {outcome:#?}");
        assert!(!plot.exists());
    }
    assert_eq!(fs::read_to_string(good).unwrap(), record());
}
