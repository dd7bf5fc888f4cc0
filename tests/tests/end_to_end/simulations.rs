//! `ferrostep simulate`: a job, its trace and its prepared form on a frame that rings, beside
//! Klipper's rules.

use serde_json::{Value, json};

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// A square with corners, a travel and retractions.
const JOB: &str = "G28\nM104 S210\nM109 S210\nG90\nM83\nG1 Z.2 F600\nG1 X20 Y20 F6000\nG1 X60 E1.5 F3600\nG1 Y60 E1.5\nG1 X20 E1.5\n\
                   G1 Y20 E1.5\nG1 E-1 F2100\nG1 X30 Y30 F9000\nG1 E1 F2100\nG3 X50 Y50 I10 J10 E1 F3000\nG1 E-1 F2100\nM104 S0\n";

fn number(value: &Value, path: &[&str]) -> f64 {
    let found = path.iter().fold(value, |value, key| &value[key]);
    found.as_f64().unwrap_or_else(|| panic!("{path:?} is {found}, expected a number in {value}"))
}

/// Keys that outside tools rely on.
fn check_keys(result: &Value) {
    for path in [
        &["time_s"][..],
        &["contour_error_um", "rms"],
        &["contour_error_um", "p99"],
        &["contour_error_um", "max"],
        &["corner_volume_mm3"],
        &["end_volume_mm3"],
        &["ringing", "rms_um"],
        &["true_acceleration_mm_per_s2", "p99"],
        &["true_acceleration_mm_per_s2", "max"],
        &["extruder", "max_speed_mm_per_s"],
        &["extruder", "max_acceleration_mm_per_s2"],
    ] {
        assert!(number(result, path) > 0.0, "{path:?}");
    }
}

#[test]
fn a_job_its_trace_and_its_prepared_form_measure_alike() {
    let folder = directory();
    let job = file(&folder, "square.gcode", JOB);
    let [trace, prepared] = ["square.trace", "square.gpre"].map(|name| folder.path().join(name));
    let path = |path: &std::path::Path| path.to_str().unwrap().to_owned();
    let (job, trace, prepared) = (path(&job), path(&trace), path(&prepared));
    let printed = ferrostep(["print", &job, "--trace", &trace, "--json"]).json();
    assert_eq!(ferrostep(["preprocess", &job, "-o", &prepared]).status, Some(0));

    let of_job = ferrostep(["simulate", &job, "--json"]);
    assert_eq!((of_job.status, of_job.stderr.as_str()), (Some(0), ""));
    let of_job = of_job.json();
    check_keys(&of_job);
    assert_eq!((of_job["source"].as_str(), of_job["path"].as_str()), (Some("gcode"), Some("gcode")));
    assert_eq!((number(&of_job, &["corners"]), number(&of_job, &["ends"])), (3.0, 4.0));
    // A sum of blocks beside a time from the first record to the last: they differ by the
    // homing's last wait.
    let (simulated_s, printed_s) = (number(&of_job, &["time_s"]), number(&printed, &["motion_time_s"]));
    assert!((simulated_s - printed_s).abs() < 0.05, "{simulated_s} and {printed_s}");
    // The same plan without a shaper measures as much as the plan without filters, apart from whole
    // steps of 12.5 um beside 20 um of ringing.
    assert!((number(&of_job, &["ringing", "relative"]) - 1.0).abs() < 0.35, "{of_job}");

    let of_trace = ferrostep(["simulate", &trace, "--path", &job, "--json"]).json();
    for key in ["time_s", "contour_error_um", "corner_volume_mm3", "ringing", "true_acceleration_mm_per_s2", "extruder"]
    {
        assert_eq!(of_trace[key], of_job[key], "{key}");
    }
    let alone = ferrostep(["simulate", &trace, "--json"]).json();
    assert_eq!((alone["source"].as_str(), alone["path"].as_str()), (Some("trace"), Some("steps")));
    let (of_steps, of_path) =
        (number(&alone, &["contour_error_um", "rms"]), number(&of_job, &["contour_error_um", "rms"]));
    assert!((of_steps - of_path).abs() < 6.0, "{of_steps} and {of_path}");
    assert_eq!(alone["ringing"]["relative"], Value::Null);
    let of_prepared = ferrostep(["simulate", &prepared, "--json"]).json();
    assert_eq!(of_prepared["source"], "prepared");
    let (one, other) = (number(&of_prepared, &["ringing", "max_um"]), number(&of_job, &["ringing", "max_um"]));
    assert!((one - other).abs() < 0.05 * other, "{one} and {other}");
}

#[test]
fn klippers_rules_stand_beside_and_a_shaper_lessens_ringing() {
    let folder = directory();
    // A fifth of the ringing at the file's own 1000 mm/s^2 is the steps' own.
    let job = file(&folder, "square.gcode", JOB.replace("M104 S210\n", "M201 X5000 Y5000\nM204 P5000 T5000\n"));
    let plot = folder.path().join("square.svg");
    let (job, plot) = (job.to_str().unwrap(), plot.to_str().unwrap());
    let run = |more: &[&str]| {
        let all = [&["simulate", job, "--json", "--compare", "klipper"], more].concat();
        let outcome = ferrostep(&all);
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{all:?}");
        outcome.json()["compared"].clone()
    };
    let shaped = run(&["--plot", plot]);
    check_keys(&shaped);
    assert_eq!((shaped["rules"].as_str(), shaped["shaper"].as_str()), (Some("klipper"), Some("mzv")));
    assert!(number(&shaped, &["ringing", "relative"]) < 0.15, "{shaped}");
    let plain = run(&["--shaper", "none", "--pressure-advance", "0"]);
    assert!(number(&plain, &["contour_error_um", "p99"]) > 2.0 * number(&shaped, &["contour_error_um", "p99"]));
    assert!(number(&plain, &["corner_volume_mm3"]) > 2.0 * number(&shaped, &["corner_volume_mm3"]));
    let detuned = run(&["--shaper", "zv", "--shaper-frequency", "60,48"]);
    let exact = run(&["--shaper", "zv"]);
    assert!(number(&detuned, &["ringing", "rms_um"]) > 2.0 * number(&exact, &["ringing", "rms_um"]));
    let svg = std::fs::read_to_string(plot).unwrap();
    assert!(svg.starts_with("<svg") && svg.matches("<rect").count() == 7 && !svg.contains("NaN"), "{svg}");
    let text = ferrostep(["simulate", job, "--compare", "klipper"]);
    assert!(text.stdout.contains("klipper  mzv") && text.stdout.contains("contour error, 99 %"), "{}", text.stdout);
}

/// One plan: that of `estimate`, with Klipper's own chords of arcs and its one acceleration.
#[test]
fn the_compared_plan_takes_the_time_of_an_estimate_by_its_rules() {
    let folder = directory();
    let text = std::fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let corners = |e: u32| format!("instantaneous_corner_velocity_mm_per_s = {{ z = 5, e = {e} }}");
    assert!(text.contains(&corners(10)));
    let profile = file(&folder, "machine.toml", text.replace(&corners(10), &corners(1)));
    let profile = ["--profile", profile.to_str().unwrap(), "--json"];
    // That of a deviation of 0.1 mm at 1000 mm/s^2.
    let corner = (0.1 * 1000.0 / (2f64.sqrt() - 1.0)).sqrt().to_string();
    let simulated = |path: &std::path::Path| {
        let compared = ["--compare", "klipper", "--square-corner-velocity", &corner];
        let outcome = ferrostep(["simulate", path.to_str().unwrap()].into_iter().chain(compared).chain(profile));
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""));
        number(&outcome.json(), &["compared", "time_s"])
    };
    let estimated = |path: &std::path::Path| {
        let outcome = ferrostep(["estimate", path.to_str().unwrap(), "--rules", "klipper"].into_iter().chain(profile));
        number(&outcome.json(), &["motion_time_s"])
    };
    let arcs = "M204 P700 T400\nG2 X52 Y52 I1 J1 E.1\nG10\nG1 X90\nG11\nG28 X\nM204 S2000\nG1 X10 Y20\nG2 X70 Y20 I30 J0 E2 F9000\nM104 S0\n";
    let job = file(&folder, "arcs.gcode", JOB.replace("M104 S0\n", arcs));
    let (here, there) = (simulated(&job), estimated(&job));
    assert!(here > 4.0);
    assert!((here - there).abs() < 1e-6, "{here} and {there}");
}

/// The plan of `--rules`, or of an imported profile, is the one that is measured.
#[test]
fn a_job_is_measured_under_the_plan_of_other_rules() {
    let folder = directory();
    let text = std::fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let imported = format!(
        "square_corner_velocity_mm_per_s = 15\n{text}\n[rules]\nplanned_by = \"klipper\"\nminimum_cruise_ratio = 0.2\n"
    );
    let profile = file(&folder, "imported.toml", imported);
    let of_profile = ["--profile", profile.to_str().unwrap()];
    let job = file(&folder, "square.gcode", JOB);
    let run = |command: &str, job: &std::path::Path, more: &[&str]| {
        let outcome = ferrostep([&[command, job.to_str().unwrap(), "--json"], more].concat());
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{command} {more:?}");
        outcome.json()
    };
    let names = ["klipper", "marlin-junction-deviation", "marlin-classic-jerk", "rrf"];
    for (rules, more) in
        names.map(|name| (name, vec!["--rules", name])).into_iter().chain([("klipper", of_profile.to_vec())])
    {
        let simulated = run("simulate", &job, &more);
        check_keys(&simulated);
        assert_eq!((simulated["rules"].as_str(), simulated["path"].as_str()), (Some(rules), Some("gcode")));
        let (here, there) =
            (number(&simulated, &["time_s"]), number(&run("estimate", &job, &more), &["motion_time_s"]));
        assert!((here - there).abs() < 1e-6, "{more:?}: {here} and {there}");
    }
    let own = run("simulate", &job, &[&of_profile[..], &["--rules", "own"]].concat());
    assert_eq!((&own["rules"], &own["time_s"]), (&Value::Null, &run("simulate", &job, &[])["time_s"]));
    // Both plans have the imported corners, and differ in their filters alone.
    let both = run("simulate", &job, &[&of_profile[..], &["--compare", "klipper"]].concat());
    assert_eq!(both["time_s"], both["compared"]["time_s"]);
    assert!(number(&both, &["ringing", "rms_um"]) > 1.5 * number(&both, &["compared", "ringing", "rms_um"]), "{both}");
    let shaped = run("simulate", &job, &["--rules", "klipper", "--input-shaper", "mzv"]);
    assert!(number(&shaped, &["ringing", "relative"]) < 0.3, "{shaped}");
    // Marlin adds a move of less than six steps to the next.
    let short =
        file(&folder, "short.gcode", JOB.replace("G1 Y60 E1.5\n", "G1 E.02\nG1 Y60 E1.5\nG1 E.02\n") + "G1 E.02\n");
    assert!(number(&run("simulate", &short, &["--rules", "marlin-classic-jerk"]), &["time_s"]) > 3.0);
    // A file whose path only the printer's macros know is measured against the path that it draws.
    let macros = file(&folder, "macros.gcode", JOB.replacen("G28\n", "START_PRINT\n", 1));
    assert_eq!(run("simulate", &macros, &of_profile)["path"], "steps");
    // A job that stops is measured up to there.
    let stops = file(&folder, "stops.gcode", JOB.replace("G3 X50", "G3 X50 R1"));
    let outcome = ferrostep(["simulate", stops.to_str().unwrap(), "--rules", "rrf", "--json"]);
    assert_eq!(outcome.status, Some(1), "{}", outcome.stderr);
    assert!(number(&outcome.json(), &["time_s"]) > 1.0 && outcome.json()["stopped"].is_object());
}

#[test]
fn a_kind_is_given_to_both_plans_and_detuning_moves_the_frame_under_them() {
    let folder = directory();
    // Stops from full speed, by retractions.
    let job = file(&folder, "square.gcode", JOB.replace("M104 S210\n", "M201 X5000 Y5000\nM204 P5000 T5000\n"));
    let job = job.to_str().unwrap();
    let run = |more: &[&str]| {
        let all = [&["simulate", job, "--json", "--compare", "klipper"], more].concat();
        let outcome = ferrostep(&all);
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{all:?}");
        outcome.json()
    };
    let filters = |result: &Value| {
        let of = |value: &Value| (value["shaper"].clone(), value["shaper_frequency_hz"].clone());
        (of(&result["input_shaper"]), of(&result["compared"]))
    };
    let frame = |result: &Value| -> Vec<f64> {
        result["machine"]["frequency_hz"].as_array().unwrap().iter().map(|hz| hz.as_f64().unwrap()).collect()
    };
    let plain = run(&["--shaper", "none"]);
    assert_eq!(plain["input_shaper"], Value::Null);
    let exact = run(&["--input-shaper", "zv", "--shaper-damping", "0.06"]);
    let made = ((json!(["zv", "zv"]), json!([50.0, 40.0])), (json!("zv"), json!([50.0, 40.0])));
    assert_eq!((filters(&exact), frame(&exact)), (made.clone(), vec![50.0, 40.0]));
    let detuned = run(&["--input-shaper", "zv", "--shaper-damping", "0.06", "--detune", "-10"]);
    assert_eq!((filters(&detuned), frame(&detuned)), (made, vec![45.0, 36.0]));
    assert_eq!((number(&detuned, &["detune_percent"]), &exact["detune_percent"]), (-10.0, &Value::Null));
    // The time depends on the filters, which are the same; the ringing depends on the frame.
    assert_eq!(detuned["time_s"], exact["time_s"]);
    for plan in [&[][..], &["compared"]] {
        let ringing = [&plain, &exact, &detuned].map(|result| number(result, &[plan, &["ringing", "rms_um"]].concat()));
        let [plain, exact, detuned] = ringing;
        assert!(exact * 5.0 < plain && exact * 1.5 < detuned && detuned < 0.5 * plain, "{ringing:?}");
    }
    let other = run(&["--input-shaper", "ei", "--shaper", "mzv", "--shaper-frequency", "60,45"]);
    let made = ((json!(["ei", "ei"]), json!([60.0, 45.0])), (json!("mzv"), json!([60.0, 45.0])));
    assert_eq!((filters(&other), frame(&other)), (made, vec![50.0, 40.0]));
    let text = ferrostep(["simulate", job, "--input-shaper", "zv", "--detune=5"]).stdout;
    assert!(text.contains("frame 52.5 and 42 Hz (moved by 5 % from what the filters are made for)"), "{text}");
    assert!(text.contains("filters of the steps: X zv for 50 Hz, Y zv for 40 Hz"), "{text}");
}

/// The book's table of misplaced material, in small.
#[test]
fn pressure_advance_puts_material_where_the_path_is() {
    let folder = directory();
    let job = file(&folder, "square.gcode", JOB);
    let profile = crate::end_to_end::command::repository().join("tests/data/fine-extruder.toml");
    let text = std::fs::read_to_string(&profile).unwrap();
    let volumes = |seconds: &str| {
        let profile = file(&folder, "own.toml", text.replace("seconds = 0.04", &format!("seconds = {seconds}")));
        let arguments = ["--profile", profile.to_str().unwrap(), "--input-shaper", "mzv", "--json"];
        let result = ferrostep(["simulate", job.to_str().unwrap()].into_iter().chain(arguments)).json();
        [number(&result, &["corner_volume_mm3"]), number(&result, &["end_volume_mm3"])]
    };
    let [none_corner, none_end] = volumes("0");
    for (seconds, at_corner, at_end) in [("0.036", 0.2, 0.2), ("0.04", 0.15, 0.1), ("0.044", 0.2, 0.2)] {
        let [corner, end] = volumes(seconds);
        assert!(corner < at_corner * none_corner, "K {seconds}: {corner} of {none_corner} mm^3");
        assert!(end < at_end * none_end, "K {seconds}: {end} of {none_end} mm^3");
    }
}

#[test]
fn what_cannot_be_simulated_says_what_would_be_right() {
    let folder = directory();
    let job = file(&folder, "square.gcode", JOB);
    let other = file(&folder, "other.gcode", JOB.replace("G28\n", "G28\n\n"));
    let trace = folder.path().join("square.trace");
    let [job, other, trace] = [&job, &other, &trace].map(|path| path.to_str().unwrap());
    ferrostep(["print", job, "--trace", trace]);
    let bytes = std::fs::read(trace).unwrap();
    let named = |name: &str, bytes: &[u8]| file(&folder, name, bytes).to_str().unwrap().to_owned();
    let header = bytes.iter().position(|byte| *byte == b'\n').unwrap() + 1;
    let cut = named("cut.trace", &bytes[..header + 12 * 100 + 5]);
    let text = String::from_utf8(bytes[..header].to_vec()).unwrap();
    let delta = named("delta.trace", text.replace("cartesian", "delta").as_bytes());
    let profile = std::fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let skew = named("skew.toml", format!("{profile}\n[skew]\nxy = {{ factor = 0.01 }}\n").as_bytes());
    let rows: [(&[&str], &str); 22] = [
        (&[&cut], "trace ends inside the record at byte"),
        (&[&delta], "trace header: kinematics is missing or not supported"),
        (&[trace, "--path", other], "is the trace of this file?"),
        (&[trace, "--path", trace], "--path takes G-code"),
        (&[trace, "--compare", "klipper"], "give it with --path FILE"),
        (&[trace, "--rules", "rrf"], "--rules rrf takes the G-code that it was made from"),
        (&[job, "--frequency-x", "0"], "a mode of the frame is at 0 Hz, expected 1 to 1000 Hz"),
        (&[job, "--damping", "1"], "the frame's damping ratio is 1, expected 0 to 0.95"),
        (&[job, "--nozzle-time-constant", "5"], "the nozzle's time constant is 5 s, expected 0.001 to 2 s"),
        (&[job, "--nozzle-second-slope", "0.02"], "expected SECONDS@FLOW"),
        (
            &[job, "--compare", "klipper", "--shaper", "ei", "--shaper-damping", "0.5"],
            "the shaper's damping ratio is 0.5, expected 0 to 0.4 for this shaper",
        ),
        (
            &[job, "--compare", "klipper", "--minimum-cruise-ratio", "1"],
            "the compared plan: minimum_cruise_ratio is 1, expected 0 to less than 1",
        ),
        (&[trace, "--input-shaper", "zv"], "the steps of a trace are made already"),
        (&[job, "--detune", "5"], "no filter is known that the frame could differ from"),
        (&[job, "--input-shaper", "zv", "--detune", "60"], "--detune is 60 %, expected -50 to 50 %"),
        (
            &[job, "--input-shaper", "zv", "--detune", "5", "--frequency-x", "50"],
            "give those with --shaper-frequency X,Y, and leave --frequency-x and --frequency-y out",
        ),
        (&[job, "--input-shaper", "zvdd", "--compare", "klipper"], "Klipper has no such filter"),
        (
            &[job, "--input-shaper", "mzx"],
            "expected none, zv, mzv, zvd, zvdd, ei, ei_old, 2hump_ei, 3hump_ei, or as mzv(5,0.9)",
        ),
        (&[job, "--input-shaper", "mzv(4,1.5)"], "which does not exist, expected in mzv(N,T) N from 3 to 5"),
        (&[job, "--input-shaper", "zv", "--shaper-frequency", "5,40"], "expected at least 5.03 Hz"),
        (&[job, "--shaper-frequency", "50,40"], "--input-shaper"),
        (&[job, "--profile", &skew], "the simulated frame is at right angles"),
    ];
    for (arguments, expected) in rows {
        let outcome = ferrostep(["simulate"].iter().chain(arguments));
        assert_eq!((outcome.status, outcome.stdout.as_str()), (Some(2), ""), "{arguments:?}");
        assert!(outcome.stderr.contains(expected), "{arguments:?}: {}", outcome.stderr);
    }
    assert_eq!(ferrostep(["simulate", job, "--shaper", "zv"]).status, Some(2));
}
