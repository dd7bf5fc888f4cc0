//! The machine of a job if no profile is named: with the travel in the slicer's comments.

use super::command::{Outcome, directory, ferrostep, file, gzip};

/// A job that reaches X320 Y300 Z300, and ends with these comments.
fn job(comments: &str) -> String {
    format!("M104 S210\nG28\nM109 S210\nG1 Z0.2 F600\nG1 X320 Y300 E10 F3000\nG1 Z300\nM104 S0\n{comments}\n")
}

fn estimate(name: &str, bytes: impl AsRef<[u8]>) -> Outcome {
    let directory = directory();
    let job = file(&directory, name, bytes);
    ferrostep(["estimate".as_ref(), job.as_os_str(), "--json".as_ref(), "--strict".as_ref()])
}

#[test]
fn a_job_is_planned_on_the_travel_that_its_comments_name() {
    let long = ";\n".repeat(200_000);
    let orca = "; printable_area = 0x0,350x0,350x350,0x350\n; printable_height = 340";
    let idea =
        ";Sliced by ideaMaker 5.4.2.8790, 2026-03-01\n;Dimension: 350.000 350.000 340.000 0.400\n;Origin Center: 0";
    for (name, bytes) in [
        ("ideamaker.gcode", format!("{idea}\n{}", job("")).into_bytes()),
        ("prusa.gcode", job("; bed_shape = 0x0,350x0,350x350,0x350\r\n; max_print_height = 340").into_bytes()),
        ("orca.gcode", format!("{orca}\n{}{long}", job("")).into_bytes()),
        ("packed.gcode.gz", gzip(format!("{long}{}", job(orca)).as_bytes())),
    ] {
        let outcome = estimate(name, bytes);
        assert_eq!(outcome.status, Some(0), "{name}: {outcome:#?}");
        assert_eq!(outcome.json()["position_mm"]["x"], 320.0, "{name}");
        let note = "350 x 350 x 340 mm: name your printer with --profile";
        assert!(outcome.stderr.contains(note), "{name}: {outcome:#?}");
    }
}

#[test]
fn limits_in_the_comments_hold_for_every_command_and_none_if_the_machine_cannot_have_them() {
    let directory = directory();
    let limits = |feed: u32| {
        let speeds = ["x", "y", "z", "e"].map(|axis| format!("; machine_max_speed_{axis} = {feed},{feed}\n"));
        let accelerations = ["x", "y", "z", "e", "extruding", "retracting"]
            .map(|of| format!("; machine_max_acceleration_{of} = 400,200\n"));
        let bed = "; printable_area = 0x0,350x0,350x350,0x350\n; printable_height = 340\n; printer_model = Large\n";
        job(&format!("{bed}{}{}", speeds.concat(), accelerations.concat()))
    };
    let seconds = |command: &str, name: &str, text: String, more: &[&str]| {
        let job = file(&directory, name, text);
        let arguments = [command.as_ref(), job.as_os_str(), "--json".as_ref()];
        let outcome = ferrostep(arguments.into_iter().chain(more.iter().map(|each| each.as_ref())));
        assert_eq!(outcome.status, Some(0), "{command}: {outcome:#?}");
        (outcome.json()["print_time_s"].as_f64().unwrap_or_default(), outcome.stderr)
    };
    let (fast_s, note) = seconds("estimate", "fast.gcode", limits(50), &[]);
    assert!(
        note.contains(
            "the travel, speeds and accelerations in the comments of fast.gcode for Large, 350 x 350 x 340 mm"
        ),
        "{note}"
    );
    let (own_s, note) = seconds("estimate", "own.gcode", limits(9_000_000), &[]);
    assert!(
        note.contains("the travel in the comments of own.gcode for Large (its speeds and accelerations do not suit"),
        "{note}"
    );
    assert!(own_s - fast_s > 10.0, "Z is five times as fast as the built-in one: {fast_s} {own_s}");
    let (swept_s, note) = seconds("sweep", "fast.gcode", limits(50), &["--set", "junction_deviation_mm=0.05"]);
    assert!((swept_s - fast_s).abs() < 1e-6 && note.contains("350 x 350"), "{swept_s} {fast_s} {note}");
    let (corrected_s, note) = seconds("post-process", "fast.gcode", limits(50), &[]);
    assert!((corrected_s - fast_s).abs() < 1e-6 && note.contains("350 x 350"), "{corrected_s} {fast_s} {note}");
    let (_, note) = seconds("compare", "fast.gcode", limits(50), &["--set", "junction_deviation_mm=0.05"]);
    assert_eq!(note.matches("350 x 350").count(), 1, "{note}");
}

#[test]
fn a_profile_that_is_named_holds_over_the_comments() {
    let directory = directory();
    let job = file(&directory, "job.gcode", job("; bed_shape = 0x0,350x0,350x350,0x350"));
    let job = job.as_os_str();
    let outcome = ferrostep(["estimate".as_ref(), job, "--profile".as_ref(), "cartesian".as_ref(), "--json".as_ref()]);
    assert_eq!(
        (outcome.json()["position_mm"]["x"].as_f64(), outcome.json()["clamped_moves"].as_u64()),
        (Some(200.0), Some(2))
    );
    assert!(!outcome.stderr.contains("note:"), "{outcome:#?}");
}

#[test]
fn a_travel_that_cannot_be_read_or_built_is_named_and_none_of_it_is_taken() {
    for (comments, named) in [
        (
            "; bed_shape = 0x0,350x0,35x,0x350\n; max_print_height = 340",
            "no travel can be read from its comment \"bed_shape = 0x0,350x0,35x,0x350\"",
        ),
        (
            "; bed_shape = 0x0,5000x5000\n; max_print_height = 340",
            "5000 x 5000 x 340 mm, does not suit ferrostep's machine",
        ),
    ] {
        let outcome = estimate("job.gcode", job(comments));
        assert_eq!(outcome.status, Some(1), "{outcome:#?}");
        assert!(outcome.stderr.contains(named), "{outcome:#?}");
        assert!(outcome.stderr.contains("the machine is cartesian, 200 x 200 x 200 mm"), "{outcome:#?}");
        assert_eq!(outcome.json()["position_mm"]["z"], 200.0);
    }
}

#[test]
fn a_page_names_the_travel_and_is_strict_if_asked() {
    let directory = directory();
    let page = directory.path().join("page.html");
    let shown = |comments: &str| {
        let job = file(&directory, "job.gcode", job(comments));
        let arguments = [
            "show".as_ref(),
            job.as_os_str(),
            "--no-open".as_ref(),
            "--strict".as_ref(),
            "-o".as_ref(),
            page.as_os_str(),
        ];
        let outcome = ferrostep(arguments);
        (outcome.status, std::fs::read_to_string(&page).unwrap())
    };
    let (status, text) = shown("; bed_shape = 0x0,350x0,350x350,0x350\n; max_print_height = 340");
    assert_eq!(status, Some(0));
    assert!(text.contains("cartesian with the file's travel, 350 x 350 x 340 mm"));
    let (status, text) = shown("");
    assert_eq!(status, Some(1), "moves that were drawn in to the edge");
    assert!(!text.contains("the file's travel"));
}
