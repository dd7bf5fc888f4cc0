//! Commands for fans, and their answers.

use std::string::String;
use std::vec::Vec;

use super::*;
use crate::commands::tuning::tests::{World, execute};

fn say(world: &World, line: &str) -> Vec<String> {
    let mut printer = world.printer();
    execute(world, &mut printer, line, |_| {});
    world.said()
}

/// Machine with the usual fans, `exhaust` as P2, and `board`, which switches itself.
fn world() -> World {
    let mut world = World::new();
    world.change(|profile| {
        let rule = FanRule::Commanded { number: Some(2) };
        profile.fans[2] = Some(FanSettings { name: "exhaust", rule, ..FanSettings::PART });
        let rule = FanRule::Controller { power: 200, idle_s: 60 };
        profile.fans[5] = Some(FanSettings { name: "board", rule, ..FanSettings::PART });
    });
    world
}

#[test]
fn fans_are_found_by_number_and_by_name() {
    let world = world();
    let printer = world.printer();
    assert_eq!(
        [0, 1, 2].map(|number| printer.numbered_fan(number)),
        [Some(FanOutput::Part), None, Some(FanOutput::Fan2)]
    );
    let by_name = ["part", "Exhaust", "hotend", "board", "exhaus", ""].map(|name| printer.named_fan(name));
    assert_eq!(by_name, [Some(FanOutput::Part), Some(FanOutput::Fan2), None, None, None, None]);
}

#[test]
fn a_fan_that_is_not_there_is_named_once() {
    let world = world();
    let no_fan = "this machine has no such fan (P is its number, S the power; the profile's fans); no effect";
    let mut printer = world.printer();
    let mut say = |line: &str| {
        execute(&world, &mut printer, line, |_| {});
        world.said()
    };
    for line in ["M106 P2 S100", "M107 P2", "SET_FAN_SPEED FAN=exhaust SPEED=0.5", "M106 S9", "M107"] {
        assert_eq!(say(line), ["ok"], "{line}");
    }
    let said = say("M106 P1 S100");
    assert!(said[0].contains(no_fan) && said.len() == 2, "{said:?}");
    assert_eq!(say("M106 P127"), ["ok"]);
    assert_eq!(say("SET_FAN_SPEED FAN=hotend SPEED=1"), ["ok"]);
}

#[test]
fn m123_shows_powers_and_speeds() {
    assert_eq!(
        say(&world(), "M123"),
        ["part@:0", "hotend@:0", "exhaust@:0", "board@:0", "ok"],
        "heaters that have no fans"
    );
}

#[test]
fn outputs_have_numbers_of_their_own() {
    let world = world();
    let mut printer = world.printer();
    execute(&world, &mut printer, "M42 P0 S255", |_| {});
    let said = world.said();
    assert!(said[0].contains("the profile has no outputs; no effect") && said.len() == 2, "{said:?}");
    drop(printer);

    let mut world = world;
    world.change(|profile| {
        let rule = FanRule::Output { number: Some(7), is_pwm: true, at_start: 0, at_halt: 0, color: None };
        profile.fans[3] = Some(FanSettings { name: "light", rule, ..FanSettings::PART });
    });
    let mut printer = world.printer();
    let mut say = |line: &str| {
        execute(&world, &mut printer, line, |_| {});
        world.said()
    };
    assert!(
        say("M150 R255")[0].contains("the profile has no light of several colours (color of its outputs); no effect")
    );
    for line in ["M42 P7 S255", "M42 P7 S0", "SET_PIN PIN=Light VALUE=0.5", "SET_PIN PIN=exhaust VALUE=0.5"] {
        assert_eq!(say(line), ["ok"], "{line}");
    }
    // The fan P2 and the pin 0 are not outputs.
    for line in ["M42 P2 S255", "M42 P0 S255", "M42 S255", "M42 P300 S2"] {
        let said = say(line);
        assert!(
            said[0].ends_with("P: no output of the profile has this number") && said.len() == 2,
            "{line}: {said:?}"
        );
    }
    assert!(say("M42 P7")[0].contains("without S: no effect"));
    // The number of an output does not select a fan.
    assert!(say("M106 P7 S1")[0].contains("no such fan"));
}
