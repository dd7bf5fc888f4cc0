//! A chamber around the printer: M141, M191, and the replies of a machine without one.

use ferrostep_hal_shim::Heater;
use ferrostep_printer::Profile;
use ferrostep_profiles::{builtin_text, parse};
use ferrostep_virtual_board::HeaterFailure;

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, machine};

const THERMOMETER: &str = "thermistor = \"nozzle1\"\nsensor = \"epcos-100k\"\nmin_celsius = 0\nmax_celsius = 80\n\
     max_target_celsius = 70\nproportional = 0.5\nintegral = 0.001\nderivative = 0\nresidency_window_celsius = 2\nresidency_s = 5\n";

fn text(keys: &str) -> String {
    format!("{}\n[chamber]\n{THERMOMETER}{keys}\n", builtin_text("corexy").unwrap())
}

fn with_chamber(keys: &str) -> Profile {
    parse(&text(keys), "chamber.toml").unwrap()
}

const HEATED: &str = "heater = \"nozzle1\"";

#[test]
fn without_the_profile_s_table_nothing_is_set_or_waited_for_and_it_is_said() {
    let machine = machine(&profile("corexy"));
    let mut host = Conversation::new(&machine);
    assert!(host.say("M115").iter().any(|line| line == "Cap:CHAMBER_TEMPERATURE:0"));
    assert!(!host.say("M105")[0].contains(" C:"));
    for line in ["M141 S0", "M141 R0 S0", "M191 S0", "TURN_OFF_HEATERS"] {
        assert!(!host.say(line).iter().any(|reply| reply.contains("chamber")), "{line}");
    }
    let said = host.say("M191 S50");
    assert!(said[0].contains("the profile has no chamber; no effect, and nothing is waited for"), "{said:?}");
    assert_eq!(said.last().unwrap(), "ok");
    assert!(machine.clock().now_ns() < 5_000_000_000);
}

#[test]
fn m191_waits_until_it_is_warm() {
    let machine = machine(&with_chamber(HEATED));
    let mut host = Conversation::new(&machine);
    assert!(host.say("M115").iter().any(|line| line == "Cap:CHAMBER_TEMPERATURE:1"));
    assert_eq!(host.say("M141 S40"), ["ok"]);
    host.say("G4 P100");
    let said = host.say("M105");
    assert!(said[0].contains(" C:22.") && said[0].ends_with(" /40.00 @:0 B@:0 C@:127"), "{said:?}");
    let said = host.say("M191 S45");
    // Once a second, as in other waits.
    assert!(said.iter().filter(|line| line.contains(" C:") && line.contains("/45.00")).count() > 60, "{said:?}");
    let celsius = machine.heaters().true_celsius(Heater::Chamber);
    assert!((43.0..47.0).contains(&celsius), "{celsius}");
    // Higher targets are refused, as everywhere.
    let said = host.say("M141 S71");
    assert!(said[0].contains("70") && said[0].starts_with("echo:line"), "{said:?}");
    assert_eq!(host.say("M141 S0"), ["ok"]);
    host.say("G4 S2");
    assert_eq!(machine.heaters().power(Heater::Chamber), 0.0);
    for off in ["M112", "TURN_OFF_HEATERS"] {
        host.say("M999");
        host.say("M141 S45");
        host.say("G4 S1");
        assert!(machine.heaters().power(Heater::Chamber) > 0.0, "{off}");
        host.say(off);
        // One sample of the control later.
        host.say("G4 P20");
        assert_eq!(machine.heaters().power(Heater::Chamber), 0.0, "{off}");
        host.say("M999");
    }
}

#[test]
fn the_bed_alone_warms_a_chamber_with_a_thermometer() {
    let machine = machine(&with_chamber(""));
    let mut host = Conversation::new(&machine);
    host.say("M140 S110");
    for line in ["M191 S40", "TEMPERATURE_WAIT SENSOR=\"temperature_sensor chamber\" MINIMUM=45"] {
        let said = host.say(line);
        assert_eq!(said.last().unwrap(), "ok");
        assert!(!said.iter().any(|reply| reply.starts_with("echo:line")), "{said:?}");
    }
    let celsius = machine.heaters().true_celsius(Heater::Chamber);
    assert!((44.5..46.0).contains(&celsius), "{celsius}");
    assert_eq!(machine.heaters().power(Heater::Chamber), 0.0);
    assert!(!host.say("M105")[0].contains("C@:"));
}

#[test]
fn its_faults_halt_the_printer() {
    let machine = machine(&with_chamber(HEATED));
    let mut host = Conversation::new(&machine);
    for line in ["M141 S45", "M104 S200", "M140 S60", "G4 S5"] {
        host.say(line);
    }
    machine.set_heater_failure(Heater::Chamber, Some(HeaterFailure::ThermistorOpen));
    let said = host.say("G4 S5");
    let expected = "Error:MINTEMP triggered, system stopped! Heater_ID: chamber";
    assert!(said.iter().any(|line| line == expected), "{said:?}");
    assert_eq!(Heater::ALL.map(|heater| machine.heaters().power(heater)), [0.0; Heater::COUNT]);
}

#[test]
fn a_profile_s_mistakes_are_named() {
    for (from, to, says) in [
        ("thermistor = \"nozzle1\"", "thermistor = \"nozzle\"", "chamber.thermistor"),
        (HEATED, "heater = \"probe\"", "chamber.heater"),
        ("max_celsius = 80", "max_celsius = 300", "chamber.max_celsius"),
        ("residency_s = 5", "residency_s = -5", "chamber.residency_s"),
        ("min_celsius = 0", "min_celsius = 0\nwatch_s = 5", "chamber.watch_s"),
    ] {
        let text = text(HEATED);
        let at = text.find("[chamber]").unwrap();
        let (before, after) = text.split_at(at);
        assert!(after.contains(from), "{from}");
        let error = parse(&format!("{before}{}", after.replace(from, to)), "chamber.toml").unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}
