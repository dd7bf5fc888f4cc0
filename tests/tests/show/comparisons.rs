//! `ferrostep compare`: two prints in a table and on a page.

use std::path::Path;

use ferrostep_testkit::program::repository;
use ferrostep_testkit::shown::{compare, errors};
use serde_json::Value;

use crate::show::pages::{job, names};

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}, expected a number"))
}

const PART: &str = "G28\nM302 P1\nM83\nM204 P500 T500\nG1 Z.2 F600\nG1 X50 Y20 F3000\nG1 X90 E1 F6000\nG1 Y60 E1\nG1 X50 E1\n\
                    G1 E-.8\nG1 X20 Y20\n";

/// Half the acceleration takes longer and rings less; the job's own acceleration is
/// left out of both.
#[test]
fn one_job_with_another_setting_is_compared() {
    let folder = job(PART);
    let keys = ["print", "travel"].map(|kind| format!("acceleration_mm_per_s2.{kind}=300"));
    let arguments =
        ["job.gcode", "--set", &keys[0], "--set", &keys[1], "--frequency-x", "40", "--json", "-o", "both.html"];
    let output = compare(folder.path(), &arguments);
    assert!(output.status.success(), "{}", errors(&output));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (a, b) = (&said["a"], &said["b"]);
    assert!(number(&b["print_time_s"]) > 1.02 * number(&a["print_time_s"]), "{said:#}");
    assert!(number(&b["mean_printing_mm_per_s"]) < 0.9 * number(&a["mean_printing_mm_per_s"]), "{said:#}");
    assert!(number(&b["contour_error_um"]["rms"]) < 0.8 * number(&a["contour_error_um"]["rms"]), "{said:#}");
    for side in [a, b] {
        assert!(number(&side["contour_error_um"]["rms"]) > 1.0, "{said:#}");
        assert_eq!(side["retractions"], 1, "{said:#}");
        assert!((number(&side["filament_mm"]) - 2.2).abs() < 1e-9, "{said:#}");
        let (mean, most) = (number(&side["mean_flow_mm3_per_s"]), number(&side["max_flow_mm3_per_s"]));
        assert!(mean > 0.5 && most > mean, "{said:#}");
    }
    assert_eq!(b["changes"]["acceleration_mm_per_s2.print"], 300.0);
    let page = std::fs::read_to_string(folder.path().join("both.html")).unwrap();
    assert!(page.starts_with("<!doctype html><!-- ferrostep show -->"));
    assert_eq!(page.matches("<iframe ").count(), 2);
    assert!(page.contains("acceleration_mm_per_s2.print = 300"));
    // The pages within the page do not end its frames.
    assert_eq!(page.matches("</iframe>").count(), 2);
    assert_eq!(page.matches("<script").count(), 0);
    // Without the keys the job's own acceleration holds.
    let output = compare(folder.path(), &["job.gcode", "job.gcode", "--json"]);
    let own: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(own["a"], own["b"]);
    assert!(number(&own["a"]["print_time_s"]) > number(&a["print_time_s"]), "{own:#} {said:#}");
    assert_eq!(own["a"].get("contour_error_um"), None);
}

#[test]
fn two_files_and_two_profiles_are_compared() {
    let folder = job(PART);
    std::fs::write(folder.path().join("other.gcode"), PART.replace("X90 E1", "X90 E2")).unwrap();
    let output = compare(folder.path(), &["job.gcode", "other.gcode"]);
    assert!(output.status.success(), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("A: job.gcode on cartesian\nB: other.gcode on cartesian\n"), "{text}");
    let filament = text.lines().find(|line| line.starts_with("filament")).unwrap();
    assert_eq!(filament.split_whitespace().collect::<Vec<_>>(), ["filament", "0.002", "m", "0.003", "m", "+45.5", "%"]);
    let output = compare(folder.path(), &["job.gcode", "--profile-b", "corexy"]);
    assert!(String::from_utf8(output.stdout).unwrap().contains("B: job.gcode on corexy\n"));
    assert_eq!(names(folder.path()), ["job.gcode", "other.gcode"]);
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = job(PART);
    std::fs::copy(repository().join("config/profiles/cartesian.toml"), folder.path().join("mine.toml")).unwrap();
    let refused = |arguments: &[&str], reason: &str| {
        let output = compare(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(errors(&output).contains(reason), "{arguments:?}: {}", errors(&output));
        assert_eq!(names(folder.path()), ["job.gcode", "mine.toml"]);
    };
    refused(&["job.gcode"], "give a second file, --profile-b or --set");
    refused(&["job.gcode", "-"], "give it files, not -");
    refused(&["job.gcode", "missing.gcode", "-o", "page.html"], "missing.gcode: cannot be read");
    refused(&["job.gcode", "--profile-b", "mine.toml", "-o", "mine.toml"], "this is the profile");
    refused(&["job.gcode", "--set", "junction_deviation_mm=x"], "\"x\" is not a number");
    refused(&["job.gcode", "--set", "junction_deviation_mm=-1", "-o", "page.html"], "junction_deviation_mm");
    refused(&["job.gcode", "job.gcode", "--frequency-x", "0", "-o", "page.html"], "at 0 Hz, expected 1 to 1000 Hz");
    for (out, reason) in
        [(".", "this is a folder"), ("missing/page.html", "cannot be written"), ("job.gcode", "this is the job")]
    {
        refused(&["job.gcode", "job.gcode", "-o", out], reason);
    }
    if Path::new("/dev/full").exists() {
        refused(&["job.gcode", "job.gcode", "-o", "/dev/full"], "No space left on device");
    }
    // A job that stops is compared up to there.
    std::fs::write(folder.path().join("mine.toml"), format!("{PART}G1 X10 Q\"\n")).unwrap();
    let output = compare(folder.path(), &["job.gcode", "mine.toml"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("mine.toml: line 12"), "{}", errors(&output));
}

/// A print without moves has a page beside any other's.
#[test]
fn an_empty_print_is_compared() {
    let folder = job(PART);
    std::fs::write(folder.path().join("empty.gcode"), "; nothing\n").unwrap();
    let output = compare(folder.path(), &["empty.gcode", "job.gcode", "-o", "both.html", "--json"]);
    assert!(output.status.success(), "{}", errors(&output));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((number(&said["a"]["print_time_s"]), number(&said["a"]["filament_mm"])), (0.0, 0.0), "{said:#}");
    assert!(number(&said["b"]["print_time_s"]) > 1.0, "{said:#}");
    let page = std::fs::read_to_string(folder.path().join("both.html")).unwrap();
    assert_eq!(page.matches("<iframe ").count(), 2);
    assert!(!page.contains("NaN") && !page.contains("inf "), "a change from nothing has no sign");
}
