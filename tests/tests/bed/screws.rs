//! G35: the screws of a tilted bed, and the effect of turning them as it says.

use super::rig::{profile, run, sheet_mm};

const PITCH_MM: f64 = 0.7;
const PLACES: [(&str, [f64; 2]); 3] =
    [("front_left", [30.0, 30.0]), ("front_right", [170.0, 30.0]), ("back", [100.0, 180.0])];

fn machine(tilt_mm: [f64; 2], clockwise_lifts: bool) -> ferrostep_printer::Profile {
    let [x, y] = tilt_mm;
    let places: String = PLACES.iter().map(|(name, [x, y])| format!("{name} = {{ x = {x}, y = {y} }}\n")).collect();
    profile(&format!(
        "[mesh.sheet]\ntilt_mm = {{ x = {x}, y = {y} }}\n[bed_screws]\npitch_mm = {PITCH_MM}\nclockwise_lifts = {clockwise_lifts}\n\
         [bed_screws.places]\n{places}\n"
    ))
}

/// Turns of the screw of this name, clockwise above 0.
fn turns(said: &[String], name: &str) -> f64 {
    let line =
        said.iter().find(|line| line.starts_with(&format!("echo:{name}: "))).unwrap_or_else(|| panic!("{said:#?}"));
    if line.ends_with(", right") {
        return 0.0;
    }
    let (direction, time) = line.split_once("turn it ").unwrap().1.split_once(" by ").unwrap();
    let (hours, minutes) = time.split_once(':').unwrap();
    let turns = hours.parse::<f64>().unwrap() + minutes.parse::<f64>().unwrap() / 60.0;
    match direction {
        "clockwise" => turns,
        "counterclockwise" => -turns,
        other => panic!("{other}"),
    }
}

/// The bed is level after these turns: within half a minute of a turn and the probe's step.
#[test]
fn the_turns_level_the_bed() {
    for tilt_mm in [[0.8, -0.4], [-0.3, 1.0], [0.0, 0.0]] {
        for clockwise_lifts in [true, false] {
            let machine = machine(tilt_mm, clockwise_lifts);
            let done = run(&machine, ["G28", "G35"]).well();
            let base = sheet_mm(&machine, PLACES[0].1);
            for (name, place) in &PLACES[1..] {
                let lifted = turns(&done.said, name) * PITCH_MM * if clockwise_lifts { 1.0 } else { -1.0 };
                let after = sheet_mm(&machine, *place) + lifted;
                assert!(
                    (after - base).abs() < PITCH_MM / 120.0 + 0.008,
                    "{name}: {after} instead of {base}: {:#?}",
                    done.said
                );
            }
            assert!(
                done.said.iter().any(|line| line.starts_with("echo:front_left: X30.00 Y30.00 Z")),
                "{:#?}",
                done.said
            );
        }
    }
}

/// A mesh that Z follows does not change the result, and Z follows it afterwards.
#[test]
fn a_mesh_stays_as_it_is() {
    let machine = machine([0.8, -0.4], true);
    let level = run(&machine, ["G28", "SCREWS_TILT_CALCULATE"]).well();
    let meshed = run(&machine, ["G28", "G29", "G35", "M420"]).well();
    for (name, _) in &PLACES[1..] {
        assert_eq!(turns(&meshed.said, name), turns(&level.said, name), "{name}");
    }
    assert_eq!(meshed.said.iter().filter(|line| *line == "echo:Bed Leveling ON").count(), 2, "{:#?}", meshed.said);
}

#[test]
fn what_is_missing_is_named() {
    let unhomed = run(&machine([0.0, 0.0], true), ["G35"]);
    assert!(unhomed.failures[0].1.to_string().contains("is not homed"), "{:?}", unhomed.failures);
    let none = run(&profile(""), ["G28", "G35"]);
    assert!(none.failures[0].1.to_string().contains("add a table bed_screws"), "{:?}", none.failures);
}
