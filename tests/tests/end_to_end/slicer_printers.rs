//! The printers for slicers in `examples/slicers/`: their figures are those of the firmware's profiles, and jobs sliced with them
//! print to their end without remarks.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ferrostep_profiles::load;
use serde_json::Value;

use crate::command::repository;

/// The machines: their name in the slicers, their file for Cura, and the firmware's profile.
const MACHINES: [(&str, &str, &str); 3] = [
    ("Ferrostep Cartesian", "ferrostep_cartesian", "cartesian"),
    ("Ferrostep CoreXY", "ferrostep_corexy", "corexy"),
    ("Ferrostep Prusa MINI", "ferrostep_prusa_mini", "prusa-mini"),
];

const UNITS_PER_MM: f64 = 100_000.0;

fn folder() -> PathBuf {
    repository().join("examples/slicers")
}

/// The sections of PrusaSlicer's bundle: keys and values by the section's name.
fn bundle() -> BTreeMap<String, BTreeMap<String, String>> {
    let text = std::fs::read_to_string(folder().join("prusaslicer/ferrostep.ini")).unwrap();
    let mut sections = BTreeMap::<_, BTreeMap<_, _>>::new();
    let mut section = String::new();
    for line in text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
        if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            section = name.to_owned();
        } else {
            let (key, value) = line.split_once(" = ").unwrap();
            sections.entry(section.clone()).or_default().insert(key.to_owned(), value.to_owned());
        }
    }
    sections
}

/// A printer definition of Cura's.
fn definition(name: &str) -> Value {
    let path = folder().join(format!("cura/definitions/{name}.def.json"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A slicer's figures of a machine, in the order of [`figures_of_profile`].
const PRUSA_SLICER_KEYS: [&str; 11] = [
    "machine_max_feedrate_x",
    "machine_max_feedrate_y",
    "machine_max_feedrate_z",
    "machine_max_feedrate_e",
    "machine_max_acceleration_x",
    "machine_max_acceleration_y",
    "machine_max_acceleration_z",
    "machine_max_acceleration_e",
    "machine_max_acceleration_extruding",
    "machine_max_acceleration_travel",
    "machine_max_acceleration_retracting",
];

fn figures_of_profile(profile: &str) -> Vec<f64> {
    let limits = load(profile).unwrap().limits;
    let mut figures = Vec::from(limits.max_feed_mm_per_s);
    figures.extend(limits.max_acceleration_mm_per_s2);
    figures.extend([
        limits.print_acceleration_mm_per_s2,
        limits.travel_acceleration_mm_per_s2,
        limits.retract_acceleration_mm_per_s2,
    ]);
    figures
}

#[test]
fn the_bundle_for_prusa_slicer_has_the_profiles_figures() {
    let bundle = bundle();
    for (name, _, profile_name) in MACHINES {
        let printer = &bundle[&format!("printer:{name}")];
        let first = |key: &str| printer[key].split(',').next().unwrap().parse::<f64>().unwrap();
        assert_eq!(PRUSA_SLICER_KEYS.map(first).to_vec(), figures_of_profile(profile_name), "{name}");
        let profile = load(profile_name).unwrap();
        assert_eq!(printer["printer_notes"], format!("The firmware's profile: {profile_name}"));
        let corners = printer["bed_shape"].split(',').map(|corner| {
            let (x, y) = corner.split_once('x').unwrap();
            [x.parse::<f64>().unwrap(), y.parse::<f64>().unwrap()]
        });
        for [x, y] in corners {
            assert!(x >= 0.0 && x * UNITS_PER_MM <= profile.size_10nm[0] as f64, "{name}: X{x}");
            assert!(y >= 0.0 && y * UNITS_PER_MM <= profile.size_10nm[1] as f64, "{name}: Y{y}");
        }
        assert_eq!(first("max_print_height") * UNITS_PER_MM, profile.size_10nm[2] as f64, "{name}");
    }
}

#[test]
fn the_definitions_for_cura_have_the_profiles_figures() {
    for (name, file, profile_name) in MACHINES {
        let definition = definition(file);
        assert_eq!(definition["name"], name);
        let value = |key: &str| definition["overrides"][key]["default_value"].as_f64().unwrap();
        let mut figures: Vec<f64> = PRUSA_SLICER_KEYS.iter().take(8).map(|key| value(key)).collect();
        figures.push(value("machine_acceleration"));
        assert_eq!(figures, figures_of_profile(profile_name)[..9], "{name}");
        let profile = load(profile_name).unwrap();
        for (axis, key) in ["machine_width", "machine_depth", "machine_height"].into_iter().enumerate() {
            // A MINI's X ends 0.4 mm after the sheet.
            assert_eq!(value(key), (profile.size_10nm[axis] as f64 / UNITS_PER_MM).floor(), "{name}: {key}");
        }
    }
}

#[cfg(feature = "slicers")]
mod sliced {
    //! Where the slicers are, which `cargo xtask test` sees to.

    use std::path::Path;
    use std::process::Command;

    use super::*;
    use crate::command::ferrostep;

    #[track_caller]
    fn run(command: &mut Command) -> String {
        let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{command:?}: {said}");
        said
    }

    /// Prints a sliced file, makes the checks for all slicers' files, and returns the report.
    #[track_caller]
    fn print(file: &Path, profile: &str) -> Value {
        let outcome = ferrostep(["print", file.to_str().unwrap(), "--profile", profile, "--json"]);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        let result = outcome.json();
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

    #[test]
    fn prusa_slicer_slices_a_cube_for_every_machine_and_it_prints() {
        let bundle = bundle();
        let scratch = tempfile::tempdir().unwrap();
        for (name, _, profile) in MACHINES {
            // The command takes one flat file of settings: the presets of the window make the same file.
            let presets = ["print:0.20 mm - Ferrostep", "filament:PLA - Ferrostep", &format!("printer:{name}")]
                .map(|section| &bundle[section]);
            let settings: String =
                presets.into_iter().flatten().map(|(key, value)| format!("{key} = {value}\n")).collect();
            let (flat, sliced) = (scratch.path().join("settings.ini"), scratch.path().join("cube.gcode"));
            std::fs::write(&flat, settings).unwrap();
            run(Command::new("prusa-slicer")
                .arg("--load")
                .arg(&flat)
                .arg("--export-gcode")
                .arg("-o")
                .arg(&sliced)
                .arg(folder().join("cube.stl")));
            let result = print(&sliced, profile);
            let text = std::fs::read_to_string(&sliced).unwrap();
            // The purge line of the start code, 21.5 mm of filament, is not in the slicer's figure.
            let filament_mm = number_after(&text, "; filament used [mm] = ") + 21.5;
            let ours_mm = result["filament_mm"].as_f64().unwrap();
            assert!(
                (ours_mm - filament_mm).abs() < 0.01 * filament_mm,
                "{name}: {ours_mm} mm, the slicer {filament_mm}"
            );
            // PrusaSlicer plans with classic corner speeds, which are others than ours.
            let estimate =
                text.split_once("; estimated printing time (normal mode) = ").unwrap().1.lines().next().unwrap();
            let (ours_s, estimate_s) = (result["motion_time_s"].as_f64().unwrap(), seconds(estimate));
            assert!((ours_s / estimate_s - 1.0).abs() < 0.1, "{name}: {ours_s} s, the slicer {estimate_s}");
        }
    }

    #[test]
    fn cura_engine_slices_a_cube_for_every_machine_and_it_prints() {
        let cura =
            PathBuf::from(std::env::var_os("FERROSTEP_CURA").expect("FERROSTEP_CURA: Cura's folder of resources"));
        let ours = folder().join("cura");
        let search = std::env::join_paths([
            ours.join("definitions"),
            ours.join("extruders"),
            cura.join("definitions"),
            cura.join("extruders"),
        ])
        .unwrap();
        let scratch = tempfile::tempdir().unwrap();
        for (name, file, profile) in MACHINES {
            let definition = definition(file);
            let sliced = scratch.path().join("cube.gcode");
            let mut slice = Command::new("CuraEngine");
            slice.env("CURA_ENGINE_SEARCH_PATH", &search).args(["slice", "-v"]);
            slice.arg("-j").arg(ours.join(format!("definitions/{file}.def.json")));
            // Cura's window fills in the start code and works out these settings; the engine alone does neither.
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
            let said = run(&mut slice);
            let result = print(&sliced, profile);
            // The engine says the figure at its end; the file begins with that of a print of nothing, which Cura's window
            // replaces. The purge line, and 2 mm back at the end.
            let filament_mm = number_after(&said, ";Filament used: ") * 1000.0 + 21.5 - 2.0;
            let ours_mm = result["filament_mm"].as_f64().unwrap();
            assert!(
                (ours_mm - filament_mm).abs() < 0.01 * filament_mm,
                "{name}: {ours_mm} mm, the slicer {filament_mm}"
            );
        }
    }
}
