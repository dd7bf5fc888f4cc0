//! Moonraker's analysis of files, with our script in klipper_estimator's place.

use ferrostep_testkit::program::program;
use ferrostep_testkit::python;
use serde_json::{Value, json};

/// Moonraker asks the running printer, estimates, corrects a file on request and after an upload,
/// and knows which one is corrected.
#[test]
fn moonraker_analyses_files_by_our_script() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let place = folder.path().join("data");
    let [command, place] = [program(), &place].map(|path| path.to_str().unwrap());
    let arguments = [command, "tests/configurations/bed-slinger.cfg", "examples/cube.gcode", place];
    let seen = python::run("moonraker_analysis.py", &arguments);
    let number =
        |place: &str| seen.pointer(place).and_then(Value::as_f64).unwrap_or_else(|| panic!("no {place} in {seen}"));

    assert_eq!((&seen["ready"], &seen["dumped"]), (&json!(true), &json!(["ferrostep_profile"])), "{seen}");
    let (estimated_s, slicer_s) = (number("/estimated/total_time"), number("/slicer_time_s"));
    assert!((estimated_s - slicer_s).abs() > 1.0, "the times are told apart: {seen}");
    for place in ["/asked_time_s", "/uploaded/estimated_time"] {
        assert!((number(place) - estimated_s).abs() <= 0.5, "{place}: {seen}");
    }
    let version = &seen["version"];
    assert_eq!(seen["asked"][0], json!({"prev_processed": false, "version": version, "bypassed": false}));
    assert_eq!(seen["asked"][1], json!({"prev_processed": true, "version": version, "bypassed": true}));
    assert_eq!(seen["uploaded"]["file_processors"], json!(["klipper_estimator"]));
    assert_eq!((&seen["uploaded"]["slicer"], &seen["same"]), (&json!("PrusaSlicer"), &json!(true)), "{seen}");

    for (key, words) in [
        ("nonsense", "the answer is no JSON"),
        ("wrong_key", "Moonraker wants a login"),
        ("zero", "max_acceleration is 0"),
    ] {
        assert_eq!(seen[key][0], 1, "{key}: {seen}");
        assert!(seen[key][1].as_str().unwrap().contains(words), "{key}: {seen}");
    }
    for key in ["nonsense_is_refused", "zero_is_refused"] {
        assert_eq!(seen[key], json!(true), "{key}: {seen}");
    }
    assert_eq!(seen["nonsense_config_exists"], json!(false), "{seen}");
    assert_eq!(seen["kept"], json!(true));
    assert!(number("/own_limits/total_time") > 0.0);
}
