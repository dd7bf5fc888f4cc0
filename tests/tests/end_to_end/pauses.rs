//! Pauses, and the answers of a halted printer.

use ferrostep_hal_shim::Heater;
use ferrostep_printer::{Heating, PauseSettings, Profile};
use ferrostep_session::desk::{Desk, MotionState};
use ferrostep_testkit::host_side::numbered;

use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::hosts::{Conversation, Machine, machine};

const KILLED: &str = "Error:Printer halted. kill() called!";

fn now_s(machine: &Machine) -> f64 {
    machine.clock().now_ns() as f64 * 1e-9
}

/// A host that sends a print, with its line numbers.
struct Print<'a> {
    machine: &'a Machine,
    conversation: Conversation<'a>,
    number: i64,
}

impl<'a> Print<'a> {
    fn new(machine: &'a Machine) -> Self {
        Self { machine, conversation: Conversation::new(machine), number: 0 }
    }

    /// Begins a print: hot, homed, at X20 Y30 Z5, E3.
    fn begun(machine: &'a Machine) -> Self {
        let mut print = Self::new(machine);
        for line in ["M140 S60", "M109 S200", "G28", "M83", "G1 X20 Y30 Z5 F3000", "G1 E3 F300", "G1 F1200"] {
            print.say(line);
        }
        print.conversation.finish();
        print
    }

    fn say(&mut self, line: &str) -> Vec<String> {
        self.number += 1;
        self.conversation.say(&numbered(self.number, line))
    }

    /// Sends a line; a person presses a button this many seconds later.
    fn say_and_press(&mut self, line: &str, after_s: f64, press: impl Fn(&Machine)) -> Vec<String> {
        self.number += 1;
        let from_s = now_s(self.machine);
        let mut line = numbered(self.number, line);
        line.push('\n');
        let mut pressed = false;
        self.conversation.say_while(line.as_bytes(), |machine| {
            if !pressed && now_s(machine) >= from_s + after_s {
                pressed = true;
                press(machine);
            }
        })
    }

    /// Position of the motors of X, Y and Z, mm.
    fn stands_mm(&self) -> [f64; 3] {
        let [x, y, z, _] = self.machine.desk().motor_steps();
        [x as f64 / 80.0, y as f64 / 80.0, z as f64 / 400.0]
    }

    fn target(&self, heater: Heater) -> f32 {
        self.machine.heating().status(heater).target_celsius
    }
}

fn count(replies: &[String], text: &str) -> usize {
    replies.iter().flat_map(|reply| reply.lines()).filter(|line| *line == text).count()
}

#[test]
fn a_filament_change_goes_aside_waits_and_goes_back() {
    for line in ["M600", "M601", "M125", "M226"] {
        let machine = machine(&profile("cartesian"));
        let mut print = Print::begun(&machine);
        let before = (print.conversation.position_mm(), machine.desk().motor_steps());
        let from_s = now_s(&machine);
        let mut parked = [0.0; 3];
        let parked_at = std::cell::Cell::new(None);
        let replies = print.say_and_press(line, 60.0, |machine| {
            parked_at.set(Some(machine.desk().motor_steps()));
            machine.signals().end_wait();
        });
        if let Some([x, y, z, e]) = parked_at.get() {
            parked = [x as f64 / 80.0, y as f64 / 80.0, z as f64 / 400.0];
            assert!(e < before.1[3], "{line}: the filament is drawn back");
        }
        assert_eq!(parked, [10.0, 190.0, 25.0], "{line}");
        assert!((60.0..75.0).contains(&(now_s(&machine) - from_s)), "{line}: {}", now_s(&machine) - from_s);
        // The lines that hosts understand, once each, and signs of life meanwhile.
        for text in ["//action:paused", "//action:prompt_button Continue", "//action:prompt_show", "//action:resumed"] {
            assert_eq!(count(&replies, text), 1, "{line}: {text}: {replies:?}");
        }
        assert!((20..=32).contains(&count(&replies, "echo:busy: paused for user")), "{line}: {replies:?}");
        assert_eq!(replies.last().map(String::as_str), Some("ok"));
        // All positions as before, to the step.
        assert_eq!((print.conversation.position_mm(), machine.desk().motor_steps()), before, "{line}");
        assert_eq!(print.say("G1 X21"), ["ok"]);
        print.conversation.finish();
        assert_eq!(print.stands_mm(), [21.0, 30.0, 5.0]);
        assert_eq!((print.target(Heater::Nozzle), print.target(Heater::Bed)), (200.0, 60.0));
    }
}

/// A pause while Z follows a sheet that is tilted and bent: parked above it, back at its place, and
/// Z follows it again.
#[test]
fn a_pause_over_a_mesh_goes_back_to_its_place() {
    let text = ferrostep_profiles::builtin_text("prusa-mini").unwrap();
    let sheet = "\n[mesh.sheet]\ntilt_mm = { x = 0.5, y = -0.3 }\nbend_mm = 0.2\n";
    let profile = ferrostep_profiles::parse(&format!("{text}{sheet}"), "mini").unwrap();
    let machine = machine(&profile);
    let mut print = Print::new(&machine);
    for line in ["M140 S60", "M109 S200", "G28", "G29", "M83", "G1 X20 Y30 Z0.3 F3000", "G1 X140 Y150 E9"] {
        let said = print.say(line);
        assert_eq!(said.last().map(String::as_str), Some("ok"), "{line}: {said:?}");
        assert!(!said.iter().any(|reply| reply.starts_with("echo:line")), "{line}: {said:?}");
    }
    print.conversation.finish();
    let before = (print.conversation.position_mm(), machine.desk().motor_steps());
    assert_eq!(count(&print.say("M420"), "echo:Bed Leveling ON"), 1);
    let parked_at = std::cell::Cell::new(None);
    print.say_and_press("M601", 60.0, |machine| {
        parked_at.set(Some(machine.desk().motor_steps()));
        machine.signals().end_wait();
    });
    let [_, _, parked_z, _] = parked_at.get().unwrap();
    let lifted_mm = (parked_z - before.1[2]) as f64 / 400.0;
    assert!((18.0..22.0).contains(&lifted_mm), "20 mm up, above the fade's height: {lifted_mm}");
    let after = (print.conversation.position_mm(), machine.desk().motor_steps());
    assert_eq!(after.0, before.0);
    // Z follows a surface to within a part of a step, from whichever side it comes.
    let [x, y, z, e] = [0, 1, 2, 3].map(|motor| (after.1[motor] - before.1[motor]).abs());
    assert!((x, y, e) == (0, 0, 0) && z <= 1, "{before:?} {after:?}");
    assert_eq!(count(&print.say("M420"), "echo:Bed Leveling ON"), 1);
    assert_eq!(print.say("G1 X20 Y30 E9"), ["ok"]);
    print.conversation.finish();
    assert_eq!(print.conversation.position_mm()[..3], [20.0, 30.0, 0.3]);
}

#[test]
fn filament_is_drawn_out_and_pushed_in_by_the_lengths_of_m603() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    let before = (print.conversation.position_mm(), machine.desk().motor_steps());
    let says = print.say("M702");
    assert!(says[0].contains("no filament moves: give a length (U, or M603 U)"), "{says:?}");
    assert_eq!(print.say("M603 U400 L50.5"), ["ok"]);
    assert_eq!(print.say("M603"), ["echo:M603 U400 L50.5", "ok"]);
    let mut moved_mm = |line: &str| {
        let [.., from] = machine.desk().motor_steps();
        print.say(line);
        let [x, y, z, e] = machine.desk().motor_steps();
        assert_eq!(
            ([x, y, z], print.conversation.position_mm()),
            ([before.1[0], before.1[1], before.1[2]], before.0),
            "{line}"
        );
        (e - from) as f64 / 95.0
    };
    let near = |found: f64, expected: f64| assert!((found - expected).abs() < 0.02, "{found} for {expected}");
    near(moved_mm("M702"), -400.0);
    near(moved_mm("M701"), 50.5);
    near(moved_mm("M702 U-20 Z10"), -20.0);
    near(moved_mm("M701 L33 Z3"), 33.0);
    // A word out of range sets nothing, and cold filament does not move.
    let says = print.say("M603 U5 L2001");
    assert!(says[0].contains("L: 2001 is out of range, expected 0 to 2000"), "{says:?}");
    assert_eq!(print.say("M603")[0], "echo:M603 U400 L50.5");
    print.say("M109 R40");
    let says = print.say("M701");
    assert!(says[0].contains("cold"), "{says:?}");
}

#[test]
fn m0_waits_where_it_is_until_it_is_answered_or_its_time_is_over() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    let before = machine.desk().motor_steps();
    let from_s = now_s(&machine);
    print.say_and_press("M0 Look at it", 30.0, |machine| machine.signals().answer_prompt(0));
    assert!((30.0..30.3).contains(&(now_s(&machine) - from_s)));
    let from_s = now_s(&machine);
    // A button that the prompt does not have has no effect.
    print.say_and_press("M1 S7", 2.0, |machine| machine.signals().answer_prompt(1));
    assert!((7.0..7.3).contains(&(now_s(&machine) - from_s)));
    assert_eq!(machine.desk().motor_steps(), before);
    // An answer from before is not meant for the next question.
    machine.signals().answer_prompt(0);
    machine.signals().end_wait();
    let from_s = now_s(&machine);
    print.say("M0 P1500");
    assert!((1.5..1.8).contains(&(now_s(&machine) - from_s)));
}

#[test]
fn the_place_to_wait_is_in_the_line_and_bad_words_change_nothing() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    let before = machine.desk().motor_steps();
    for (line, error) in [
        ("M600 X900", "X: 900 is out of range, expected 0 to 200"),
        ("M601 Y-1", "Y: -1 is out of range, expected 0 to 200"),
        ("M125 Z-2", "Z: -2 is out of range, expected 0 or more"),
        ("M600 U2001", "U: 2001 is out of range, expected 0 to 2000"),
        ("M600 L-2001", "L: 2001 is out of range, expected 0 to 2000"),
        ("M602", "no print is paused; no effect (said once a job)"),
        ("M876", "M876: expected S"),
    ] {
        let replies = print.say(line);
        assert_eq!(replies.len(), 2, "{line}: {replies:?}");
        assert!(replies[0].ends_with(error), "{line}: {replies:?}");
        assert_eq!(machine.desk().motor_steps(), before, "{line}");
    }
    let parked = std::cell::Cell::new([0; 4]);
    print.say_and_press("M601 X150 Y20 Z40", 20.0, |machine| {
        parked.set(machine.desk().motor_steps());
        machine.signals().end_wait();
    });
    let [x, y, z, _] = parked.get();
    assert_eq!([x, y, z], [150 * 80, 20 * 80, 45 * 400]);
}

/// The profile says where the nozzle waits and how much filament M600 moves; the command's
/// words go before it.
#[test]
fn a_filament_change_draws_the_old_filament_out_and_pushes_the_new_one_in() {
    let place = PauseSettings {
        place_10nm: [15_000_000, 2_500_000],
        rise_10nm: 400_000,
        unload_10nm: 3_000_000,
        load_10nm: 2_800_000,
        more_10nm: 1_500_000,
        filament_10nm_per_s: 1_000_000,
    };
    let profile = Profile { pause: place, ..profile("cartesian") };
    for (line, unload_mm, load_mm) in
        [("M600", 30.0, 28.0), ("M600 U-50 L45", 50.0, 45.0), ("M600 U0 L0", 0.0, 0.0), ("M601", 0.0, 0.0)]
    {
        let machine = machine(&profile);
        let mut print = Print::begun(&machine);
        let before = (print.conversation.position_mm(), machine.desk().motor_steps());
        let parked = std::cell::Cell::new(([0; 4], 0));
        print.say_and_press(line, 30.0, |machine| {
            parked.set((machine.desk().motor_steps(), machine.desk().state().enabled_motors()));
            machine.signals().end_wait();
        });
        let ([x, y, z, e], enabled) = parked.get();
        assert_eq!([x, y, z], [150 * 80, 25 * 80, 9 * 400], "{line}");
        let steps_per_mm = 95.0;
        let out_mm = (before.1[3] - e) as f64 / steps_per_mm;
        let retraction_mm = out_mm - unload_mm;
        assert!((0.1..10.0).contains(&retraction_mm), "{line}: {out_mm} mm drawn out");
        assert_eq!(enabled & 0b1000 == 0, line.starts_with("M600"), "{line}: the extruder's motor");
        // The print that continues lacks the filament that was drawn out and not pushed in; E
        // does not see it.
        print.conversation.finish();
        let [x, y, z, e] = machine.desk().motor_steps();
        assert_eq!([x, y, z], before.1[..3], "{line}");
        let lacks_mm = (before.1[3] - e) as f64 / steps_per_mm;
        assert!((lacks_mm - (unload_mm - load_mm)).abs() < 0.02, "{line}: {lacks_mm} mm");
        assert_eq!(print.conversation.position_mm(), before.0, "{line}");
    }
}

/// The second button of M600's prompt pushes the new filament in, and more each time it is pressed;
/// filament that was pushed is not pushed again when the print continues, and E does not see it.
/// M601's prompt has no such button.
#[test]
fn more_filament_is_pushed_by_a_button() {
    let mut profile = profile("cartesian");
    (profile.pause.load_10nm, profile.pause.more_10nm) = (2_800_000, 1_500_000);
    for (line, presses, pushed_mm) in [("M600", 0, 28.0), ("M600", 1, 43.0), ("M600", 3, 73.0), ("M601", 2, 0.0)] {
        let machine = machine(&profile);
        let mut print = Print::begun(&machine);
        let before = (print.conversation.position_mm(), machine.desk().motor_steps());
        let (from_s, mut pressed) = (now_s(&machine), 0);
        print.number += 1;
        let text = format!("{}\n", numbered(print.number, line));
        let replies = print.conversation.say_while(text.as_bytes(), |machine| {
            if now_s(machine) >= from_s + 30.0 * f64::from(pressed + 1) {
                machine.signals().answer_prompt(u8::from(pressed < presses));
                pressed += 1;
            }
        });
        let is_change = line == "M600";
        let button = count(&replies, "//action:prompt_button Push 15 mm");
        assert_eq!(button, if is_change { presses as usize + 1 } else { 0 }, "{line}: {replies:?}");
        assert_eq!(count(&replies, "//action:resumed"), 1, "{replies:?}");
        print.conversation.finish();
        let [x, y, z, e] = machine.desk().motor_steps();
        assert_eq!([x, y, z], before.1[..3], "{line}");
        let more_mm = (e - before.1[3]) as f64 / 95.0;
        assert!((more_mm - pushed_mm).abs() < 0.02, "{line}: {more_mm} mm");
        assert_eq!(print.conversation.position_mm(), before.0, "{line}");
    }
}

/// Too cold to push: the person reads why, and is still asked.
#[test]
fn a_cold_nozzle_pushes_no_more() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    print.say("M109 R40");
    let before = machine.desk().motor_steps();
    let pressed = std::cell::Cell::new(0);
    let from_s = now_s(&machine);
    print.number += 1;
    let text = format!("{}\n", numbered(print.number, "M600"));
    let replies = print.conversation.say_while(text.as_bytes(), |machine| {
        if now_s(machine) >= from_s + 30.0 * f64::from(pressed.get() + 1) {
            machine.signals().answer_prompt(u8::from(pressed.get() == 0));
            pressed.set(pressed.get() + 1);
        }
    });
    assert!(replies.iter().any(|reply| reply.contains("cold extrusion prevented")), "{replies:?}");
    assert_eq!(pressed.get(), 2);
    assert_eq!(machine.desk().motor_steps(), before);
}

/// A cold nozzle refuses to extrude: the line says so and the host's print waits.
#[test]
fn a_cold_nozzle_is_not_unloaded() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    print.say("M109 R40");
    let before = machine.desk().motor_steps();
    let replies = print.say("M600 U50 L50");
    assert!(replies[0].contains("cold extrusion prevented"), "{replies:?}");
    assert_eq!(count(&replies, "//action:pause"), 1, "{replies:?}");
    assert_eq!(machine.desk().motor_steps(), before);
}

/// M25 is a host's own pause: it waits itself, and its next move goes back first. Meanwhile a
/// person moves the machine by hand.
#[test]
fn a_host_that_pauses_by_itself_finds_the_print_where_it_was() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    let before = (print.conversation.position_mm(), machine.desk().motor_steps());
    assert_eq!(count(&print.say("M25"), "//action:paused"), 1);
    assert_eq!(print.stands_mm(), [10.0, 190.0, 25.0]);
    for line in ["G91", "G1 X5 F600", "G1 E2", "G90"] {
        assert_eq!(print.conversation.say(line), ["ok"], "{line}");
    }
    print.conversation.finish();
    assert_eq!(print.stands_mm(), [15.0, 190.0, 25.0]);
    let replies = print.say("G1 X20 Y30");
    assert_eq!(count(&replies, "//action:resumed"), 1, "{replies:?}");
    assert_eq!(print.conversation.position_mm(), before.0);
    let [x, y, z, e] = machine.desk().motor_steps();
    assert_eq!(([x, y, z], e), ([before.1[0], before.1[1], before.1[2]], before.1[3] + 2 * 95));

    // M24 does so as well; without a known home nothing goes back.
    print.say("M25");
    assert_eq!(count(&print.conversation.say("M24"), "//action:resumed"), 1);
    assert_eq!(machine.desk().motor_steps(), [x, y, z, e]);
    print.say("M25");
    print.conversation.say("M84 X");
    let replies = print.conversation.say("M602");
    assert!(replies.concat().contains("X has lost its home position: home it (G28 X)"), "{replies:?}");
    print.conversation.say("G28 X");
    assert_eq!(count(&print.conversation.say("M602"), "//action:resumed"), 1);
    assert_eq!(print.stands_mm(), [20.0, 30.0, 5.0]);
}

/// A mode that the print sets first after its host's pause is the print's: it goes back before the
/// mode is set, which then holds.
#[test]
fn a_mode_that_comes_first_after_a_host_s_pause_is_the_print_s() {
    let place_mm = |mode: &str, line: &str| {
        let machine = machine(&profile("cartesian"));
        let mut print = Print::begun(&machine);
        print.say("M25");
        let replies = print.say(mode);
        assert_eq!(count(&replies, "//action:resumed"), 1, "{mode}: {replies:?}");
        print.say(line);
        print.conversation.finish();
        let [x, y, _] = print.stands_mm();
        [x, y]
    };
    // The start is X20 Y30.
    assert_eq!(place_mm("G91", "G1 X1.5 Y-0.5"), [21.5, 29.5]);
    assert_eq!(place_mm("G92 X7 Y9", "G1 X8 Y8"), [21.0, 29.0]);
    assert_eq!(place_mm("G20", "G1 X1 Y2"), [25.4, 50.8]);
}

#[test]
fn heaters_that_went_off_in_a_pause_are_hot_again_before_anything_moves() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    // The printer waits for longer than the heaters stay on.
    let off = std::cell::Cell::new(false);
    print.say_and_press("M600", 4000.0, |machine| {
        off.set(machine.heating().status(Heater::Nozzle).target_celsius == 0.0);
        machine.signals().end_wait();
    });
    assert!(off.get(), "the heaters go off in half an hour");
    assert_eq!((print.target(Heater::Nozzle), print.target(Heater::Bed)), (200.0, 60.0));
    assert!(machine.heating().status(Heater::Nozzle).celsius > 195.0);

    // The host waits.
    machine.run(async {
        embedded_hal_async::delay::DelayNs::delay_ms(
            &mut ferrostep_virtual_board::VirtualDelay(machine.clock()),
            4_000_000,
        )
        .await
    });
    assert_eq!(print.target(Heater::Nozzle), 0.0);
    let replies = print.say("G1 X25 E0.5");
    assert!(replies.concat().contains("they heat up again"), "{replies:?}");
    assert!(replies.iter().any(|reply| reply.contains(" W:")), "{replies:?}");
    assert_eq!(replies.last().map(String::as_str), Some("ok"));
    assert!(machine.heating().status(Heater::Nozzle).celsius > 195.0);
    assert_eq!((print.target(Heater::Nozzle), print.target(Heater::Bed)), (200.0, 60.0));
}

/// The board knows moves of minutes when a print's end code arrives: they are made with the heat
/// for which they were written.
#[test]
fn a_nozzle_stays_hot_until_the_moves_before_are_made() {
    for off in ["M104 S0", "M104 S150", "M109 R100"] {
        let machine = machine(&profile("cartesian"));
        let mut print = Print::begun(&machine);
        for x in [60, 20].into_iter().cycle().take(60) {
            print.say(&format!("G1 X{x} E1 F1200"));
        }
        let [from, to] = [print.stands_mm(), [20.0, 30.0, 5.0]];
        let mut coldest = f32::INFINITY;
        print.number += 1;
        let line = format!("{}\n", numbered(print.number, off));
        print.conversation.say_while(line.as_bytes(), |machine| {
            let [x, ..] = machine.desk().motor_steps();
            if x != 20 * 80 || machine.heating().status(Heater::Nozzle).target_celsius > 160.0 {
                coldest = coldest.min(machine.heating().status(Heater::Nozzle).celsius);
            }
        });
        assert_ne!(from, to, "{off}: motion was under way");
        assert_eq!(print.stands_mm(), to, "{off}");
        assert!(coldest > 190.0, "{off}: {coldest}");
        assert!(print.target(Heater::Nozzle) < 160.0, "{off}");
    }
    // A person's line is not part of the print, and acts at once.
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    for x in [60, 20].into_iter().cycle().take(60) {
        print.say(&format!("G1 X{x} E1 F1200"));
    }
    let before = print.stands_mm();
    print.conversation.say("M104 S0");
    assert_eq!((print.target(Heater::Nozzle), print.stands_mm()), (0.0, before));
}

/// Files that set a target and wait for none are printed when it is there.
#[test]
fn a_print_waits_for_a_target_on_its_way() {
    for line in ["G1 X60 E1 F1200", "G1 E1 F300", "G2 X60 Y30 I20 J0 E1", "G10"] {
        let machine = machine(&profile("cartesian"));
        let mut print = Print::new(&machine);
        for line in ["G28", "M83", "G1 X20 Y30 Z5 F3000", "M104 S200"] {
            print.say(line);
        }
        let replies = print.say(line);
        assert!(replies[0].contains("the print waits for 200 C"), "{line}: {replies:?}");
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{line}: {replies:?}");
        assert!(machine.heating().status(Heater::Nozzle).celsius > 195.0, "{line}");
        print.conversation.finish();
        assert_ne!(machine.desk().motor_steps()[3], 0, "{line}");
    }
}

#[test]
fn a_print_that_is_too_cold_pauses_its_host() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::new(&machine);
    print.say("M83");
    let replies = print.say("G1 X5 E1 F600");
    assert!(replies[0].contains("cold extrusion prevented"), "{replies:?}");
    assert_eq!((count(&replies, "//action:pause"), count(&replies, "// action:pause")), (1, 1), "{replies:?}");
    // A person's line is refused, without ending the print.
    let replies = print.conversation.say("G1 X5 E1 F600");
    assert_eq!(replies.len(), 2, "{replies:?}");
}

#[test]
fn a_halted_printer_answers_questions_and_ends_prints() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    let replies = print.conversation.say("M112");
    assert_eq!((count(&replies, KILLED), count(&replies, "//action:cancel")), (1, 1), "{replies:?}");
    // A host that connects.
    for line in
        ["N0 M110 N0*125", "M115", "M21", "M155 S2", "M105", "M114", "M119", "M84", "M104 S0", "M140 S0", "M220"]
    {
        let replies = print.conversation.say(line);
        assert_eq!(count(&replies, KILLED), 0, "{line}: {replies:?}");
        assert!(replies.last().unwrap().starts_with("ok"), "{line}: {replies:?}");
        assert!(!replies.concat().contains("halted"), "{line}: {replies:?}");
    }
    print.number = 0;
    for line in ["G28", "G1 X5", "M104 S200", "M106", "M109 S200", "M600"] {
        let replies = print.say(line);
        assert_eq!((count(&replies, KILLED), count(&replies, "//action:cancel")), (1, 0), "{line}: {replies:?}");
        assert!(replies.iter().any(|reply| reply.starts_with("!!")), "{line}: {replies:?}");
        assert_eq!(replies.last().map(String::as_str), Some("ok"));
    }
    assert_eq!(print.conversation.say("M999"), ["ok"]);
    assert_eq!(count(&print.conversation.say("M112"), "//action:cancel"), 1, "each halt ends the prints once");
}

/// E is the filament that the motor has pushed, both in the halt and after it.
#[test]
fn e_is_what_was_pushed_in_a_halt_and_after_it() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    print.say("M82");
    print.say("G92 E0");
    let from = machine.desk().motor_steps()[3];
    let from_s = now_s(&machine);
    for (x, e) in [(60, 2), (20, 4), (60, 6)] {
        print.say(&format!("G1 X{x} E{e} F1200"));
    }
    // In the middle of a move.
    let to_s = from_s + 3.0;
    let mut halted = false;
    print.conversation.say_while(b"M400\n", |machine| {
        if !halted && now_s(machine) >= to_s {
            halted = true;
            machine.halt();
        }
    });
    let e = |replies: &[String]| {
        let line = replies.iter().find(|reply| reply.starts_with("X:")).unwrap();
        line.split(' ').find_map(|word| word.strip_prefix("E:")).unwrap().parse::<f64>().unwrap()
    };
    let pushed = (machine.desk().motor_steps()[3] - from) as f64 / 95.0;
    let in_halt = e(&print.conversation.say("M114"));
    assert!((in_halt - pushed).abs() < 0.02 && pushed > 0.5, "{in_halt}, pushed {pushed}");
    print.conversation.say("M999");
    let after = e(&print.conversation.say("M114"));
    assert!((after - pushed).abs() < 0.02, "{after}, pushed {pushed}");
}

#[test]
fn a_file_that_pauses_goes_on_by_itself() {
    let text = "M302 P1\nG28\nM83\nG1 X50 Y50 Z2 F3000\nG1 E1 F300\nM600\nM0\nM25\nG1 X60 E1\nM24\n";
    let print = rehearse(&profile("cartesian"), 128, &mut text.as_bytes());
    // M24 finds nothing paused: the move before has continued.
    assert!(print.outcome.is_ok(), "{:?}", print.outcome);
    assert_eq!(print.logical_10nm, [6_000_000, 5_000_000, 200_000, 200_000]);
}

#[test]
fn texts_and_progress_go_to_the_host() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::new(&machine);
    assert_eq!(print.say("M117 Layer 3"), ["//action:notification Layer 3", "ok"]);
    assert_eq!(print.say("M73 P12 R34"), ["echo:M73 Progress: 12%; Time left: 34m", "ok"]);
    assert_eq!(print.say("M73 P13"), ["echo:M73 Progress: 13%; Time left: 34m", "ok"]);
    assert_eq!(print.say("M85 S600"), ["ok"]);
    assert_eq!(print.say("M86"), ["echo:M86 S600", "ok"]);
    assert_eq!(print.say("M85 S0"), ["echo:M86 S600", "ok"]);
}

#[test]
fn a_move_after_the_motors_were_off_says_so_once() {
    let machine = machine(&profile("cartesian"));
    let mut print = Print::begun(&machine);
    print.conversation.say("M84");
    let replies = print.say("G1 X21");
    assert!(replies[0].contains("XYZ lost its home when the motors were off"), "{replies:?}");
    assert_eq!(print.say("G1 X22"), ["ok"]);
    print.conversation.say("G28");
    print.conversation.say("M84 Y");
    print.conversation.say("G28 Y");
    assert_eq!(print.say("G1 Y20"), ["ok"], "homed again, so without a remark");
}
