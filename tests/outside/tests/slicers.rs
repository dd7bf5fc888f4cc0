//! PrusaSlicer and CuraEngine slice with the printers of `examples/slicers/`, and the jobs print to
//! their end without remarks.
//!
//! `cargo xtask test` installs both, where it can, and names the folder of Cura's definitions in
//! `FERROSTEP_CURA`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::Command;

use ferrostep_testkit::program::{program, scratch};
use ferrostep_testkit::slicers::{MACHINES, bundle, definition, folder};
use serde_json::Value;

/// Runs a slicer; returns its output.
#[track_caller]
fn run(slicer: &mut Command, package: &str) -> String {
    let output = slicer.output().unwrap_or_else(|error| {
        let name = slicer.get_program().display();
        panic!("{name}: {error}; install it (Debian: apt-get install {package}), or leave out the tests of `slicers`")
    });
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{slicer:?}: {said}");
    said
}

/// Prints a sliced file, makes the checks for all slicers' files, and returns the report.
#[track_caller]
fn print(file: &Path, profile: &str) -> Value {
    let output =
        Command::new(program()).arg("print").arg(file).args(["--profile", profile, "--json"]).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["unknown_commands"], serde_json::json!([]), "{result}");
    assert_eq!(result["clamped_moves"], 0, "{result}");
    assert_eq!(result["underruns"], 0, "{result}");
    assert!(result["lines"].as_u64().unwrap() > 2000, "{result}");
    result
}

/// The number after a key in a slicer's comments.
#[track_caller]
fn number_after(text: &str, key: &str) -> f64 {
    let rest = text.split_once(key).unwrap_or_else(|| panic!("no {key:?}")).1;
    let number: String = rest.chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
    number.parse().unwrap()
}

/// Seconds of a duration as PrusaSlicer writes it, `1h 2m 3s`.
fn seconds(duration: &str) -> f64 {
    duration
        .split_whitespace()
        .map(|part| {
            let (number, unit) = part.split_at(part.len() - 1);
            let unit_s = match unit {
                "s" => 1.0,
                "m" => 60.0,
                "h" => 3600.0,
                _ => panic!("{duration}"),
            };
            number.parse::<f64>().unwrap() * unit_s
        })
        .sum()
}

/// Slices the cube by PrusaSlicer for a machine, with more settings.
#[track_caller]
fn slice_by_prusa_slicer(name: &str, more: &str, scratch: &Path) -> PathBuf {
    let bundle = bundle();
    // The command takes one flat file of settings: the presets of the window make the same file.
    let presets = ["print:0.20 mm - Ferrostep", "filament:PLA - Ferrostep", &format!("printer:{name}")]
        .map(|section| &bundle[section]);
    let settings: String = presets.into_iter().flatten().map(|(key, value)| format!("{key} = {value}\n")).collect();
    let (flat, sliced) = (scratch.join("settings.ini"), scratch.join("cube.gcode"));
    std::fs::write(&flat, settings + more).unwrap();
    let mut slice = Command::new("prusa-slicer");
    slice.arg("--load").arg(&flat).arg("--export-gcode").arg("-o").arg(&sliced).arg(folder().join("cube.stl"));
    run(&mut slice, "prusa-slicer");
    sliced
}

#[test]
fn prusa_slicer_slices_a_cube_for_every_machine_and_it_prints() {
    let scratch = scratch();
    for (name, _, profile) in MACHINES {
        let sliced = slice_by_prusa_slicer(name, "", scratch.path());
        let result = print(&sliced, profile);
        let text = std::fs::read_to_string(&sliced).unwrap();
        // The purge line of the start code, 21.5 mm of filament, is not in the slicer's figure.
        let filament_mm = number_after(&text, "; filament used [mm] = ") + 21.5;
        let ours_mm = result["filament_mm"].as_f64().unwrap();
        assert!((ours_mm - filament_mm).abs() < 0.01 * filament_mm, "{name}: {ours_mm} mm, the slicer {filament_mm}");
        // PrusaSlicer plans with classic corner speeds, unlike Ferrostep.
        let estimate = text.split_once("; estimated printing time (normal mode) = ").unwrap().1.lines().next().unwrap();
        let (ours_s, estimate_s) = (result["motion_time_s"].as_f64().unwrap(), seconds(estimate));
        assert!((ours_s / estimate_s - 1.0).abs() < 0.1, "{name}: {ours_s} s, the slicer {estimate_s}");
    }
}

/// PrusaSlicer calls `post-process` as its script: the file has the print's time, and the same
/// steps.
#[test]
fn prusa_slicer_has_the_time_written_into_its_file() {
    let (corrected_in, sliced_in) = (scratch(), scratch());
    let (name, _, profile) = MACHINES[0];
    let script = format!("post_process = {} post-process --profile {profile}\n", program().display());
    let corrected = slice_by_prusa_slicer(name, &script, corrected_in.path());
    let sliced = slice_by_prusa_slicer(name, "", sliced_in.path());
    let result = print(&corrected, profile);
    assert_eq!(result["step_digest"], print(&sliced, profile)["step_digest"]);
    let [text, before] = [&corrected, &sliced].map(|file| std::fs::read_to_string(file).unwrap());
    let estimate = |text: &str| {
        let rest = text.split_once("; estimated printing time (normal mode) = ").unwrap().1;
        seconds(rest.lines().next().unwrap())
    };
    let ours_s = result["print_time_s"].as_f64().unwrap();
    // Heaters at rest keep their temperature in an estimate, which can take seconds less.
    assert!((estimate(&text) - ours_s).abs() <= 5.0, "{} s, expected {ours_s} s", estimate(&text));
    assert!((estimate(&before) - ours_s).abs() > 5.0, "the slicer's own time is another one");
    let minutes =
        |text: &str| text.lines().find_map(|line| line.strip_prefix("M73 P0 R")?.parse::<f64>().ok()).unwrap();
    assert!((minutes(&text) - ours_s / 60.0).abs() <= 0.6, "{}", minutes(&text));
}

/// The folder above Cura's definitions: that of `FERROSTEP_CURA`, or the one of Debian's package.
fn cura_resources() -> PathBuf {
    let folder = std::env::var_os("FERROSTEP_CURA").map_or_else(|| "/usr/share/cura/resources".into(), PathBuf::from);
    assert!(
        folder.join("definitions/fdmprinter.def.json").is_file(),
        "{}: no definitions of Cura's; install them (Debian: apt-get install cura) or name their folder in FERROSTEP_CURA, \
         as `cargo xtask test` does",
        folder.display()
    );
    folder
}

#[test]
fn cura_engine_slices_a_cube_for_every_machine_and_it_prints() {
    let cura = cura_resources();
    let ours = folder().join("cura");
    let search = std::env::join_paths([
        ours.join("definitions"),
        ours.join("extruders"),
        cura.join("definitions"),
        cura.join("extruders"),
    ])
    .unwrap();
    let scratch = scratch();
    for (name, file, profile) in MACHINES {
        let definition = definition(file);
        let sliced = scratch.path().join("cube.gcode");
        let mut slice = Command::new("CuraEngine");
        slice.env("CURA_ENGINE_SEARCH_PATH", &search).args(["slice", "-v"]);
        slice.arg("-j").arg(ours.join(format!("definitions/{file}.def.json")));
        // Cura's window fills in the start code and works out these settings; the engine
        // alone does neither.
        for key in ["machine_start_gcode", "machine_end_gcode"] {
            let code = definition["overrides"][key]["default_value"].as_str().unwrap();
            let code = code
                .replace("{material_bed_temperature_layer_0}", "60")
                .replace("{material_print_temperature_layer_0}", "215");
            slice.arg("-s").arg(format!("{key}={code}"));
        }
        for setting in [
            "material_bed_temp_prepend=false",
            "material_print_temp_prepend=false",
            "center_object=true",
            "wall_line_count=3",
            "infill_line_distance=4",
            "roofing_layer_count=0",
            "relative_extrusion=true",
        ] {
            slice.arg("-s").arg(setting);
        }
        slice.arg("-o").arg(&sliced).arg("-e0").arg("-l").arg(folder().join("cube.stl"));
        let said = run(&mut slice, "cura-engine");
        let result = print(&sliced, profile);
        // The engine says the figure at its end; the file begins with that of a print of nothing,
        // which Cura's window replaces. The purge line, and 2 mm back at the end.
        let filament_mm = number_after(&said, ";Filament used: ") * 1000.0 + 21.5 - 2.0;
        let ours_mm = result["filament_mm"].as_f64().unwrap();
        assert!((ours_mm - filament_mm).abs() < 0.01 * filament_mm, "{name}: {ours_mm} mm, the slicer {filament_mm}");
    }
}
