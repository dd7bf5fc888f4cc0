//! Heaters that fail during a job: everything off, motion stopped, the host informed,
//! the position exact.

use std::path::Path;

use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_virtual_board::HeaterFailure;
use serde_json::Value;

use crate::end_to_end::command::{Outcome, directory, ferrostep, file, repository};
use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, Machine, machine};
use crate::end_to_end::reports::temperatures;

const KILLED: &str = "Error:Printer halted. kill() called!";

/// Runs a job on the cartesian machine with other values for its nozzle.
#[track_caller]
fn print_with_nozzle(values: &[(&str, &str)], job: &str) -> Outcome {
    let text = std::fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let (before, nozzle) = text.split_once("[nozzle]\n").unwrap();
    let mut text = format!("{before}[nozzle]\n");
    let mut replaced = 0;
    for line in nozzle.lines() {
        // The nozzle's keys come first, so that those of the bed stay.
        let value = values.iter().find(|(key, _)| replaced < values.len() && line.starts_with(&format!("{key} = ")));
        replaced += usize::from(value.is_some());
        text += &value.map_or_else(|| line.to_owned(), |(key, value)| format!("{key} = {value}"));
        text.push('\n');
    }
    assert_eq!(replaced, values.len());
    let directory = directory();
    let (profile, job) = (file(&directory, "profile.toml", text), file(&directory, "job.gcode", job));
    let arguments: [&Path; 5] = ["print".as_ref(), &job, "--json".as_ref(), "--profile".as_ref(), profile.as_path()];
    ferrostep(arguments)
}

/// Checks the thermal error and `kill() called` on adjacent lines, once, and that the machine is
/// where its motors have left it.
#[track_caller]
fn check_stopped(outcome: &Outcome, error: &str, line: u64) -> Value {
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    let lines: Vec<_> = outcome.stderr.lines().collect();
    let at = lines.iter().position(|line| line.starts_with(error)).unwrap_or_else(|| panic!("{outcome:#?}"));
    assert_eq!(lines[at + 1], KILLED, "{outcome:#?}");
    assert_eq!(lines.iter().filter(|line| line.starts_with("Error:")).count(), 2, "{outcome:#?}");
    let summary = outcome.json();
    assert_eq!(summary["stopped"]["line"], line, "{outcome:#?}");
    summary
}

/// A nozzle with hardly any power does not get warm.
#[test]
fn a_cold_nozzle_stops_the_job() {
    let weak = [("proportional", "0.0001"), ("integral", "0")];
    let error = "Error:Heating failed, system stopped! Heater_ID: E0 (temp: 2";
    let outcome = print_with_nozzle(&weak, "G92 X0\nM109 S200\nG1 X99 F3000\n");
    let summary = check_stopped(&outcome, error, 2);
    assert!(outcome.stderr.contains("M999"), "{outcome:#?}");
    assert_eq!(summary["motor_steps"]["x"], 0);

    // The same in motion: the move takes 40 s, the watch allows 20. The desk checks after each step
    // entry, which at 800 steps a second may last half a second.
    let outcome = print_with_nozzle(&weak, "G92 X0\nM104 S200\nG1 X400 F600\nM400\nG1 X99\n");
    let summary = check_stopped(&outcome, error, 4);
    let steps = summary["motor_steps"]["x"].as_f64().unwrap();
    let (x, stands) = (summary["position_mm"]["x"].as_f64().unwrap(), steps / 80.0);
    assert!((200.0..206.0).contains(&x), "{outcome:#?}");
    assert!((x - stands).abs() <= 0.0126, "{x} after {steps} steps: {outcome:#?}");
}

/// A control loop that overshoots by far reaches the maximum.
#[test]
fn an_overheated_nozzle_stops_the_job() {
    let wild = [("max_celsius", "210"), ("proportional", "0.0001"), ("integral", "0.001"), ("derivative", "0")];
    let outcome = print_with_nozzle(&wild, "M104 S200\nG4 S600\nG1 X99 F3000\n");
    let summary = check_stopped(&outcome, "Error:MAXTEMP triggered, system stopped! Heater_ID: E0 (temp: 210.", 2);
    assert_eq!(summary["motor_steps"]["x"], 0);
}

/// Makes a heater fail at a given moment.
fn failing(heater: Heater, failure: HeaterFailure, at_s: f64) -> impl FnMut(&Machine) {
    move |machine| {
        if machine.clock().now_ns() as f64 * 1e-9 >= at_s {
            machine.set_heater_failure(heater, Some(failure));
        }
    }
}

#[test]
fn every_failure_in_mid_print_stops_motion_and_tells_the_host() {
    for heater in [Heater::Nozzle, Heater::Bed] {
        for (failure, error) in [
            (HeaterFailure::Dead, "Error:Thermal Runaway"),
            (HeaterFailure::StuckOn, "Error:Thermal Runaway"),
            (HeaterFailure::ThermistorFellOut, "Error:Thermal Runaway"),
            (HeaterFailure::ThermistorOpen, "Error:MINTEMP triggered"),
            (HeaterFailure::ThermistorShorted, "Error:MAXTEMP triggered"),
        ] {
            let machine = machine(&profile("cartesian"));
            let mut conversation = Conversation::new(&machine);
            for line in ["M140 S60", "M104 S210", "M190 S60", "M109 S210"] {
                assert_eq!(conversation.say(line).last().unwrap(), "ok");
            }
            let start_s = machine.clock().now_ns() as f64 * 1e-9;
            let mut replies = Vec::new();
            let mut lines = 0;
            while !machine.signals().is_halted() {
                let x = if lines % 2 == 0 { 100 } else { 0 };
                let line = format!("G1 X{x} F600\n");
                replies.extend(conversation.say_while(line.as_bytes(), failing(heater, failure, start_s + 20.0)));
                lines += 1;
                assert!(lines < 360, "{heater:?} {failure:?} is not noticed");
            }
            let name = if heater == Heater::Nozzle { "E0" } else { "bed" };
            let at = replies.iter().position(|reply| reply.starts_with(error)).unwrap_or_else(|| panic!("{replies:?}"));
            assert!(replies[at].contains(&format!("system stopped! Heater_ID: {name}")), "{replies:?}");
            assert_eq!(replies[at + 1], KILLED);
            assert_eq!(replies.iter().filter(|reply| reply.starts_with("Error:")).count(), 2, "{replies:?}");

            // All motors are at rest, all heaters are off, and the reported
            // position is the motors'.
            let steps = machine.figures().motor_steps;
            let refused = conversation.say("G1 X5 F3000");
            assert!(refused[0].contains("M999") && refused[1] == KILLED, "{refused:?}");
            assert!(refused.contains(&"//action:cancel".to_owned()) && refused.last().unwrap() == "ok", "{refused:?}");
            let stands_mm = machine.desk().motor_steps()[0] as f64 / 80.0;
            assert!((conversation.position_mm()[0] - stands_mm).abs() < 0.0126);
            assert_eq!(machine.figures().motor_steps, steps);
            for heater in Heater::ALL {
                assert_eq!(machine.heaters().power(heater), 0.0);
            }
            assert_eq!(machine.heaters().fan_power(FanOutput::Part), 255);

            // M999 has no effect while the thermistor is broken; once it is mended, the machine
            // continues, cold.
            let broken = matches!(failure, HeaterFailure::ThermistorOpen | HeaterFailure::ThermistorShorted);
            if broken {
                let again = conversation.say("M999");
                assert!(again[0].starts_with(error) && again[1] == KILLED, "{again:?}");
                assert!(again[2].contains("M999") && again[3] == "ok", "{again:?}");
                assert!(conversation.say("G1 X5")[0].contains("M999"));
            }
            machine.set_heater_failure(heater, None);
            // Dwells are refused too; it takes a moment to read the thermistor again.
            machine.run(tick(&machine));
            if !broken {
                // A heater that failed: a reading does not show that it is sound again.
                let refused = conversation.say("M999");
                assert!(refused[0].starts_with(error) && refused[1] == KILLED, "{refused:?}");
                let words = ["M999", "Thermal Runaway", heater.name(), "reset"];
                assert!(words.iter().all(|word| refused[2].contains(word)) && refused[3] == "ok", "{refused:?}");
                assert!(conversation.say("M104 S200")[0].contains("halted"));
                for heater in [Heater::Nozzle, Heater::Bed] {
                    assert_eq!(machine.heaters().power(heater), 0.0);
                }
                continue;
            }
            assert_eq!(conversation.say("M999"), ["ok"], "{heater:?} {failure:?}");
            assert_eq!(conversation.say("G4 P500"), ["ok"]);
            let report = conversation.say("M105");
            assert!(report[0].ends_with(" @:0 B@:0"), "{report:?}");
            assert!(temperatures(&report[0]).iter().all(|sensor| sensor.2 == 0.0), "{report:?}");
            assert_eq!(conversation.say("M104 S200"), ["ok"]);
            conversation.say("G4 S1");
            assert!(conversation.say("M105")[0].contains(" /200.00 "));
        }
    }
}

/// A tenth of a second without a command.
async fn tick(machine: &Machine) {
    use embedded_hal_async::delay::DelayNs;
    ferrostep_virtual_board::VirtualDelay(machine.clock()).delay_ms(100).await;
}
