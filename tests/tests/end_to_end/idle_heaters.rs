//! A vanished host: unused heaters go off, after a warning.

use embedded_hal_async::delay::DelayNs;
use ferrostep_hal_shim::Heater;
use ferrostep_printer::Profile;
use ferrostep_session::Session;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_virtual_board::VirtualDelay;

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, Machine, machine};
use crate::end_to_end::refusals::Collector;
use crate::end_to_end::reports::temperatures;

const WARNING: &str = "echo:heaters go off in ";
const OFF: &str = "echo:heaters switched off: ";

fn now_s(machine: &Machine) -> f64 {
    machine.clock().now_ns() as f64 * 1e-9
}

/// Keeps the host silent. Returns the machine's lines meanwhile, and their times, s.
fn silence(machine: &Machine, seconds: u32) -> Vec<(f64, String)> {
    let start_s = now_s(machine);
    let mut said = Vec::new();
    let wait = async {
        for _ in 0..seconds * 10 {
            VirtualDelay(machine.clock()).delay_ms(100).await;
        }
    };
    machine.run_with(wait, |machine| {
        said.extend(machine.replies().take().into_iter().map(|line| (now_s(machine) - start_s, line)));
    });
    said
}

fn powers(machine: &Machine) -> [f32; 2] {
    [Heater::Nozzle, Heater::Bed].map(|heater| machine.heaters().power(heater))
}

/// The part of a reply about heaters that rest.
fn about_heaters(replies: &[String]) -> Vec<&str> {
    let about = replies.iter().filter(|reply| reply.starts_with(WARNING) || reply.starts_with(OFF));
    about.map(|reply| &reply[..WARNING.len().min(OFF.len())]).collect()
}

/// A hot machine, and the lines of a print up to its middle.
fn printing(profile: &Profile) -> (Machine, Vec<&'static str>) {
    (machine(profile), vec!["G28", "M140 S60", "M104 S210", "M190 S60", "M109 S210", "G1 X50 E1 F1200", "G1 X20 E2"])
}

/// The host dies in mid-print: after 25 minutes comes the warning, after 30 minutes all
/// heaters are off.
#[test]
fn heaters_go_off_when_the_host_is_gone() {
    for name in ["cartesian", "prusa-mini"] {
        let (machine, start) = printing(&profile(name));
        let mut conversation = Conversation::new(&machine);
        for line in start {
            assert_eq!(conversation.say(line).last().unwrap(), "ok", "{name}: {line}");
        }
        conversation.finish();
        let said = silence(&machine, 31 * 60);
        let [(warned_s, warning), (off_s, off)] = &said[..] else { panic!("{name}: {said:?}") };
        assert!(warning.starts_with(WARNING) && warning.contains("M86"), "{warning}");
        assert!(off.starts_with(OFF) && off.contains("M104") && off.contains("M140"), "{off}");
        assert!((1499.0..1510.0).contains(warned_s) && (1799.0..1810.0).contains(off_s), "{name}: {said:?}");
        assert_eq!(powers(&machine), [0.0; 2], "{name}");
        assert!(!machine.signals().is_halted(), "{name}");
        assert!(temperatures(&conversation.say("M105")[0]).iter().all(|sensor| sensor.2 == 0.0), "{name}");

        // Off is off: no message follows, and the printer continues where it was
        // with the next line.
        assert_eq!(silence(&machine, 3600), []);
        assert!(conversation.say("G1 X30 E3")[0].contains("cold extrusion prevented"), "{name}");
        for line in ["M104 S205", "M109 S210", "G1 X30 E3", "M400"] {
            assert_eq!(conversation.say(line).last().unwrap(), "ok", "{name}: {line}");
        }
        assert_eq!(conversation.position_mm()[0], 30.0);
        assert!(powers(&machine)[0] > 0.0);
        assert_eq!(silence(&machine, 31 * 60).len(), 2, "{name}: and the time begins anew");
    }
}

/// Hours of lines, one slow move, and a host that only asks: in none of these cases
/// has the host gone.
#[test]
fn heaters_stay_on_while_the_printer_is_used() {
    let (machine, start) = printing(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    start.iter().for_each(|line| drop(conversation.say(line)));
    // Four hours of print, at ten seconds a line.
    for line in 0..1440 {
        let replies = conversation.say(if line % 2 == 0 { "G1 X70 F300" } else { "G1 X20" });
        assert_eq!(about_heaters(&replies), [""; 0], "{replies:?}");
    }
    // One move of forty minutes, and the wait for its end.
    for line in ["G1 X180 F4", "M400"] {
        assert_eq!(about_heaters(&conversation.say(line)), [""; 0], "{line}");
    }
    // A print that is paused by a connected host.
    for _ in 0..8 {
        assert_eq!(silence(&machine, 20 * 60), []);
        assert!(conversation.say("M105")[0].starts_with("ok T:"));
    }
    assert!(powers(&machine).iter().all(|power| *power > 0.0));
}

/// Motion that is only planned takes its time as well.
#[test]
fn heaters_stay_on_in_an_estimated_long_move() {
    let profile = profile("cartesian");
    let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, Collector::default());
    let mut printer = session.printer();
    for line in ["M104 S210", "M109 S210", "G1 X180 F4", "G1 X20 F4", "M400"] {
        session.run(printer.execute(1, line)).unwrap();
    }
    assert_eq!(about_heaters(&session.replies().take()), [""; 0]);
}

/// A line that ends by itself is use, however long: no heater goes off in it, and none after it
/// before its time.
#[test]
fn heaters_stay_on_in_waits_that_end_by_themselves() {
    for (before, wait) in [
        (&["M104 S210"][..], "G4 S2400"),
        (&["M109 S210", "M86 S60"], "G4 S90"),
        (&["M86 S60"], "M109 S210"),
        (&["M86 S60"], "M190 S100"),
        (&["M190 S60", "M86 S60"], "M190 R40"),
        (&["M109 S210", "M86 S60"], "M109 R150"),
    ] {
        let machine = machine(&profile("cartesian"));
        let mut conversation = Conversation::new(&machine);
        before.iter().for_each(|line| drop(conversation.say(line)));
        let replies = conversation.say(wait);
        assert_eq!(replies.last().unwrap(), "ok", "{wait}");
        assert_eq!(about_heaters(&replies), [""; 0], "{wait}");
        // Then the host is silent.
        let timeout_s = f64::from(machine.signals().heater_timeout_s());
        let said = silence(&machine, 1900);
        let [_, (off_s, off)] = &said[..] else { panic!("{wait}: {said:?}") };
        assert!(off.starts_with(OFF) && (timeout_s - 1.0..timeout_s + 3.0).contains(off_s), "{wait}: {said:?}");
    }
}

/// A wait that never arrives is cut short, but not unannounced, and the printer says so: the print
/// would continue cold.
#[test]
fn a_warning_precedes_heaters_going_off_in_a_wait_that_never_arrives() {
    let mut weak = profile("prusa-mini");
    // In equilibrium at 92 degrees.
    weak.bed.mass.loss_w_per_k = weak.bed.mass.heater_w / 70.0;
    let machine = machine(&weak);
    let mut conversation = Conversation::new(&machine);
    let replies = conversation.say("M190 S100");
    assert_eq!(about_heaters(&replies), [WARNING, &OFF[..WARNING.len()]], "{replies:?}");
    assert!(replies.iter().any(|reply| reply.starts_with("echo:line 1: the heaters were switched off")), "{replies:?}");
    assert_eq!(powers(&machine), [0.0; 2]);
    assert!(!machine.signals().is_halted());
}

/// A line that has to wait its turn keeps the heaters on: the receiving side reports it. So they
/// stay on for as long as lines come while a person is waited for.
#[test]
fn a_waiting_line_keeps_heaters_on() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    for line in ["M86 S60", "M104 S100"] {
        conversation.say(line);
    }
    let mut next_s = 0.0;
    let mut said = Vec::new();
    conversation.say_while(b"M0 S300\n", |machine| {
        if now_s(machine) >= next_s {
            next_s = now_s(machine) + 25.0;
            machine.signals().note_host();
        }
        said.extend(machine.replies().take());
    });
    assert_eq!(about_heaters(&said), [""; 0]);
    assert!(powers(&machine)[0] > 0.0);
}

#[test]
fn the_heater_timeout_is_the_profiles_until_m86() {
    for (profile_s, m86, expected) in [(1800, None, 2), (300, None, 2), (0, None, 0), (1800, Some("M86 S0"), 0)] {
        let profile = Profile { heater_timeout_s: profile_s, ..profile("cartesian") };
        let machine = machine(&profile);
        let mut conversation = Conversation::new(&machine);
        assert_eq!(conversation.say("M86"), [format!("echo:M86 S{profile_s}"), "ok".to_owned()]);
        conversation.say("M104 S200");
        if let Some(m86) = m86 {
            assert_eq!(conversation.say(m86), ["ok"]);
        }
        let said = silence(&machine, 7200);
        assert_eq!(said.len(), expected, "{profile_s}: {said:?}");
        assert_eq!(powers(&machine)[0] > 0.0, expected == 0, "{profile_s}");
    }
    let machine = machine(&profile("cartesian"));
    let replies = Conversation::new(&machine).say("M86 S70000");
    assert!(replies[0].contains("S: ") && replies[0].contains("65535"), "{replies:?}");
}

/// Heaters without a target are not switched off, and nothing is reported.
#[test]
fn cold_heaters_cause_no_message() {
    let machine = machine(&profile("cartesian"));
    Conversation::new(&machine).say("G28");
    assert_eq!(silence(&machine, 7200), []);
}
