//! Meaning of commands where firmwares differ, or where a dropped word would make a large
//! command of a small one.

use ferrostep_profiles::{builtin_text, parse};
use serde_json::Value;

use crate::end_to_end::command::{Outcome, directory, ferrostep, file};
use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, machine};

/// Prints a job on a built-in machine.
#[track_caller]
fn print_on(machine: &str, job: &str) -> Outcome {
    let directory = directory();
    let job = file(&directory, "job.gcode", job);
    let words = ["print".as_ref(), job.as_os_str(), "--json".as_ref(), "--profile".as_ref(), machine.as_ref()];
    ferrostep(words)
}

/// The summary of a print that ends well, and its remarks in one text.
#[track_caller]
fn printed(machine: &str, job: &str) -> (Value, String) {
    let outcome = print_on(machine, job);
    assert_eq!(outcome.status, Some(0), "{job}: {outcome:#?}");
    let summary = outcome.json();
    let remarks = summary["remarks"].to_string();
    (summary, remarks)
}

#[track_caller]
fn seconds(summary: &Value) -> f64 {
    summary["print_time_s"].as_f64().unwrap_or_else(|| panic!("{summary}"))
}

#[test]
fn g28_o_moves_nothing_above_a_part() {
    let start = "G28\nG1 X20 Y20 Z0.2 F3000\nG1 Z30\nG1 X100 Y100\nG92 E0\n";
    let (with, _) = printed("cartesian", &format!("{start}G28 O\nG1 X110\n"));
    let (without, _) = printed("cartesian", &format!("{start}G1 X110\n"));
    assert_eq!(with["order_digest"], without["order_digest"]);
    let (one, _) = printed("cartesian", "G28\nG1 X50 Z20 F3000\nM18 Y\nG28 O\n");
    assert_eq!(one["position_mm"]["x"], 50.0, "{one}");
    assert_eq!(one["position_mm"]["z"], 20.0, "{one}");
}

#[test]
fn words_of_g29_that_mean_nothing_here_do_not_probe() {
    let (base, _) = printed("prusa-mini", "G28\nG1 Z10 F600\n");
    for line in ["G29 J", "G29 S1", "G29 S2", "G29 T", "G29 D", "G29 F10", "G29 K1", "G29 X5 Y5"] {
        let (summary, remarks) = printed("prusa-mini", &format!("G28\n{line}\nG1 Z10 F600\n"));
        assert!((seconds(&summary) - seconds(&base)).abs() < 1.0, "{line}: {summary}");
        assert!(remarks.contains("nothing is measured"), "{line}: {remarks}");
    }
    let (summary, _) = printed("prusa-mini", "G28\nG29 F30 B90\nG1 Z10 F600\n");
    assert!(seconds(&summary) > seconds(&base) + 5.0, "{summary}");
}

/// Commands that manage a card have no effect in a file on the desk, and a remark says so.
#[test]
fn a_file_on_the_desk_says_what_has_no_effect_on_a_card() {
    for line in ["M21", "M22", "M26 S0", "M29", "M23 A.GCO", "M30 A.GCO", "M32 A.GCO", "M928 A.GCO"] {
        let (summary, remarks) = printed("cartesian", &format!("G28\nG1 X20 F3000\n{line}\nG1 X30\n"));
        assert_eq!(summary["position_mm"]["x"], 30.0, "{line}");
        assert!(remarks.contains("cannot choose, write or delete"), "{line}: {remarks}");
    }
    for line in ["M24", "M602", "RESUME"] {
        let (summary, remarks) = printed("cartesian", &format!("G28\nM601\nG1 X20 F3000\n{line}\nG1 X30\n"));
        assert_eq!(summary["position_mm"]["x"], 30.0, "{line}");
        assert!(remarks.contains("no print is paused"), "{line}: {remarks}");
    }
    let refused = print_on("cartesian", "G28\nM28 A.GCO\nG1 X30\nM29\n");
    assert_eq!(refused.status, Some(1), "{refused:#?}");
    assert!(refused.stderr.contains("leave M28 and M29 out"), "{refused:#?}");
}

#[test]
fn numbers_of_other_dialects_are_told() {
    let (_, remarks) = printed("cartesian", "M140 S60\nM140 S-273.15\nG4 P10\n");
    assert!(remarks.contains("a target below 0 is off") && !remarks.contains("still on"), "{remarks}");
    let (_, remarks) = printed("cartesian", "G28\nM203 X6000 Y6000\nG1 X200 F18000\n");
    assert!(remarks.contains("X is 6000 mm/s now") && remarks.contains("RepRapFirmware"), "{remarks}");
    let (_, remarks) = printed("cartesian", "G28\nM203 X400\n");
    assert_eq!(remarks, "[]");
    let relative = "M302 P1\nG28\nM83\nG91\nG1 Z5 F600\nG90\nG1 X20 E1 F1200\nG1 X30 E1\nG1 X40 E1\n";
    let (summary, remarks) = printed("cartesian", relative);
    assert_eq!(summary["filament_mm"], 1.0, "{summary}");
    assert_eq!(remarks.matches("E is absolute since G90").count(), 1, "{remarks}");
    let (_, remarks) = printed("cartesian", "M302 P1\nG28\nM83\nG90\nM83\nG1 X20 E1 F1200\n");
    assert!(!remarks.contains("G90"), "{remarks}");
    let (_, remarks) = printed("cartesian", "M106 S0.5\nM107\n");
    assert!(remarks.contains("full power is 255"), "{remarks}");
}

#[test]
fn m81_switches_off_without_a_supply() {
    let machine = machine(&profile("cartesian"));
    let mut host = Conversation::new(&machine);
    for line in ["M80", "M104 S200", "M140 S60", "M106 S255", "M81"] {
        host.say(line);
    }
    let said = host.say("M105").concat();
    assert!(said.contains("/0.00 B:") && !said.contains("/60.00"), "{said}");
    host.say("G4 P100");
    assert!(host.say("M123").concat().contains("part@:0"));
}

#[test]
fn settings_without_words_are_answered() {
    let machine = machine(&profile("cartesian"));
    let mut host = Conversation::new(&machine);
    for (line, says) in [
        ("M201", "M201 X1500.00 Y1500.00 Z100.00 E5000.00"),
        ("M203", "M203 X200.00 Y200.00 Z10.00 E60.00"),
        ("M204", "M204 P1000.00 R1500.00 T1000.00"),
        ("M205", "M205 J0.10"),
        ("M207", "M207 S"),
        ("M208", "M208 S"),
    ] {
        let said = host.say(line);
        assert!(said[0].contains(says) && said.len() == 2, "{line}: {said:?}");
    }
}

#[test]
fn the_text_of_m1_reaches_the_person() {
    let machine = machine(&profile("cartesian"));
    let mut host = Conversation::new(&machine);
    let said = host.say("M1 S1 Insert the magnets");
    assert!(said.contains(&"echo:Insert the magnets. M108 resumes".to_owned()), "{said:?}");
    assert!(said.contains(&"//action:prompt_begin Insert the magnets".to_owned()), "{said:?}");
    assert!(!said.concat().contains("no effect"), "{said:?}");
}

/// Start code of some makers pushes filament alone after it has let the nozzle cool; Marlin
/// continues without it.
#[test]
fn filament_that_moves_alone_stays_where_a_file_has_left_the_nozzle_cold() {
    let start = "G28\nM104 S140\nM83\nM109 S25\n";
    let end = "G1 X20 F3000\nM109 S200\nG1 X40 E2\n";
    let outcome = print_on("cartesian", &format!("{start}G1 E10 F300\n{end}"));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(outcome.json()["remarks"].to_string().contains("the filament stays"), "{outcome:#?}");
    let (without, _) = printed("cartesian", &format!("{start}{end}"));
    for figure in ["order_digest", "step_digest", "filament_mm"] {
        assert_eq!(outcome.json()[figure], without[figure], "{figure}");
    }
    assert_eq!(outcome.json()["position_mm"]["e"], 12.0, "E counts on");

    // A line that would lay filament or moves an axis is not left out.
    for line in ["M104 S100\nG1 X5 E1 F300", "M104 S100\nG1 Z5 E-1 F300", "G10"] {
        let outcome = print_on("cartesian", &format!("G28\nM83\n{line}\n"));
        assert_eq!(outcome.status, Some(1), "{line}: {outcome:#?}");
        assert!(outcome.stderr.contains("cold extrusion prevented"), "{line}: {outcome:#?}");
    }
}

#[test]
fn m106_with_words_of_a_preset_leaves_the_fan() {
    let machine = machine(&profile("cartesian"));
    let mut host = Conversation::new(&machine);
    for line in ["M106 I0", "M106 T128", "M106 P0 H1"] {
        assert!(host.say(line).last().is_some_and(|said| said == "ok"), "{line}");
    }
    host.say("G4 P300");
    assert!(host.say("M123").concat().contains("part@:0"));
}

#[test]
fn a_soft_limit_is_named_in_the_jobs_coordinates() {
    let machine = machine(&profile("cartesian"));
    let mut host = Conversation::new(&machine);
    for line in ["G28", "G1 X50 F3000", "G92 X0"] {
        host.say(line);
    }
    let said = host.say("G1 X-60").concat();
    assert!(said.contains("X ends at -50.00 (allowed -50.00 to 150.00)"), "{said}");
}

#[test]
fn the_higher_nozzle_stays_at_the_lower_end_of_z() {
    let text = format!(
        "{}\n[tools]\n[tools.t1]\nmotor = \"e1\"\noffset_mm = {{ x = 20, y = 0, z = -0.3 }}\n",
        builtin_text("cartesian").unwrap()
    );
    let profile = parse(&text, "two.toml").unwrap();
    let machine = machine(&profile);
    let mut host = Conversation::new(&machine);
    for line in ["G28", "G1 X50 Y50 Z5 F6000", "T1", "G28"] {
        host.say(line);
    }
    let said = host.say("T0");
    assert!(said.contains(&"echo:Active Extruder: 0".to_owned()), "{said:?}");
}
