//! `calibrate`: from a measurement to keys of a profile.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// A record by RepRapFirmware of X, whose frame swings at 60 Hz with a damping of 0.08: every 0.1 s
/// the acceleration changes.
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
    let profile = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
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
    let frame = "[frame.y]\nfrequency_hz = 49.0\nfrequency_uncertainty_hz = 1.4\ndamping = 0.100\n";
    assert!(outcome.stdout.ends_with(frame), "{}", outcome.stdout);
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
            "--plot draws the record",
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

/// Writes one line with this K, and simulates it on a nozzle whose time constant is 0.04 s:
/// filament misplaced along the line, mm^3.
fn misplaced(directory: &tempfile::TempDir, seconds: &str) -> f64 {
    let path = directory.path().join(format!("k{seconds}.gcode"));
    let lines = path.to_str().unwrap();
    let outcome = ferrostep(["calibrate", "advance", "-o", lines, "--from", seconds, "--lines", "1", "--bed", "0"]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let result = ferrostep(["simulate", lines, "--nozzle-time-constant", "0.04", "--json"]).json();
    result["elsewhere_volume_mm3"].as_f64().unwrap_or_else(|| panic!("{result:#}"))
}

/// The simulator does not use the pattern: the line with the nozzle's own K misplaces least.
#[test]
fn the_best_line_is_that_of_the_nozzle() {
    let directory = directory();
    let of = |seconds| misplaced(&directory, seconds);
    let best = of("0.04");
    for other in ["0", "0.02", "0.03", "0.05", "0.06", "0.08"] {
        assert!(of(other) > 1.5 * best, "{other} {best}");
    }
}

#[test]
fn lines_of_advance_print_on_every_machine_and_their_number_is_a_key() {
    let directory = directory();
    let path = directory.path().join("lines.gcode");
    let lines = path.to_str().unwrap();
    for profile in ["cartesian", "corexy", "prusa-mini"] {
        let written = ferrostep(["calibrate", "advance", "--profile", profile, "-o", lines]);
        assert_eq!(written.status, Some(0), "{written:#?}");
        let printed = ferrostep(["print", lines, "--profile", profile, "--strict"]);
        assert_eq!(printed.status, Some(0), "{profile}: {printed:#?}");
    }
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("; line 9\nM900 K0.0400\n"), "{text}");
    let keys = ferrostep(["calibrate", "advance", "--best", "9"]).stdout;
    assert_eq!(keys, "K is 0.0400 s +- 0.0025 s\n\nIn the profile:\n\n[pressure_advance]\nseconds = 0.0400\n");
    for (arguments, says) in [
        (&["--best", "22"][..], "--best 22: expected a line from 1 to 21 (--lines)"),
        (&["--best", "0"], "expected a line from 1 to 21"),
        (&["--best", "1", "-o", lines], "cannot be used with"),
        (&[], "required"),
        (&["-o", lines, "--lines", "60"], "--lines 60: expected at most 34, for which the bed has room in Y"),
        (&["-o", lines, "--from", "nan"], "--from NaN: expected 0 to"),
        (&["-o", lines, "--step", "0"], "--step 0: expected 0.0001 to"),
        (&["-o", lines, "--step", "0.5"], "--lines 21: expected few enough"),
        (&["-o", lines, "--fast", "900"], "--fast 900: expected 1 to 200 mm/s"),
        (&["-o", lines, "--nozzle", "100"], "--nozzle 100: expected 170 to"),
        (&["-o", lines, "--bed", "200"], "--bed 200: expected 0 to"),
    ] {
        let outcome = ferrostep(["calibrate", "advance"].into_iter().chain(arguments.iter().copied()));
        assert_eq!(outcome.status, Some(2), "{arguments:?} {outcome:#?}");
        assert!(outcome.stderr.contains(says), "{arguments:?} {outcome:#?}");
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), text);
}

/// The tube asks for the flows that it names: a machine that melts a little less reports
/// its fastest moves.
#[test]
fn a_tube_has_the_flows_it_names_on_every_machine() {
    let directory = directory();
    let path = directory.path().join("tube.gcode");
    let tube = path.to_str().unwrap();
    for profile in ["cartesian", "corexy", "prusa-mini"] {
        let words = ["--profile", profile, "-o", tube, "--from", "3", "--step", "0.5", "--bands", "20"];
        let written = ferrostep(["calibrate", "flow"].into_iter().chain(words));
        assert_eq!(written.status, Some(0), "{written:#?}");
        let text = fs::read_to_string(repository().join("config/profiles").join(format!("{profile}.toml"))).unwrap();
        for (melts, status) in [("13.05", 0), ("12.9", 1)] {
            let own = file(&directory, "own.toml", format!("max_volumetric_flow_mm3_per_s = {melts}\n{text}"));
            let printed = ferrostep(["print", tube, "--profile", own.to_str().unwrap(), "--strict"]);
            assert_eq!(printed.status, Some(status), "{profile} {melts}: {printed:#?}");
        }
    }
}

#[test]
fn walls_and_height_of_a_tube_become_keys() {
    let directory = directory();
    let path = directory.path().join("tube.gcode");
    let tube = path.to_str().unwrap();
    let of = |words: &[&str]| ferrostep(["calibrate", "flow"].iter().chain(words));
    // 95 steps/mm; 0.6 mm were meant, with layers of 0.24 mm.
    let right = of(&["--walls", "0.60,0.61,0.60,0.59"]).stdout;
    assert!(right.contains("keep steps_per_mm.e = 95"), "{right}");
    let thick = of(&["--walls", "0.66,0.67,0.66,0.65"]).stdout;
    let factor = (0.36 * 0.24 + 0.0144 * std::f64::consts::PI) / (0.42 * 0.24 + 0.0144 * std::f64::consts::PI);
    assert!(thick.contains("the wall is 0.660 mm +- 0.016 mm, 0.600 mm was meant: 110.9 %"), "{thick}");
    assert!(thick.contains(&format!("\ne = {:.2}\n", 95.0 * factor)), "{thick}");
    assert!(thick.ends_with(&format!("M221 S{:.1}\n", 100.0 * factor)), "{thick}");
    // 30 even layers, then five of each flow: whole up to the end of the third band.
    let melts = of(&["--whole-to-mm", "10.8"]).stdout;
    let expected = "the nozzle melts 7.50 mm^3/s +- 0.50 mm^3/s\n\nIn the profile, what it melts for sure:\n\n\
                    max_volumetric_flow_mm3_per_s = 7.00\n";
    assert_eq!(melts, expected);
    assert_eq!(of(&["--whole-to-mm", "11.8"]).stdout, expected);
    let all = of(&["--whole-to-mm", "26.4"]).stdout;
    assert!(all.contains("20.00 mm^3/s, the most that was tried"), "{all}");
    for (words, says) in [
        (&["--walls", "0.6"][..], "at least two walls"),
        (&["--walls", "0.6,0.1"], "--walls 0.1: expected 0.3"),
        (&["--walls", "0.4,0.9"], "walls that are more alike"),
        (&["--whole-to-mm", "5"], "--whole-to-mm 5: expected 7.2 to 26.4 mm"),
        (&["--whole-to-mm", "27"], "--whole-to-mm 27: expected"),
        (&[], "required"),
        (&["-o", tube, "--whole-to-mm", "9"], "cannot be used with"),
        (&["-o", tube, "--step", "5"], "--bands 16: expected few enough for 26.3 mm^3/s"),
        (&["-o", tube, "--step", "0.05", "--bands", "200"], "--bands 200: expected fewer"),
        (&["-o", tube, "--from", "0"], "--from 0: expected 0.2 to 50 mm^3/s"),
        (&["-o", tube, "--fan", "101"], "--fan 101: expected 0 to 100 %"),
        (&["-o", tube, "--nozzle", "400"], "--nozzle 400: expected 170 to"),
    ] {
        let outcome = of(words);
        assert_eq!(outcome.status, Some(2), "{words:?} {outcome:#?}");
        assert!(outcome.stderr.contains(says), "{words:?} {outcome:#?}");
    }
    assert!(!path.exists());
}

/// The moves accelerate and run as the stages say: a machine prints them in the time that follows.
#[test]
fn moves_of_rising_speed_print_on_every_machine_and_their_stage_is_a_key() {
    let directory = directory();
    let path = directory.path().join("moves.gcode");
    let moves = path.to_str().unwrap();
    for (profile, of, words) in [
        ("cartesian", "acceleration", ["--step", "2000"]),
        ("corexy", "speed", ["--step", "40"]),
        ("prusa-mini", "speed", ["--stages", "4"]),
    ] {
        let written =
            ferrostep(["calibrate", "speed", "--of", of, "--profile", profile, "-o", moves].into_iter().chain(words));
        assert_eq!(written.status, Some(0), "{written:#?}");
        let printed = ferrostep(["print", moves, "--profile", profile, "--strict"]);
        assert_eq!(printed.status, Some(0), "{profile}: {printed:#?}");
    }
    let time_s = |step: &str| {
        let written = ferrostep(["calibrate", "speed", "-o", moves, "--from", "500", "--step", step, "--stages", "3"]);
        assert_eq!(written.status, Some(0), "{written:#?}");
        ferrostep(["estimate", moves, "--json"]).json()["print_time_s"].as_f64().unwrap()
    };
    // The marks take as long; the moves' acceleration is what rises.
    assert!(time_s("4000") < 0.95 * time_s("100"));
    let keys = |words: &[&str]| ferrostep(["calibrate", "speed"].iter().chain(words));
    let expected = "the motors hold 6000 mm/s^2 and lose steps at 7000 mm/s^2\n\nIn the profile's max_acceleration_mm_per_s2, 15 % less, \
                    for motors get weaker as they get hot:\n\nx = 5100, y = 5100\n";
    assert_eq!(keys(&["--good", "6"]).stdout, expected);
    let all = keys(&["--of", "speed", "--good", "10"]).stdout;
    assert!(all.contains("hold 550 mm/s, the most that was tried") && all.contains("max_feed_mm_per_s"), "{all}");
    for (words, says) in [
        (&["--good", "0"][..], "try again below 1000 mm/s^2 (--from)"),
        (&["--good", "11"], "--good 11: expected a stage from 1 to 10 (--stages)"),
        (&["--good", "1", "-o", moves], "cannot be used with"),
        (&[], "required"),
        (&["-o", moves, "--stages", "20"], "--stages 20: expected at most 15, for which the bed has room in X"),
        (&["-o", moves, "--step", "50000"], "--stages 10: expected few enough for at most 100000 mm/s^2"),
        (&["-o", moves, "--profile", "corexy", "--of", "speed", "--step", "200"], "expected few enough for"),
        (&["-o", moves, "--from", "nan"], "--from NaN: expected 1 to"),
        (&["-o", moves, "--bed", "200"], "--bed 200: expected 0 to"),
    ] {
        let outcome = keys(words);
        assert_eq!(outcome.status, Some(2), "{words:?} {outcome:#?}");
        assert!(outcome.stderr.contains(says), "{words:?} {outcome:#?}");
    }
}
