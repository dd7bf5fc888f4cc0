//! A probe with a pin, on the desk: it homes and measures as a fixed one does, and its
//! commands answer.

use ferrostep_printer::Profile;
use ferrostep_profiles::{builtin_text, parse};

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, machine};

fn with_pin(keys: &str) -> Profile {
    let text = format!("{}\n[bltouch]\n{keys}", builtin_text("prusa-mini").unwrap());
    parse(&text, "bltouch.toml").unwrap()
}

/// Replies to homing and to the mesh of a small part of the bed.
fn measured(profile: &Profile) -> Vec<String> {
    let machine = machine(profile);
    let mut host = Conversation::new(&machine);
    let said = ["G28", "G29 L50 R90 F50 B90", "G30 X60 Y60", "G28 X"].into_iter().flat_map(|line| host.say(line));
    said.collect()
}

#[test]
fn it_finds_what_a_fixed_probe_finds() {
    let fixed = measured(&profile("prusa-mini"));
    assert!(fixed.iter().any(|line| line.starts_with("Bed X: 60.00 Y: 60.00 Z: ")), "{fixed:?}");
    assert!(!fixed.iter().any(|line| line.starts_with("echo:line")), "{fixed:?}");
    for keys in ["", "stow_each_touch = false", "test_signal = false"] {
        assert_eq!(measured(&with_pin(keys)), fixed, "{keys}");
    }
}

#[test]
fn its_commands_answer_and_a_fixed_probe_has_none() {
    let machine_with_pin = machine(&with_pin(""));
    let mut host = Conversation::new(&machine_with_pin);
    for line in ["M401", "M402", "M280 P0 S10", "M280 P0 S90", "BLTOUCH_DEBUG COMMAND=self_test"] {
        assert_eq!(host.say(line), ["ok"], "{line}");
    }
    let says = host.say("M280 P0 S200");
    assert!(says[0].contains("S: 200 is out of range, expected 0 to 180"), "{says:?}");
    // In touch mode the signal follows the pin.
    host.say("M280 P0 S60");
    let report = |host: &mut Conversation<'_>| host.say("M119").into_iter().find(|line| line.contains("z_")).unwrap();
    assert!(report(&mut host).ends_with("TRIGGERED"));
    host.say("M402");
    assert!(report(&mut host).ends_with("open"));

    let fixed = machine(&profile("prusa-mini"));
    let mut host = Conversation::new(&fixed);
    let says = host.say("M401");
    assert!(
        says[0].contains("the profile has no such servo (table bltouch: P0); no effect") && says.len() == 2,
        "{says:?}"
    );
    for line in ["M402", "M280 P0 S10", "BLTOUCH_DEBUG COMMAND=pin_up"] {
        assert_eq!(host.say(line), ["ok"], "{line}");
    }
}
