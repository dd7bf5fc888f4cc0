//! A power supply that is switched: M80, M81, and off at every halt.

use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_printer::{MotorDrivers, Profile};
use ferrostep_profiles::{builtin_text, parse};
use ferrostep_tmc2209::DriverState;
use ferrostep_virtual_board::HeaterFailure;

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, machine};

const OFF: &str = "the power supply is off: M80 switches it on";

fn with_supply(name: &str, keys: &str) -> Profile {
    parse(&format!("{}\n[power_supply]\n{keys}\n", builtin_text(name).unwrap()), "supply.toml").unwrap()
}

#[track_caller]
fn is_ok(replies: &[String]) {
    assert_eq!(replies.last().map(String::as_str), Some("ok"), "{replies:?}");
    assert!(!replies.iter().any(|reply| reply.starts_with("echo:line")), "{replies:?}");
}

#[track_caller]
fn is_refused(replies: &[String], why: &str) {
    assert!(replies.iter().any(|reply| reply.starts_with("echo:line") && reply.ends_with(why)), "{why}: {replies:?}");
}

#[test]
fn without_the_profile_s_table_there_is_none() {
    let machine = machine(&profile("cartesian"));
    let mut host = Conversation::new(&machine);
    // The remark comes once a job, as for all commands of a file for many machines.
    let said = host.say("M80");
    assert!(
        said[0].contains(
            "the profile has no power_supply: M80 has no effect, M81 switches heaters, fans and motors off all the same"
        ) && said.len() == 2,
        "{said:?}"
    );
    for line in ["M80 S", "M81", "M81 S1"] {
        assert_eq!(host.say(line), ["ok"], "{line}");
    }
    assert!(host.say("M115").iter().any(|line| line.contains("Cap:SOFTWARE_POWER:0")));
    is_ok(&host.say("M104 S60"));
    // M112 leaves no state that M999 would not end.
    host.say("M112");
    assert_eq!(host.say("M81"), ["ok"], "all that it switches off is off");
    is_refused(&host.say("M104 S60"), "M999 restarts it");
    is_ok(&host.say("M999"));
    is_ok(&host.say("M104 S60"));
    assert!(machine.heaters().has_supply());
}

#[test]
fn m81_ends_motion_heat_and_fans_first_and_m80_begins_anew() {
    let machine = machine(&with_supply("cartesian", "on_is_low = true"));
    let mut host = Conversation::new(&machine);
    assert!(machine.heaters().has_supply());
    assert!(host.say("M115").iter().any(|line| line.contains("Cap:SOFTWARE_POWER:1")));
    assert_eq!(host.say("M80 S"), ["PS:1", "ok"]);
    is_ok(&host.say("G28"));
    is_ok(&host.say("M104 S60"));
    is_ok(&host.say("M106 S200"));
    is_ok(&host.say("G1 X100 F600"));
    let before = machine.figures().motor_steps[0];
    is_ok(&host.say("M81"));
    let after = machine.figures();
    assert!(after.motor_steps[0] > before, "motion has not ended first");
    assert!((host.position_mm()[0] - 100.0).abs() < 1e-9);
    is_ok(&host.say("G4 P100"));
    assert!(!machine.heaters().has_supply());
    assert_eq!(machine.heaters().power(Heater::Nozzle), 0.0);
    assert_eq!(machine.heaters().fan_power(FanOutput::Part), 0);
    assert_eq!(host.say("M80 S"), ["PS:0", "ok"]);
    for line in [
        "G1 X50",
        "G2 X20 I5",
        "G28",
        "M17",
        "M104 S60",
        "M140 S50",
        "M109 S60",
        "M190 R50",
        "M303 S100",
        "M106 S9",
        "SET_FAN_SPEED FAN=part SPEED=1",
        "M600",
        "M125",
        "M701 L10",
    ] {
        is_refused(&host.say(line), OFF);
    }
    // Commands that switch off, ask or set numbers have their effect.
    for line in ["M104 S0", "M140 S0", "M107", "M84", "M105", "M114", "M204 P500", "G90", "M81", "TURN_OFF_HEATERS"] {
        let replies = host.say(line);
        assert!(replies.last().is_some_and(|line| line.starts_with("ok")), "{line}: {replies:?}");
    }
    is_ok(&host.say("M80"));
    is_ok(&host.say("M80"));
    assert_eq!(host.say("M80 S"), ["PS:1", "ok"]);
    is_ok(&host.say("M104 S60"));
    is_ok(&host.say("G4 S5"));
    assert!(machine.heaters().true_celsius(Heater::Nozzle) > 30.0);
    // Motors without current may have been turned.
    let state = host.say("M119");
    assert!(!state.is_empty());
    assert!(host.say("G28 Z").last().is_some_and(|line| line == "ok"));
}

#[test]
fn it_may_be_off_at_the_start() {
    let machine = machine(&with_supply("cartesian", "on_is_low = false\non_at_start = false"));
    let mut host = Conversation::new(&machine);
    assert_eq!(host.say("M80 S"), ["PS:0", "ok"]);
    is_refused(&host.say("M104 S60"), OFF);
    is_ok(&host.say("M80"));
    is_ok(&host.say("M104 S60"));
}

#[test]
fn m81_s_waits_for_a_cold_nozzle_and_m108_ends_that_wait() {
    let machine = machine(&with_supply("cartesian", "on_is_low = true"));
    let mut host = Conversation::new(&machine);
    is_ok(&host.say("M109 S200"));
    is_ok(&host.say("M81 S1"));
    is_ok(&host.say("G4 P100"));
    assert!(!machine.heaters().has_supply());
    let celsius = machine.heaters().true_celsius(Heater::Nozzle);
    assert!(celsius < 46.0, "{celsius}");
    is_ok(&host.say("M80"));
    is_ok(&host.say("M109 S200"));
    let mut looks = 0;
    let replies = host.say_while(b"M81 S1\n", |machine| {
        looks += 1;
        if looks == 20 {
            machine.signals().end_wait();
        }
    });
    is_ok(&replies);
    is_ok(&host.say("G4 P100"));
    assert!(!machine.heaters().has_supply() && machine.heaters().true_celsius(Heater::Nozzle) > 150.0);
}

#[test]
fn a_paused_print_is_not_switched_off() {
    let machine = machine(&with_supply("cartesian", "on_is_low = true"));
    let mut host = Conversation::new(&machine);
    is_ok(&host.say("G28"));
    is_ok(&host.say("M25"));
    is_refused(&host.say("M81"), "a print is under way or paused: M524 ends it");
    assert!(machine.heaters().has_supply());
}

#[test]
fn a_heater_s_fault_and_m112_switch_it_off_for_good() {
    let machine = machine(&with_supply("cartesian", "on_is_low = true"));
    let mut host = Conversation::new(&machine);
    is_ok(&host.say("M109 S200"));
    is_ok(&host.say("M104 S0"));
    machine.set_heater_failure(Heater::Nozzle, Some(HeaterFailure::StuckOn));
    let mut celsius = Vec::new();
    host.say_while(b"G4 S400\n", |machine| celsius.push(machine.heaters().true_celsius(Heater::Nozzle)));
    assert!(!machine.heaters().has_supply());
    let highest = celsius.iter().copied().fold(0.0, f32::max);
    host.say_while(b"G4 S400\nM105\n", |_| {});
    let last = machine.heaters().true_celsius(Heater::Nozzle);
    assert!(highest < 275.0 && last < highest, "{highest} {last}");
    is_refused(&host.say("M80"), "M999 restarts it");
    // Off already: no error for an end of a print.
    is_ok(&host.say("M81"));
    assert_eq!(host.say("M80 S"), ["PS:0", "ok"]);

    let machine = crate::end_to_end::hosts::machine(&with_supply("cartesian", "on_is_low = true"));
    let mut host = Conversation::new(&machine);
    is_ok(&host.say("M104 S60"));
    host.say("M112");
    assert!(!machine.heaters().has_supply(), "at once");
    assert!(host.say("M999").iter().any(|line| line == &format!("echo:{OFF}")));
    is_refused(&host.say("M104 S60"), OFF);
    is_ok(&host.say("M80"));
    is_ok(&host.say("M104 S60"));
}

/// The chips lose their registers with their supply.
#[test]
fn drivers_are_set_up_again() {
    let machine = machine(&with_supply("corexy", "on_is_low = true"));
    let mut host = Conversation::new(&machine);
    is_ok(&host.say("M17"));
    assert_eq!(machine.drivers().state(0), Some(DriverState::Confirmed));
    is_ok(&host.say("M906 X700"));
    is_ok(&host.say("M81"));
    is_ok(&host.say("M80"));
    assert_eq!(machine.drivers().state(0), Some(DriverState::Unconfirmed));
    is_ok(&host.say("M17"));
    assert_eq!(machine.drivers().state(0), Some(DriverState::Confirmed));
    assert!(host.say("M906").iter().any(|line| line.starts_with("echo:driver X: 700 mA")));
}
