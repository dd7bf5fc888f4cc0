//! `sweep`: a job's time with other values of the profile's keys.

use std::fs;

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// A sweep is the same as an estimate of the job without its limits, with the
/// profile edited by hand.
#[test]
fn a_sweep_is_an_estimate_for_each_value() {
    let cube = repository().join("examples/cube.gcode");
    let swept = ferrostep(["sweep", cube.to_str().unwrap(), "--acceleration", "500..2000", "--json"]).json();
    let directory = directory();
    let text = fs::read_to_string(&cube).unwrap();
    let limits = ["M201", "M203", "M204", "M205"];
    let (left_out, kept): (Vec<&str>, Vec<&str>) =
        text.lines().partition(|line| limits.iter().any(|code| line.starts_with(code)));
    let job = file(&directory, "job.gcode", kept.join("\n"));
    let profile = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let estimate = |acceleration: &str| {
        let edited = profile
            .replace("{ print = 1000, travel = 1000,", &format!("{{ print = {acceleration}, travel = {acceleration},"))
            .replace("{ x = 1500, y = 1500,", &format!("{{ x = {acceleration}, y = {acceleration},"));
        assert_ne!(edited, profile);
        let own = file(&directory, "own.toml", &edited);
        let arguments = ["estimate", job.to_str().unwrap(), "--profile", own.to_str().unwrap(), "--json"];
        ferrostep(arguments).json()["print_time_s"].as_f64().unwrap()
    };
    assert_eq!(swept["lines_left_out"], left_out.len());
    assert!(left_out.len() > 100);
    let rows = swept["rows"].as_array().unwrap();
    for (row, acceleration) in rows.iter().zip(["500", "1000", "2000"]) {
        assert_eq!(row["value"].to_string(), format!("{acceleration}.0"));
        assert_eq!(row["print_time_s"].as_f64().unwrap(), estimate(acceleration));
    }
    assert_eq!(rows.len(), 3);
    let unchanged = ferrostep(["estimate", job.to_str().unwrap(), "--json"]).json();
    assert_eq!(swept["print_time_s"], unchanged["print_time_s"]);
}

#[test]
fn a_sweep_is_drawn() {
    let directory = directory();
    let (job, plot) =
        (file(&directory, "job.gcode", "G28\nG1 X50 F6000\nG1 X10 Y10\n"), directory.path().join("sweep.svg"));
    let keys = ["--set", "max_feed_mm_per_s.x=60..400", "--set", "max_feed_mm_per_s.y=60..400"];
    let arguments = ["sweep", job.to_str().unwrap(), "--plot", plot.to_str().unwrap()];
    let outcome = ferrostep(arguments.into_iter().chain(keys));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(outcome.stdout.contains("max_feed_mm_per_s.x, max_feed_mm_per_s.y"), "{}", outcome.stdout);
    let drawn = fs::read_to_string(&plot).unwrap();
    // 60, 120, 240 and 400 mm/s.
    assert_eq!(drawn.matches("<circle").count(), 4, "{drawn}");
}

#[test]
fn a_value_with_which_the_job_stops_says_why() {
    let directory = directory();
    let job = file(&directory, "job.gcode", "M109 S210\nG28\nG1 X5 E1 F600\n");
    let values = ["--set", "min_extrusion_celsius=170,260", "--json"];
    let swept = ferrostep(["sweep", job.to_str().unwrap()].into_iter().chain(values)).json();
    let [warm, cold] = [0, 1].map(|row| &swept["rows"][row]);
    assert!(warm["print_time_s"].is_f64() && warm["stopped"].is_null(), "{swept}");
    assert!(cold["print_time_s"].is_null(), "{swept}");
    let stopped = cold["stopped"].as_str().unwrap();
    assert!(stopped.starts_with("line 3: ") && stopped.contains("expected at least 260 C"), "{stopped}");
}

#[test]
fn what_cannot_be_swept_is_refused() {
    let directory = directory();
    let job = file(&directory, "job.gcode", "G28\n");
    let cases: [(&[&str], &str); 9] = [
        (&["--acceleration", "5..1"], "a range begins above 0 and rises, as 500..16000"),
        (&["--acceleration", "fast"], "\"fast\" is not a number, expected a range as 500..16000 or a list"),
        (&["--acceleration", "0,100"], "cartesian: max_acceleration_mm_per_s2.x = 0: expected"),
        (&["--set", "acceleration"], "expected KEY=VALUES"),
        (&["--set", "accel=1..2"], "cartesian: unknown key \"accel\", expected "),
        (&["--set", "name.x=1..2"], "cartesian: name.x: \"name\" is not a table of the profile"),
        (&["--set", "homing.x.end=1"], "cartesian: homing.x.end = 1: expected \"min\" or \"max\""),
        (
            &["--set", "jerk_mm_per_s3=1..2", "--set", "min_extrusion_celsius=3"],
            "keys that change together take the same values",
        ),
        (&[], "required arguments were not provided"),
    ];
    for (words, expected) in cases {
        let outcome = ferrostep(["sweep", job.to_str().unwrap()].iter().chain(words));
        assert_eq!((outcome.status, outcome.stdout.as_str()), (Some(2), ""), "{words:?}");
        assert!(outcome.stderr.contains(expected), "{words:?}: {}", outcome.stderr);
    }
    let from_input = ferrostep(["sweep", "-", "--acceleration", "1,2"]);
    assert!(from_input.stderr.contains("give a file, not -"), "{}", from_input.stderr);
    let over_the_job =
        ferrostep(["sweep", job.to_str().unwrap(), "--acceleration", "1,2", "--plot", job.to_str().unwrap()]);
    assert_eq!(over_the_job.status, Some(2), "{over_the_job:#?}");
    assert_eq!(fs::read_to_string(&job).unwrap(), "G28\n");
}

/// The profile of a fast bed slinger whose frame is known to 5 %, with ZV.
fn measured_profile() -> String {
    let mut text = fs::read_to_string(repository().join("tests/data/fast-bed-slinger.toml")).unwrap();
    for (axis, hz) in [("x", 50.0), ("y", 40.0)] {
        text += &format!(
            "\n[frame.{axis}]\nfrequency_hz = {hz}\nfrequency_uncertainty_hz = {}\ndamping = 0.06\n\
             [input_shaper.{axis}]\nkind = \"zv\"\nfrequency_hz = {hz}\n",
            0.05 * hz
        );
    }
    text
}

/// The budget is kept on the curves of a gyroid, which are the hardest of the examples.
#[test]
fn a_budget_is_kept_on_the_simulated_frame_and_time_falls_with_it() {
    let directory = directory();
    let packed = fs::read(repository().join("examples/gyroid.gcode.gz")).unwrap();
    let gyroid = String::from_utf8(ferrostep_oracle::gcode_text(&packed).unwrap()).unwrap();
    let lines: Vec<&str> = gyroid.lines().take(12_000).collect();
    // Settings of the job itself would override those that follow from the budget.
    let job = file(&directory, "job.gcode", format!("M220 S400\nM201 X9000 Y9000\nM593 F20\n{}\n", lines.join("\n")));
    let own = file(&directory, "own.toml", measured_profile());
    let [job, own] = [&job, &own].map(|path| path.to_str().unwrap());
    let words = ["--profile", own, "--error-budget", "0.015,0.03,0.06", "--simulate", "--json"];
    let estimated = ferrostep(["estimate", job].into_iter().chain(words)).json();
    let rows = estimated["rows"].as_array().unwrap();
    let of = |row: &serde_json::Value, key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row}"));
    let (mut before_s, mut before_um) = (f64::INFINITY, 0.0);
    for (row, budget_um) in rows.iter().zip([15.0, 30.0, 60.0]) {
        let (time_s, error_um) = (of(row, "print_time_s"), of(row, "error_um"));
        assert!(error_um <= budget_um && error_um > 0.5 * budget_um, "{row}");
        assert!(time_s < before_s && error_um > before_um, "{row}");
        let [x, y] = [0, 1].map(|axis| row["acceleration_mm_per_s2"][axis].as_f64().unwrap());
        assert!(y < 0.85 * x && y > 100.0, "{row}");
        (before_s, before_um) = (time_s, error_um);
    }
    assert_eq!(rows.len(), 3);
    // A sweep of the key is the same, and without words for it nothing is simulated.
    let swept = ferrostep(["sweep", job, "--profile", own, "--set", "error_budget_mm=0.03", "--json"]).json();
    assert_eq!(swept["rows"][0]["acceleration_mm_per_s2"], rows[1]["acceleration_mm_per_s2"]);
    assert_eq!(swept["rows"][0]["print_time_s"], rows[1]["print_time_s"]);
    assert!(swept["rows"][0]["error_um"].is_null(), "{swept}");
}

#[test]
fn budgets_that_no_frame_is_known_for_are_refused() {
    let directory = directory();
    let job = file(&directory, "job.gcode", "G28\nG1 X50 F6000\n");
    let own = file(&directory, "own.toml", measured_profile());
    let [job, own] = [&job, &own].map(|path| path.to_str().unwrap());
    for (words, says) in [
        (
            &["estimate", job, "--error-budget", "0.02"][..],
            "error_budget_mm = 0.02: expected frame.x and frame.y in the profile",
        ),
        (
            &["estimate", job, "--profile", own, "--error-budget", "0.005"],
            "error_budget_mm = 0.005: expected at least 0.0",
        ),
        (&["estimate", job, "--error-budget", "little"], "\"little\" is not a number"),
        (&["estimate", job, "--simulate"], "--error-budget"),
        (&["sweep", job, "--acceleration", "500", "--simulate"], "--simulate plays the steps on the printer's frame"),
        (&["sweep", job, "--error-budget", "0.02", "--acceleration", "500"], "cannot be used with"),
    ] {
        let outcome = ferrostep(words);
        assert_eq!((outcome.status, outcome.stdout.as_str()), (Some(2), ""), "{words:?} {outcome:#?}");
        assert!(outcome.stderr.contains(says), "{words:?}: {}", outcome.stderr);
    }
    let shown = ferrostep(["estimate", job, "--profile", own, "--error-budget", "0.03"]);
    assert!(shown.stdout.contains("X, Y mm/s²") && !shown.stdout.contains("error, 99 %"), "{}", shown.stdout);
}
