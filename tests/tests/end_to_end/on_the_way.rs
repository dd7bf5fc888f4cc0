//! `filament_on_the_way`: filament that moves along travels.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use ferrostep_checked_toml::book;
use ferrostep_random_cases::Share;
use flate2::read::GzDecoder;
use serde_json::Value;
use tempfile::TempDir;

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// The sliced files, and their machines.
const FILES: [(&str, &str); 10] = [
    ("cube.gcode", "cartesian"),
    ("cube-corexy.gcode.gz", "corexy"),
    ("cube-cura.gcode.gz", "cartesian"),
    ("cube-slic3r.gcode.gz", "cartesian"),
    ("four-cubes-labelled.gcode.gz", "cartesian"),
    ("firmware-retraction.gcode.gz", "cartesian"),
    ("gyroid.gcode.gz", "cartesian"),
    ("arcs-corexy.gcode.gz", "corexy"),
    ("supports.gcode.gz", "cartesian"),
    ("vase.gcode.gz", "cartesian"),
];

/// A profile unchanged, and with filament on the way.
fn profiles(directory: &TempDir, name: &str, text: &str) -> [PathBuf; 2] {
    let stops = file(directory, &format!("{name}.toml"), text);
    let on_the_way = file(directory, &format!("{name}-on-the-way.toml"), format!("filament_on_the_way = true\n{text}"));
    [stops, on_the_way]
}

fn profile(name: &str) -> String {
    fs::read_to_string(repository().join(format!("config/profiles/{name}.toml"))).unwrap()
}

/// The same machine with 600 mm/s and 5000 mm/s^2 of X and Y.
fn fast(name: &str) -> String {
    let profile = profile(name);
    let faster: Vec<String> = profile
        .lines()
        .map(|line| match line.split_once(" = ") {
            Some(("max_feed_mm_per_s", _)) => "max_feed_mm_per_s = { x = 600, y = 600, z = 10, e = 60 }".to_owned(),
            Some(("max_acceleration_mm_per_s2", _)) => {
                "max_acceleration_mm_per_s2 = { x = 5000, y = 5000, z = 100, e = 5000 }".to_owned()
            }
            Some(("acceleration_mm_per_s2", _)) => {
                "acceleration_mm_per_s2 = { print = 5000, travel = 5000, retract = 1500 }".to_owned()
            }
            _ => line.to_owned(),
        })
        .collect();
    assert_eq!(
        faster.iter().filter(|line| line.contains("5000, y = 5000") || line.contains("print = 5000")).count(),
        2
    );
    faster.join("\n")
}

/// The job at four times its speeds, without the limits that its slicer set.
fn hastened(directory: &TempDir, job: &Path) -> PathBuf {
    let bytes = fs::read(job).unwrap();
    let mut text = String::new();
    if job.extension().is_some_and(|extension| extension == "gz") {
        GzDecoder::new(bytes.as_slice()).read_to_string(&mut text).unwrap();
    } else {
        text = String::from_utf8(bytes).unwrap();
    }
    let limits = ["M201", "M203", "M204", "M205"];
    let lines = text.lines().filter(|line| !limits.iter().any(|code| line.starts_with(code)));
    let text = ["M220 S400"].into_iter().chain(lines).collect::<Vec<_>>().join("\n");
    file(directory, "hastened.gcode", text)
}

fn of(command: &str, job: &Path, profile: &Path) -> Value {
    ferrostep([command, job.to_str().unwrap(), "--profile", profile.to_str().unwrap(), "--json"]).json()
}

/// The motion's time with stops and without, s; checks that all other figures are the same.
fn times(name: &str, job: &Path, profiles: &[PathBuf; 2]) -> [f64; 2] {
    let [stops, on_the_way] = profiles.each_ref().map(|profile| of("estimate", job, profile));
    for key in ["filament_mm", "position_mm", "moves", "lines"] {
        assert_eq!(stops[key], on_the_way[key], "{name}: {key}");
    }
    let [before, after] = [&stops, &on_the_way].map(|estimate| estimate["motion_time_s"].as_f64().unwrap());
    assert!(after < before, "{name}: {after} s instead of {before} s");
    [before, after]
}

/// This run's share of the rows of the book's tables.
fn rows() -> Share {
    if book::is_written() { Share::ALL } else { Share::of_this_run() }
}

/// Compares a table with the book's, or the rows that this run has made.
fn keep(name: &str, table: &str) {
    let page = repository().join("docs/src/filament-on-the-way.md");
    if rows().is_all() { book::keep(&page, name, table) } else { book::has_lines(&page, name, table) }.unwrap();
}

#[test]
fn sliced_files_take_less_time_and_the_same_filament() {
    let directory = directory();
    let head = "| file | as sliced, s | on the way, s | less | four times as fast, s | on the way, s | less |";
    let mut table = format!("{head}\n|{}\n", "---|".repeat(7));
    for row in rows().cases(FILES.len() as u64) {
        let (name, machine) = FILES[row as usize];
        let job = repository().join("examples").join(name);
        let sliced = times(name, &job, &profiles(&directory, machine, &profile(machine)));
        let hastened = hastened(&directory, &job);
        let faster = times(name, &hastened, &profiles(&directory, &format!("fast-{machine}"), &fast(machine)));
        let cells = [sliced, faster]
            .map(|[before, after]| format!("{before:.1} | {after:.1} | {:.1} %", 100.0 * (before - after) / before));
        table += &format!("| {name} | {} |\n", cells.join(" | "));
    }
    keep("sliced files", table.trim_end());
}

/// Retractions on the way leave the motors' positions and the filament as at stops, with shapers
/// and an advance and without, and no gap between the steps. Without filters each motor makes the
/// same number of steps.
#[test]
fn a_print_makes_the_same_steps() {
    let directory = directory();
    let job = repository().join("examples/cube.gcode");
    let filters = "\n[input_shaper.x]\nkind = \"mzv\"\nfrequency_hz = 50\n\n[pressure_advance]\nseconds = 0.04\n";
    for filters in ["", filters] {
        let text = profile("cartesian") + filters;
        let [stops, on_the_way] = profiles(&directory, "cartesian", &text).map(|profile| of("print", &job, &profile));
        assert_eq!(on_the_way["underruns"], 0);
        assert_eq!(stops["position_mm"], on_the_way["position_mm"]);
        assert_eq!(stops["filament_mm"], on_the_way["filament_mm"]);
        if filters.is_empty() {
            assert_eq!(stops["motor_steps"], on_the_way["motor_steps"]);
        }
        let [before, after] = [&stops, &on_the_way].map(|print| print["motion_time_s"].as_f64().unwrap());
        assert!(after < 0.995 * before, "{after} s instead of {before} s");
    }
}

/// Retractions on the way let no more filament ooze on the simulated nozzle than stops do, and the
/// lines are printed as well.
#[test]
fn no_more_oozes() {
    let directory = directory();
    let mut firmware = Vec::new();
    let packed = fs::read(repository().join("examples/firmware-retraction.gcode.gz")).unwrap();
    GzDecoder::new(packed.as_slice()).read_to_end(&mut firmware).unwrap();
    let layers: Vec<&[u8]> = firmware.split(|byte| *byte == b'\n').take(2500).collect();
    let layers = file(&directory, "firmware-retraction.gcode", layers.join(&b'\n'));
    let cube = repository().join("examples/cube.gcode");
    let jobs = [("cube.gcode", cube), ("firmware-retraction.gcode.gz, 2500 lines", layers)];
    let mut table = "| file | advance, s | at stops, mm³ | on the way, mm³ |\n|---|---|---|---|\n".to_owned();
    for row in rows().cases(4) {
        let ((name, job), advance) = (&jobs[row as usize / 2], [None, Some(0.04)][row as usize % 2]);
        let advance_keys = advance.map(|seconds| format!("\n[pressure_advance]\nseconds = {seconds}\n"));
        let text = profile("cartesian") + &advance_keys.unwrap_or_default();
        let [stops, on_the_way] = profiles(&directory, "cartesian", &text).map(|profile| {
            let words = ["simulate", job.to_str().unwrap(), "--profile", profile.to_str().unwrap()];
            ferrostep(words.into_iter().chain(["--input-shaper", "mzv", "--json"])).json()
        });
        let [before, after] = [&stops, &on_the_way].map(|result| result["oozed_volume_mm3"].as_f64().unwrap());
        assert!(after <= 1.002 * before, "{name}, advance {advance:?}: {after} mm^3 instead of {before} mm^3");
        let [before_s, after_s] = [&stops, &on_the_way].map(|result| result["printing_time_s"].as_f64().unwrap());
        assert!((after_s / before_s - 1.0).abs() < 0.002, "{name}: {after_s} s are printed, {before_s} s at stops");
        let [before_um, after_um] =
            [&stops, &on_the_way].map(|result| result["contour_error_um"]["p99"].as_f64().unwrap());
        assert!(after_um < 1.05 * before_um, "{name}: {after_um} um instead of {before_um} um");
        table += &format!("| {name} | {} | {before:.2} | {after:.2} |\n", advance.unwrap_or(0.0));
    }
    keep("ooze", table.trim_end());
}

#[test]
fn a_prepared_job_stops_and_says_so() {
    let directory = directory();
    let [_, profile] = profiles(&directory, "cartesian", &profile("cartesian"));
    let out = directory.path().join("cube.gpre");
    let job = repository().join("examples/cube.gcode");
    let arguments = ["preprocess", job.to_str().unwrap(), "-o", out.to_str().unwrap(), "--profile"];
    let outcome = ferrostep(arguments.into_iter().chain([profile.to_str().unwrap()]));
    assert_eq!(outcome.status, Some(2));
    assert!(outcome.stderr.contains("filament_on_the_way = true"), "{}", outcome.stderr);
    assert!(!out.exists());
}
