use std::string::String;
use std::vec::Vec;

use super::*;
use crate::commands::tuning::tests::{World, execute};

#[test]
fn durations_have_no_parts_before_the_first() {
    let texts = [0, 59, 60, 3599, 3600, 86_400, 90_061].map(|seconds| Duration(seconds).to_string());
    assert_eq!(texts, ["0s", "59s", "1m 0s", "59m 59s", "1h 0m 0s", "1d 0h 0m 0s", "1d 1h 1m 1s"]);
}

/// Returns the printer's answers to these lines of a host.
fn say(world: &World, lines: &[&str]) -> Vec<String> {
    let mut printer = world.printer();
    talk(world, &mut printer, lines)
}

fn talk(world: &World, printer: &mut crate::commands::tuning::tests::TestPrinter<'_>, lines: &[&str]) -> Vec<String> {
    world.said();
    for line in lines {
        execute(world, printer, line, |_| {});
    }
    let mut said = world.said();
    said.retain(|line| line.starts_with("Stats: ") || line.starts_with("echo:Print time"));
    said
}

#[test]
fn the_clock_runs_between_m75_and_m77_but_for_m76() {
    let said = say(&World::new(), &["M75", "G4 S90", "M76", "G4 S600", "M75", "G4 S30", "M77", "G4 S5", "M31", "M78"]);
    assert_eq!(
        said,
        [
            "echo:Print time: 2m 0s",
            "Stats: Prints: 1, Finished: 1, Failed: 0",
            "Stats: Total time: 2m 0s, Longest job: 2m 0s",
            "Stats: Filament used: 0.00m",
            "Stats: Heating time: nozzle 0s, bed 0s",
        ]
    );
}

/// A wait for heat begins a print, and switching off the last heater ends it, as in Marlin.
#[test]
fn heat_begins_and_ends_a_print_of_a_host() {
    let world = World::new();
    let mut printer = world.printer();
    let begun_ms = world.now_ms();
    // Heating without a wait does not begin a print.
    assert_eq!(talk(&world, &mut printer, &["M140 S50", "M31"]), ["echo:Print time: 0s"]);
    talk(&world, &mut printer, &["M190 S50", "G4 S100", "M104 S0"]);
    let heated_s = (world.now_ms() - begun_ms) / 1000;
    let time = format!("echo:Print time: {}", Duration(heated_s as u32));
    assert_eq!(talk(&world, &mut printer, &["M31"]), std::slice::from_ref(&time));
    talk(&world, &mut printer, &["M140 S0", "G4 S1000"]);
    let said = talk(&world, &mut printer, &["M31", "M78"]);
    assert_eq!(said[..2], [time, String::from("Stats: Prints: 1, Finished: 1, Failed: 0")]);
    assert_eq!(said[4], format!("Stats: Heating time: nozzle 0s, bed {}", Duration(heated_s as u32)));
}

#[test]
fn a_pause_is_no_time_of_the_print() {
    let world = World::new();
    let mut printer = world.printer();
    talk(&world, &mut printer, &["M75", "G4 S10", "M0 S500", "G4 S7"]);
    assert_eq!(talk(&world, &mut printer, &["M31"]), ["echo:Print time: 17s"]);
    // A pause before a print begins does not count either.
    talk(&world, &mut printer, &["M77", "M0 S500", "G4 S7"]);
    assert_eq!(talk(&world, &mut printer, &["M31"]), ["echo:Print time: 17s"]);
}

#[test]
fn a_halt_fails_the_print_and_m78_s78_forgets_all() {
    let world = World::new();
    let mut printer = world.printer();
    talk(&world, &mut printer, &["M75", "G4 S10", "M112", "M999"]);
    let said = talk(&world, &mut printer, &["M75", "M78"]);
    assert_eq!(said[0], "Stats: Prints: 2, Finished: 0, Failed: 1");
    talk(&world, &mut printer, &["M77", "M78 S78"]);
    assert_eq!(talk(&world, &mut printer, &["M78"])[0], "Stats: Prints: 0, Finished: 0, Failed: 0");
}
