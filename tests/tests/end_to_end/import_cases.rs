//! `ferrostep import`: configurations, each with one thing that is easily taken for another
//! machine's. A folder of `tests/cases/import` has a configuration and `expect.json`: the
//! expected result.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::end_to_end::command::{directory, ferrostep};

/// The folders of the cases.
fn cases() -> Vec<PathBuf> {
    let folder = ferrostep_testkit::program::repository().join("tests/cases/import");
    let mut cases: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    cases.sort();
    cases
}

#[test]
fn each_case_is_imported_as_the_other_firmware_reads_it() {
    let cases = cases();
    assert!(cases.len() >= 50, "{cases:#?}");
    let failures: Vec<String> = cases
        .iter()
        .flat_map(|case| {
            problems(case).into_iter().map(|problem| format!("{}: {problem}", case.file_name().unwrap().display()))
        })
        .collect();
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Differences between a case's import and its `expect.json`.
fn problems(case: &Path) -> Vec<String> {
    let expected: Value = serde_json::from_str(&std::fs::read_to_string(case.join("expect.json")).unwrap()).unwrap();
    let imported = ferrostep_import::read(&case.join(expected["main"].as_str().unwrap()), false);
    let right = expected.get("exit").and_then(Value::as_i64).unwrap_or(0);
    let imported = match imported {
        Err(_) if expected.get("or_exit").and_then(Value::as_i64) == Some(2) => return Vec::new(),
        Err(error) => {
            let said = error.to_string();
            let named = expected.get("stderr_has").and_then(Value::as_str).unwrap_or_default();
            return if right == 2 && said.contains(named) { Vec::new() } else { vec![format!("refused: {said}")] };
        }
        Ok(_) if right != 0 => return vec!["a profile came out".to_owned()],
        Ok(imported) => imported,
    };
    let profile: toml::Table = imported.profile.parse().unwrap();
    let profile = serde_json::to_value(&profile).unwrap();
    let at =
        |path: &str| path.split('.').try_fold(&profile, |table, key| table.get(key)).cloned().unwrap_or(Value::Null);
    let mut problems = Vec::new();
    let each = |name: &str| expected.get(name).and_then(Value::as_object).cloned().unwrap_or_default();
    for (key, value) in each("keys") {
        if !is_near(&at(&key), &value) {
            problems.push(format!("{key} = {}, expected {value}", at(&key)));
        }
    }
    for (key, ends) in each("range") {
        let [low, high] = [0, 1].map(|end| ends[end].as_f64().unwrap());
        if !at(&key).as_f64().is_some_and(|number| (low..=high).contains(&number)) {
            problems.push(format!("{key} = {}, expected {low} to {high}", at(&key)));
        }
    }
    for (key, value) in each("never") {
        if is_near(&at(&key), &value) {
            problems.push(format!("{key} = {value}"));
        }
    }
    for (key, text) in each("why_not") {
        let rows = imported.rows.iter().filter(|row| row.key == key && row.why.contains(text.as_str().unwrap()));
        problems.extend(rows.map(|row| format!("reason of {key}: {}", row.why)));
    }
    // Each row that counts as kept is in the profile, in all cases.
    for row in &imported.rows {
        let kept: toml::Table = row.kept.as_deref().unwrap_or_default().replace(", ", "\n").parse().unwrap_or_default();
        for (key, value) in flat(&serde_json::to_value(kept).unwrap(), "") {
            if value.is_number() && !is_near(&at(&key), &value) {
                problems.push(format!("{} is kept as {key} = {value}, the profile has {}", row.key, at(&key)));
            }
        }
    }
    if let Some(time) = expected.get("time") {
        problems.extend(wrong_time(case, &imported.profile, time));
    }
    problems
}

/// A job's time that is not the one of the other firmware.
fn wrong_time(case: &Path, profile: &str, expected: &Value) -> Option<String> {
    let directory = directory();
    let path = directory.path().join("imported.toml");
    std::fs::write(&path, profile).unwrap();
    let job = case.join(expected["job"].as_str().unwrap());
    let estimated =
        ferrostep(["estimate".as_ref(), job.as_os_str(), "--profile".as_ref(), path.as_os_str(), "--json".as_ref()]);
    let seconds = estimated.json()["motion_time_s"].as_f64().unwrap();
    let [right, tolerance] = ["motion_s", "tolerance"].map(|key| expected[key].as_f64().unwrap());
    ((seconds - right).abs() > tolerance * right).then(|| format!("{seconds} s, expected {right}"))
}

fn flat(value: &Value, path: &str) -> Vec<(String, Value)> {
    match value {
        Value::Object(table) => table
            .iter()
            .flat_map(|(key, value)| flat(value, &if path.is_empty() { key.clone() } else { format!("{path}.{key}") }))
            .collect(),
        value => vec![(path.to_owned(), value.clone())],
    }
}

fn is_near(found: &Value, expected: &Value) -> bool {
    match (found, expected) {
        (Value::Number(found), Value::Number(expected)) => {
            let (found, expected) = (found.as_f64().unwrap(), expected.as_f64().unwrap());
            (found - expected).abs() <= f64::max(1e-6, 1e-3 * expected.abs())
        }
        (Value::Array(found), Value::Array(expected)) => {
            found.len() == expected.len()
                && found.iter().zip(expected).all(|(found, expected)| is_near(found, expected))
        }
        (Value::Object(found), Value::Object(expected)) => {
            found.len() == expected.len()
                && expected.iter().all(|(key, value)| found.get(key).is_some_and(|found| is_near(found, value)))
        }
        _ => found == expected,
    }
}

/// A machine that the file does not describe is refused with each line; by permission it is
/// assumed, and the status says so.
#[test]
fn what_the_machine_is_is_assumed_by_permission_alone() {
    let case = ferrostep_testkit::program::repository().join("tests/cases/import/k17-steps-beyond-range/printer.cfg");
    let directory = directory();
    let out = directory.path().join("out.toml");
    let refused = ferrostep(["import".as_ref(), case.as_os_str(), "-o".as_ref(), out.as_os_str()]);
    assert_eq!((refused.status, out.exists()), (Some(2), false), "{refused:#?}");
    for part in ["printer.cfg:28: [stepper_z] microsteps = 256", "expected 1 to 10000", "--assume"] {
        assert!(refused.stderr.contains(part), "{part}: {refused:#?}");
    }
    let assumed = ferrostep(["import".as_ref(), case.as_os_str(), "-o".as_ref(), out.as_os_str(), "--assume".as_ref()]);
    assert_eq!((assumed.status, out.exists()), (Some(3), true), "{assumed:#?}");
    assert!(assumed.stdout.starts_with("what the machine is, 1 parts, assumed by --assume:\n"), "{assumed:#?}");
    // A file that was edited is not overwritten.
    let text = std::fs::read_to_string(&out).unwrap().replace("steps_per_mm", "# mine\nsteps_per_mm");
    std::fs::write(&out, &text).unwrap();
    let again = ferrostep(["import".as_ref(), case.as_os_str(), "-o".as_ref(), out.as_os_str(), "--assume".as_ref()]);
    assert_eq!((again.status, std::fs::read_to_string(&out).unwrap()), (Some(2), text), "{again:#?}");
    assert!(again.stderr.contains("was edited"), "{again:#?}");
}

/// The other kinds of a fault: the line with the fault, and the text of the message.
#[test]
fn what_cannot_be_told_is_refused_with_its_line() {
    let text = |case: &str, file: &str| {
        let path = ferrostep_testkit::program::repository().join("tests/cases/import").join(case).join(file);
        std::fs::read_to_string(path).unwrap()
    };
    let (klipper, marlin) = (text("k23-control-plain", "printer.cfg"), text("m24-control-plain", "Configuration.h"));
    let probe = klipper.replace("endstop_pin: ^PA8\nposition_endstop: 0", "endstop_pin: probe:z_virtual_endstop");
    for (name, text, expected) in [
        ("printer.cfg", klipper.replace("ATC Semitec 104GT-2", "MAX31865"), "printer.cfg:42: [extruder] sensor_type"),
        ("printer.cfg", klipper.replace("rotation_distance: 33.5\n", ""), "[extruder] has no rotation_distance"),
        (
            "printer.cfg",
            klipper.replace("rotation_distance: 8\n", "rotation_distance: 0\n"),
            "[stepper_z] rotation_distance = 0",
        ),
        ("printer.cfg", klipper.replace("position_max: 220", "position_max: wide"), "[stepper_x] position_max = wide"),
        ("printer.cfg", probe.clone(), "no section describes one"),
        ("printer.cfg", format!("{probe}[scanner]\nmcu: x\n"), "[scanner] is a probe of another kind"),
        (
            "printer.cfg",
            klipper.replace("endstop_pin: ^PA2", "endstop_pin: tmc5160_stepper_x:virtual_endstop"),
            "TMC2209",
        ),
        ("printer.cfg", format!("\u{feff}{klipper}"), "printer.cfg:1: the file begins with a byte order mark"),
        ("Configuration.h", marlin.replace("INVERT_X_DIR false", "INVERT_X_DIR WHAT"), "INVERT_X_DIR = WHAT"),
        ("Configuration.h", marlin.replace("TEMP_SENSOR_0 1", "TEMP_SENSOR_0 -4"), "TEMP_SENSOR_0 = -4"),
        ("Configuration.h", marlin.replace("X_MAX_POS X_BED_SIZE", "X_MAX_POS SIZE"), "X_MAX_POS = SIZE"),
        ("Configuration.h", format!("{marlin}#endif\n"), "this #endif has no #if"),
        (
            "Configuration.h",
            format!("{marlin}#define USE_PROBE_FOR_Z_HOMING\n#define SOLENOID_PROBE\n"),
            "another kind",
        ),
        ("size.h", "#define A 1\n".to_owned(), "neither Klipper's printer.cfg"),
    ] {
        let error = ferrostep_import::of_text(name, &text, &mut |_| Err("none".to_owned()))
            .map(|_| ())
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

/// Names of files as Python's glob has them, in any part; a file that is not there is named
/// at the beginning.
#[test]
fn included_files_are_found_as_klipper_finds_them() {
    let directory = directory();
    let write = |name: &str, text: &str| {
        let path = directory.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    let plain = ferrostep_testkit::program::repository().join("tests/cases/import/k23-control-plain/printer.cfg");
    let plain = std::fs::read_to_string(plain).unwrap();
    write("printer.cfg", &format!("{plain}[include part?/m[0-9].cfg]\n[include gone.cfg]\n[include none*.cfg]\n"));
    write("parts/m1.cfg", "[stepper_x]\nposition_max:\n  2_21\n[include deep/*.cfg]\n");
    write("parts/mx.cfg", "[stepper_x]\nposition_max: 1\n");
    write("parts/deep/y.cfg", "[stepper_y]\nposition_max: 231\n");
    let outcome = ferrostep(["import".as_ref(), directory.path().join("printer.cfg").as_os_str()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(outcome.stdout.starts_with("not read, 1 files; what they say is missing:\n"), "{outcome:#?}");
    assert!(outcome.stdout.contains("[include gone.cfg] was not read: there is no such file"), "{outcome:#?}");
    for kept in ["size_mm.x = 221.0", "size_mm.y = 231.0"] {
        assert!(outcome.stdout.contains(kept), "{kept}: {outcome:#?}");
    }
}

/// Plain lines become a macro of the profile; for a program, the reason names what it calls.
#[test]
fn macros_of_plain_lines_are_kept() {
    let plain = ferrostep_testkit::program::repository().join("tests/cases/import/k23-control-plain/printer.cfg");
    let plain = std::fs::read_to_string(plain).unwrap();
    let macros = "[gcode_macro start_print]\ngcode:\n  G28\n  M104 S{params.NOZZLE|default(200)|int} ; warm\n\
                  [gcode_macro PURGE]\ngcode:\n  {% if printer.idle %}\n  G1 X5\n  {% endif %}\n";
    let imported =
        ferrostep_import::of_text("printer.cfg", &format!("{plain}{macros}"), &mut |_| Err("none".to_owned())).unwrap();
    let profile: toml::Table = imported.profile.parse().unwrap();
    assert_eq!(profile["macro"]["START_PRINT"]["gcode"].as_str(), Some("\nG28\nM104 S{NOZZLE=200}\n"));
    assert!(profile["macro"].get("PURGE").is_none());
    let purge = imported.rows.iter().find(|row| row.key == "[gcode_macro PURGE] gcode").unwrap();
    assert!(purge.kept.is_none() && purge.why.contains("expects what is in it: G1"), "{purge:#?}");
}

/// A key that cannot be kept takes no table with it that describes the machine: it moves, or the
/// file is refused.
#[test]
fn what_cannot_be_kept_takes_no_identity_with_it() {
    let read = |name: &str| {
        std::fs::read_to_string(ferrostep_testkit::program::repository().join("tests/cases/import").join(name)).unwrap()
    };
    let klipper = read("k23-control-plain/printer.cfg");
    let of = |text: &str| ferrostep_import::of_text("printer.cfg", text, &mut |_| Err("none".to_owned()));
    let keys = |text: &str| of(text).map(|imported| imported.profile.parse::<toml::Table>().unwrap());
    // Homing by stalls more slowly than the driver can measure: both approaches, and the speed up
    // to which it is quiet, move.
    let slow = klipper.replace("endstop_pin: ^PA2", "endstop_pin: tmc2209_stepper_x:virtual_endstop").replacen(
        "[stepper_x]",
        "[tmc2209 stepper_x]\nrun_current: 0.6\ndriver_sgthrs: 80\nstealthchop_threshold: 0\n[stepper_x]\nhoming_speed: 16",
        1,
    );
    let table = keys(&slow).unwrap();
    let homing = &table["homing"]["x"];
    assert_eq!(homing["sensor"].as_str(), Some("stall"));
    assert_eq!((homing["fast_mm_per_s"].as_float(), homing["slow_mm_per_s"].as_float()), (Some(40.0), Some(40.0)));
    assert_eq!(table["drivers"]["x"]["spread_cycle_above_mm_per_s"].as_integer(), Some(50));
    // A pin that would stay on the bed for too long is drawn in before each touch.
    let text = read("k06-bltouch-3-mm/printer.cfg")
        + "[bltouch]\nstow_on_each_sample: false\n[stepper_z]\nhoming_retract_dist: 10\n";
    let imported = of(&text).unwrap();
    let table: toml::Table = imported.profile.parse().unwrap();
    assert_eq!(table["homing"]["z"]["sensor"].as_str(), Some("probe"));
    assert_eq!(table["bltouch"]["stow_each_touch"].as_bool(), Some(true));
    assert!(imported.refused().any(|row| row.key == "[bltouch] stow_on_each_sample"), "{:#?}", imported.rows);
    // A pin may be turned in a file that was not read.
    for (line, expected) in [
        ("dir_pin: PA4\n", "driver.inverted: [stepper_y] has no dir_pin"),
        ("dir_pin: PB1\n", "driver.inverted: [extruder] has no dir_pin"),
    ] {
        let text = klipper.replace(line, "") + "[include rest.cfg]\n";
        let error = of(&text).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("[include rest.cfg] was not read"), "{error}");
    }
    let probe = read("k06-bltouch-3-mm/printer.cfg");
    let place = probe.find("[bltouch]").unwrap();
    let (before, after) = probe.split_at(place);
    let after: String =
        after.lines().filter(|line| !line.starts_with("sensor_pin")).map(|line| format!("{line}\n")).collect();
    let error = of(&format!("{before}{after}[include rest.cfg]\n")).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("homing.z.triggers_low: [bltouch] has no sensor_pin"), "{error}");
    // Marlin homes Z by a probe only where one is defined.
    let marlin = read("m24-control-plain/Configuration.h") + "#define USE_PROBE_FOR_Z_HOMING\n";
    let imported = ferrostep_import::of_text("Configuration.h", &marlin, &mut |_| Err("none".to_owned())).unwrap();
    let table: toml::Table = imported.profile.parse().unwrap();
    assert_eq!(table["homing"]["z"]["sensor"].as_str(), Some("end-stop"));
    let row = imported.rows.iter().find(|row| row.key == "USE_PROBE_FOR_Z_HOMING").unwrap();
    // A chamber does not take the second nozzle's connector.
    let both = read("m24-control-plain/Configuration.h")
        + "#define EXTRUDERS 2\n#define TEMP_SENSOR_1 1\n#define INVERT_E1_DIR true\n#define TEMP_SENSOR_CHAMBER 1\n";
    let both = ferrostep_import::of_text("Configuration.h", &both, &mut |_| Err("none".to_owned())).unwrap();
    let both: toml::Table = both.profile.parse().unwrap();
    assert_eq!((both["tools"]["t1"]["inverted"].as_bool(), both.get("chamber")), (Some(true), None));
    assert!(row.kept.is_none() && row.why.starts_with("no probe is defined"), "{row:#?}");
}

/// Marlin's numbers of sensors, at temperatures of Marlin's tables: the reading there is a degree
/// off at most, within the range that a hot end or a bed uses.
#[test]
fn marlins_sensors_read_as_its_tables_do() {
    let marlin = ferrostep_testkit::program::repository().join("tests/cases/import/m24-control-plain/Configuration.h");
    let marlin = std::fs::read_to_string(marlin).unwrap();
    for (number, pull_up_ohm, lines, most_off) in [
        // Readings of 1024, and degrees.
        (2, 4700.0, [(46.0, 270.0), (148.0, 200.0), (708.0, 100.0), (955.0, 50.0)], 1.0),
        (7, 4700.0, [(109.0, 216.0), (181.0, 183.0), (397.0, 132.0), (793.0, 72.0)], 1.3),
        (14, 4700.0, [(358.0, 120.0), (519.0, 100.0), (742.0, 75.0), (895.0, 50.0)], 1.0),
        (67, 4700.0, [(50.0, 400.0), (143.0, 300.0), (453.0, 200.0), (910.0, 100.0)], 1.1),
        (75, 4700.0, [(455.65, 120.0), (602.19, 100.0), (745.85, 80.0), (906.97, 50.0)], 0.1),
        (99, 10_000.0, [(268.82, 120.0), (397.44, 100.0), (558.03, 80.0), (797.93, 50.0)], 0.1),
    ] {
        let text = marlin.replace("TEMP_SENSOR_0 1\n", &format!("TEMP_SENSOR_0 {number}\n"));
        let imported = ferrostep_import::of_text("Configuration.h", &text, &mut |_| Err("none".to_owned())).unwrap();
        let table: toml::Table = imported.profile.parse().unwrap();
        let nozzle = &table["nozzle"];
        let own = nozzle.get("pull_up_ohm").and_then(|ohm| ohm.as_float()).unwrap_or(4700.0);
        assert!((own - pull_up_ohm).abs() < 1e-9, "{number}: {own}");
        for (reading, celsius) in lines {
            let ohm = pull_up_ohm * reading / (1024.0 - reading);
            let off = temperature(&nozzle["sensor"], ohm) - celsius;
            assert!(off.abs() <= most_off, "{number} at {celsius}: {off}");
        }
    }
    for number in [504, 505] {
        let text = marlin.replace("TEMP_SENSOR_0 1\n", &format!("TEMP_SENSOR_0 {number}\n"));
        let error = ferrostep_import::of_text("Configuration.h", &text, &mut |_| Err("none".to_owned()))
            .unwrap_err()
            .to_string();
        assert!(error.contains(&format!("TEMP_SENSOR_0 = {number}: no sensor that a profile knows")), "{error}");
    }
}

/// The temperature at a resistance by a profile's sensor: by beta, or by Steinhart and Hart's
/// equation through three points.
fn temperature(sensor: &toml::Value, ohm: f64) -> f64 {
    const KELVIN: f64 = 273.15;
    let number = |value: &toml::Value| value.as_float().unwrap();
    if let Some(beta) = sensor.get("beta_k") {
        let r25 = number(&sensor["r25_ohm"]);
        return 1.0 / (1.0 / (25.0 + KELVIN) + (ohm / r25).ln() / number(beta)) - KELVIN;
    }
    let list = |key: &str| sensor[key].as_array().unwrap().iter().map(number).collect::<Vec<f64>>();
    let (celsius, ohms) = (list("celsius"), list("ohm"));
    let x: Vec<f64> = ohms.iter().map(|ohm| ohm.ln()).collect();
    let y: Vec<f64> = celsius.iter().map(|celsius| 1.0 / (celsius + KELVIN)).collect();
    let slope = |i: usize| (y[i] - y[0]) / (x[i] - x[0]);
    let c = (slope(2) - slope(1)) / (x[2] - x[1]) / (x[0] + x[1] + x[2]);
    let b = slope(1) - c * (x[0] * x[0] + x[0] * x[1] + x[1] * x[1]);
    let a = y[0] - b * x[0] - c * x[0].powi(3);
    1.0 / (a + b * ohm.ln() + c * ohm.ln().powi(3)) - KELVIN
}
