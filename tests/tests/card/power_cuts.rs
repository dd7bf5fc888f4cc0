//! The power is cut while a card is printed, and the print continues after the reset.
//!
//! Only the card and the place of the motors remain after a cut: a printer that is switched on with
//! a copy of the card knows nothing else.

use std::cell::RefCell;
use std::rc::Rc;

use ferrostep_printer::Profile;
use ferrostep_profiles::{builtin_text, parse};
use ferrostep_random_cases::{Share, share_of};

use crate::card::setup::{Event, Setup, StepLog, image, nothing, profile};

mod signal;

/// Steps of a move that may come after the note of its end.
const JOINED_STEPS: usize = 8;

/// State that a power cut leaves.
struct Cut {
    /// Blocks of the card that differ from those before the print.
    changed: Vec<(usize, Vec<u8>)>,
    /// Number of events that the motors had made.
    events: usize,
}

impl Cut {
    fn card(&self, before: &[u8]) -> Vec<u8> {
        let mut image = before.to_vec();
        for (index, block) in &self.changed {
            image[index * 512..][..512].copy_from_slice(block);
        }
        image
    }
}

/// Layers of squares with everything that a record has: percentages, relative parts, retractions of
/// both kinds, G92, hops, an arc.
fn program(layers: u32) -> Vec<u8> {
    let mut text = String::from(
        "M140 S60\nM104 S205\nG28\nM190 S60\nM109 S205\nG21\nG90\nM82\nM204 P900 T1100\nM203 X150\nM205 J0.05\nM207 S0.8 F2400 Z0\n\
         G92 E0\nM106 S90\nG1 Z2 F600\nG1 X20 Y20 F6000\n",
    );
    let mut e = 0.0;
    for layer in 0..layers {
        let z = 0.2 + 0.2 * f64::from(layer);
        text += &format!("G0 Z{z:.2} F600\n");
        if layer == 3 {
            text += "M220 S90\nM221 S95\nM106 S200\nM900 K0.03\n";
        }
        if layer % 4 == 1 {
            text += "G92 E0\n";
            e = 0.0;
        }
        for (index, (x, y)) in [(60, 20), (60, 60), (20, 60), (20, 20)].into_iter().enumerate() {
            e += 1.3;
            text += &format!("G1 X{x}.{layer} Y{y} E{e:.4} F1800\n");
            match (layer + index as u32) % 5 {
                0 => text += "G10\nG0 X30 Y33 F7200\nG11\n",
                1 => {
                    text +=
                        &format!("G1 E{:.4} F2100\nG0 Z{:.2}\nG0 X40 Y25\nG0 Z{z:.2}\nG1 E{e:.4}\n", e - 0.9, z + 0.4);
                }
                2 => {
                    e += 0.6;
                    text += &format!("G91\nM83\nG1 X3 Y-2 E0.6\nG90\nM82\nG92 E{e:.4}\n");
                }
                3 => {
                    e += 0.5;
                    text += &format!("G2 I2 J2 E{e:.4}\n");
                }
                _ => {}
            }
        }
    }
    text += "G1 E-1 F1800\nG0 Z30 F600\nG0 X0 Y100 F6000\n";
    text.into_bytes()
}

/// SplitMix64.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mixed = (*state ^ *state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    mixed ^ mixed >> 31
}

fn logged(profile: Profile, image: Vec<u8>) -> (Setup, Rc<RefCell<Vec<Event>>>) {
    let events = Rc::new(RefCell::new(Vec::new()));
    (Setup::logged(profile, image, StepLog(Some(Rc::clone(&events)))), events)
}

/// The card with the file on it.
fn filled(text: &[u8]) -> Vec<u8> {
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("PRINT.GCO", text);
    setup.card.with_slot(|slot| slot.with_image(|image| image.clone()))
}

/// Prints to the end, with cuts at about this many random looks at the hosts' lines. Returns the
/// cuts, all events and the final positions of the motors.
fn cut_print(profile: Profile, filled: &[u8], wanted: u64, state: &mut u64) -> (Vec<Cut>, Vec<Event>, [i64; 4]) {
    let lines = ["M21", "M23 PRINT.GCO", "M24"];
    let mut looks = 0;
    Setup::new(profile, filled.to_vec()).say(&lines, &mut |_, _| {
        looks += 1;
        Vec::new()
    });
    let (setup, events) = logged(profile, filled.to_vec());
    let mut cuts = Vec::new();
    let said = setup.say(&lines, &mut |card, _| {
        if random(state) % looks < wanted {
            let mut changed = Vec::new();
            card.with_slot(|slot| {
                slot.with_image(|image| {
                    for (index, (old, new)) in filled.chunks(512).zip(image.chunks(512)).enumerate() {
                        if old != new {
                            changed.push((index, new.to_vec()));
                        }
                    }
                });
            });
            cuts.push(Cut { changed, events: events.borrow().len() });
        }
        Vec::new()
    });
    println!("{looks} looks");
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    (cuts, events.take(), setup.motor_steps())
}

/// The steps of the motors in the mask, without the others'.
fn steps(events: &[Event], mask: u8) -> Vec<(u8, u8)> {
    events
        .iter()
        .filter_map(|event| match event {
            Event::Step(axes, directions) => Some((axes & mask, directions & mask)),
            Event::MoveEnded(_) => None,
        })
        .filter(|(axes, _)| *axes != 0)
        .collect()
}

/// Net steps of a motor.
fn net(events: &[Event], motor: u8) -> i64 {
    let of_motor = steps(events, 1 << motor);
    of_motor.iter().map(|(_, directions)| if *directions == 0 { 1 } else { -1 }).sum()
}

/// Number of events up to the end of the last move of a line up to this one.
fn end_of_line(events: &[Event], line: u32) -> usize {
    // Those of hosts have small numbers.
    let is_it = |event: &Event| matches!(event, Event::MoveEnded(ended) if *ended <= line && *ended + 12 > line);
    events.iter().rposition(is_it).map_or(0, |index| index + 1)
}

fn number_after(said: &[String], what: &str) -> Option<u32> {
    let line = said.iter().find(|line| line.contains("was interrupted at"))?;
    line.split_once(what)?.1.split(|c: char| !c.is_ascii_digit()).find(|word| !word.is_empty())?.parse().ok()
}

#[test]
fn a_print_goes_on_after_a_cut_at_any_instant_and_makes_the_steps_that_were_missing() {
    goes_on(profile("cartesian"), &program(14), 150);
}

/// The tools change every other layer: the print continues with the one that it
/// had, and its offset.
#[test]
fn a_print_of_two_tools_goes_on_with_the_tool_that_it_had() {
    let text = String::from_utf8(program(14)).unwrap();
    let mut layer = 0;
    let mut changed = String::new();
    for line in text.lines() {
        if line.starts_with("G0 Z") && line.ends_with("F600") {
            layer += 1;
            if layer % 2 == 0 {
                changed += if layer % 4 == 0 { "T0\n" } else { "T1\n" };
            }
        }
        changed += line;
        changed += "\n";
    }
    assert!(changed.matches("T1").count() >= 3);
    let tools = "[tools.t1]\nmotor = \"e1\"\noffset_mm = { x = -12.5, y = 3.75, z = 0.1 }\nheater = \"nozzle1\"\n";
    let two = parse(&format!("{}\n{tools}", builtin_text("cartesian").unwrap()), "two.toml").unwrap();
    goes_on(two, &changed.replace("M109 S205", "M109 T1 S200\nM109 T0 S205").into_bytes(), 150);
}

/// Cuts at about this many random looks at the hosts' lines, and a print that continues after each
/// of this run's share of them; always after the first, the last, and one in the middle.
fn goes_on(profile: Profile, text: &[u8], wanted: u64) {
    let mut state = 7;
    let filled = filled(text);
    let (cuts, all, end) = cut_print(profile, &filled, wanted, &mut state);
    assert!(cuts.len() > wanted as usize / 3, "{}", cuts.len());
    let (mut resumed, mut without) = (0, 0);
    let mut lines = Vec::new();
    let always = [0, cuts.len() / 2, cuts.len() - 1];
    for index in always.into_iter().chain(share_of(cuts.len() as u64).map(|index| index as usize)) {
        let cut = &cuts[index];
        let (setup, events) = logged(profile, cut.card(&filled));
        let mut printer = setup.printer();
        let said = setup.converse(&mut printer, &["M21"], &mut nothing);
        let Some(line) = number_after(&said, "after line ") else {
            without += 1;
            assert!(said.contains(&"ok".to_owned()), "{said:?}");
            continue;
        };
        lines.push(line);
        // Moves that were executed, and no others, count as printed.
        let first_missing = end_of_line(&all, line);
        assert!(first_missing <= cut.events, "cut {index}: the motors had not come to line {line}");
        let offset = number_after(&said, "at byte ").unwrap() as usize;
        let before = text[..offset].iter().filter(|byte| **byte == b'\n').count();
        assert_eq!(before, line as usize, "cut {index}");
        let said = setup.converse(&mut printer, &["M1000"], &mut nothing);
        assert_eq!(said.last().unwrap(), "Done printing file", "cut {index}, line {line}: {said:?}");
        let events = events.take();
        let missing = &all[first_missing..];
        // X, Y and Z make exactly these steps.
        let (made, wanted) = (steps(&events, 0b111), steps(missing, 0b111));
        let same = made.iter().rev().zip(wanted.iter().rev()).take_while(|(made, wanted)| made == wanted).count();
        // The last steps of a move that was joined to the next one come after the note of its end.
        assert!(wanted.len() - same <= JOINED_STEPS, "cut {index}, line {line}: {same} of {} steps", wanted.len());
        assert!(made.len() > wanted.len(), "cut {index}: no approach");
        assert_eq!(setup.motor_steps()[..3], end[..3], "cut {index}, line {line}");
        // The filament: that of the missing lines, to a step, and what was drawn back
        // and pushed again.
        let (pushed, owed) = (net(&events, 3), net(missing, 3));
        assert!((pushed - owed).abs() <= 1, "cut {index}, line {line}: {pushed} instead of {owed}");
        resumed += 1;
    }
    lines.dedup();
    println!("{resumed} cuts resumed, {without} before the first place, at {} places", lines.len());
    assert!(resumed > 0, "{without}");
    assert!((resumed > 40 && lines.len() > 10) || !Share::of_this_run().is_all(), "{resumed} {lines:?}");
}

/// A card whose print was cut in the middle, and the line after which it continues.
fn interrupted() -> (Vec<u8>, u32) {
    let filled = filled(&program(14));
    let mut seen = 0;
    let setup = Setup::new(profile("cartesian"), filled);
    let mut card_image = Vec::new();
    setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |card, _| {
        seen += 1;
        if seen == 200 {
            card_image = card.with_slot(|slot| slot.with_image(|image| image.clone()));
        }
        Vec::new()
    });
    let said = Setup::new(profile("cartesian"), card_image.clone()).say(&["M21"], &mut nothing);
    let line = number_after(&said, "after line ").unwrap();
    (card_image, line)
}

const NOTHING: &str = "echo:power loss: no interrupted print is kept";

#[test]
fn the_printer_says_what_it_knows_and_forgets_it_when_asked() {
    let (card, line) = interrupted();
    let setup = Setup::new(profile("cartesian"), card);
    let mut printer = setup.printer();
    let said = setup.converse(&mut printer, &["M21"], &mut nothing);
    let text = program(14);
    let offset: usize = text.split_inclusive(|byte| *byte == b'\n').take(line as usize).map(<[u8]>::len).sum();
    let z_mm = said.iter().find_map(|line| line.split_once("at Z")).unwrap().1;
    let expected = [
        "echo:SD card ok".to_owned(),
        format!(
            "echo:power loss: the print of /PRINT.GCO was interrupted at byte {offset} of {}, after line {line}, at Z{z_mm}",
            text.len()
        ),
        "echo:power loss: M1000 resumes it, M1000 C forgets it".to_owned(),
        "//action:prompt_end".to_owned(),
        "//action:prompt_begin A print was interrupted. Continue heats, homes X and Y and resumes; Forget drops it"
            .to_owned(),
        "//action:prompt_button Continue".to_owned(),
        "//action:prompt_button Forget".to_owned(),
        "//action:prompt_show".to_owned(),
        "ok".to_owned(),
    ];
    assert_eq!(said, expected);
    // The height is known, and no axis is homed.
    let said = setup.converse(&mut printer, &["M114"], &mut nothing);
    assert!(said[0].starts_with(&format!("X:0.00 Y:0.00 Z:{z_mm} ")), "{said:?}");
    assert_eq!(setup.converse(&mut printer, &["M1000 S"], &mut nothing), expected[1..]);
    let said = setup.converse(&mut printer, &["M1000 C"], &mut nothing);
    assert_eq!(said, ["echo:power loss: the interrupted print is forgotten", "//action:prompt_end", "ok"]);
    for command in ["M1000 S", "M1000 C", "M1000"] {
        assert_eq!(setup.converse(&mut printer, &[command], &mut nothing), [NOTHING, "ok"], "{command}");
    }
    assert_eq!(setup.converse(&mut printer, &["M21"], &mut nothing), ["echo:SD card ok", "ok"]);
}

#[test]
fn the_button_of_the_prompt_goes_on() {
    let (card, _) = interrupted();
    let setup = Setup::new(profile("cartesian"), card);
    let mut printer = setup.printer();
    setup.converse(&mut printer, &["M21"], &mut nothing);
    let said = setup.converse(&mut printer, &["M876 S0"], &mut nothing);
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    assert_eq!(setup.converse(&mut printer, &["M1000 S"], &mut nothing), [NOTHING, "ok"]);
}

#[test]
fn the_other_button_gives_it_up() {
    let (card, _) = interrupted();
    let setup = Setup::new(profile("cartesian"), card);
    let mut printer = setup.printer();
    setup.converse(&mut printer, &["M21"], &mut nothing);
    let said = setup.converse(&mut printer, &["M876 S1"], &mut nothing);
    assert_eq!(said, ["echo:power loss: the interrupted print is forgotten", "//action:prompt_end", "ok"]);
    assert_eq!(setup.converse(&mut printer, &["M1000 S"], &mut nothing), [NOTHING, "ok"]);
}

#[test]
fn a_print_that_has_ended_or_is_not_to_be_kept_leaves_nothing() {
    let filled = filled(&program(6));
    for (before, ends) in
        [("M413 S1", None), ("M413 S1", Some("M524")), ("M413 S0", None), ("M413 S1", Some("M413 S0"))]
    {
        let setup = Setup::new(profile("cartesian"), filled.clone());
        let mut printer = setup.printer();
        let mut seen = 0;
        setup.converse(&mut printer, &["M21", before, "M23 PRINT.GCO", "M24"], &mut |_, _| {
            seen += 1;
            if seen == 100 { ends.map(str::to_owned).into_iter().collect() } else { Vec::new() }
        });
        assert!(seen > 100);
        let state = if before == "M413 S0" || ends == Some("M413 S0") { "OFF" } else { "ON" };
        let said = setup.converse(&mut printer, &["M413", "M1000 S"], &mut nothing);
        assert_eq!(said, [&format!("echo:Power-loss recovery {state}"), "ok", NOTHING, "ok"], "{before} {ends:?}");
    }
}

#[test]
fn another_print_forgets_the_interrupted_one() {
    for before in ["M413 S1", "M413 S0"] {
        let (card, _) = interrupted();
        let setup = Setup::new(profile("cartesian"), card);
        let mut printer = setup.printer();
        let lines = ["M21", before, "M32 !PARTS/ONE.GCO#", "M1000 S"];
        let said = setup.converse(&mut printer, &lines, &mut nothing);
        let forgotten = "echo:power loss: the print that was interrupted before is forgotten";
        assert!(said.iter().any(|line| line == forgotten), "{before}: {said:?}");
        assert_eq!(said[said.len() - 2..], [NOTHING, "ok"], "{before}");
    }
}

/// The text of a refusal of M1000.
fn refusal(setup: &Setup, printer: &mut ferrostep_session::DeskPrinter<'_>) -> String {
    let said = setup.converse(printer, &["M1000"], &mut nothing);
    assert_eq!(said.last().unwrap(), "ok", "{said:?}");
    assert_eq!(setup.motor_steps()[3], 0, "no filament has moved");
    said[0].clone()
}

#[test]
fn what_cannot_go_on_is_refused_with_its_reason() {
    let (card, _) = interrupted();
    let what = "echo:power loss: the print of /PRINT.GCO cannot resume: ";
    // The file is another one, or missing.
    let setup = Setup::new(profile("cartesian"), card.clone());
    setup.put("PRINT.GCO", b"G28\n");
    let said = setup.say(&["M21"], &mut nothing);
    assert_eq!(said[1], format!("{what}the file differs from the one that was being printed"));
    assert_eq!(said[2], "echo:power loss: M1000 C forgets it");
    let setup = Setup::new(profile("cartesian"), card.clone());
    let mut printer = setup.printer();
    setup.converse(&mut printer, &["M21", "M30 PRINT.GCO"], &mut nothing);
    assert_eq!(refusal(&setup, &mut printer), format!("{what}file not found"));
    // The machine has moved before the card was found.
    let setup = Setup::new(profile("cartesian"), card.clone());
    let mut printer = setup.printer();
    setup.converse(&mut printer, &["G0 Z5", "M21"], &mut nothing);
    assert!(refusal(&setup, &mut printer).starts_with(&format!("{what}the height of the nozzle is unknown")));
    // Another machine.
    let setup = Setup::new(profile("corexy"), card.clone());
    let mut printer = setup.printer();
    setup.converse(&mut printer, &["M21"], &mut nothing);
    assert!(refusal(&setup, &mut printer).starts_with(&format!("{what}another machine")));
    // A print is under way.
    let setup = Setup::new(profile("cartesian"), card);
    let mut seen = 0;
    let said = setup.say(&["M21", "M32 !PRINT.GCO#"], &mut |_, _| {
        seen += 1;
        if seen == 50 { vec!["M1000".to_owned(), "M1000 C".to_owned()] } else { Vec::new() }
    });
    assert_eq!(said.iter().filter(|line| line.contains("the memory card is in use")).count(), 2, "{said:?}");
    assert_eq!(said.last().unwrap(), "Done printing file");
}

/// A paused print: the nozzle is aside, and a person has moved it. The print continues from the
/// line at which it paused.
#[test]
fn a_cut_during_a_pause_knows_where_the_nozzle_stands() {
    let text = program(14);
    let filled = filled(&text);
    for jog in [None, Some("G0 Z55.5"), Some("G0 Z3.5")] {
        let (setup, events) = logged(profile("cartesian"), filled.clone());
        let mut printer = setup.printer();
        let (mut seen, mut cut) = (0, 0);
        let mut image = Vec::new();
        let said = setup.converse(&mut printer, &["M21", "M23 PRINT.GCO", "M24"], &mut |card, _| {
            seen += 1;
            match (seen, jog) {
                (150, _) => vec!["M25".to_owned()],
                (170, Some(jog)) => vec!["G90".to_owned(), jog.to_owned(), "M400".to_owned()],
                (200, _) => {
                    image = card.with_slot(|slot| slot.with_image(|image| image.clone()));
                    cut = events.borrow().len();
                    vec!["M24".to_owned()]
                }
                _ => Vec::new(),
            }
        });
        assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
        let end = setup.motor_steps();
        let all = events.take();
        // After the reset.
        let (again, events) = logged(profile("cartesian"), image);
        let mut printer = again.printer();
        let said = again.converse(&mut printer, &["M21", "M1000"], &mut nothing);
        assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
        assert_eq!(again.motor_steps()[..3], end[..3], "{jog:?}");
        // The steps from the cut on bring Z to its end of the undisturbed print, because the height
        // was the true one, and push the same filament, but for the rest of a step at the cut.
        let net_of = |motor| (net(&events.borrow(), motor), net(&all[cut..], motor));
        let ((z, z_owed), (pushed, owed)) = (net_of(2), net_of(3));
        assert_eq!(z, z_owed, "{jog:?}");
        assert!((pushed - owed).abs() <= 1, "{jog:?}: {pushed} instead of {owed}");
        let line = number_after(&said, "after line ").unwrap();
        let next = all[cut..].iter().find_map(|event| match event {
            Event::MoveEnded(line) => Some(*line),
            Event::Step(..) => None,
        });
        assert!(next.is_some_and(|next| next > line), "{jog:?}: {next:?} after {line}");
    }
}

/// M112 and M999: the print can continue as after a power cut.
#[test]
fn a_print_that_a_halt_has_ended_goes_on() {
    let text = program(14);
    let filled = filled(&text);
    let undisturbed = Setup::new(profile("cartesian"), filled.clone());
    undisturbed.say(&["M21", "M32 !PRINT.GCO#"], &mut nothing);
    let setup = Setup::new(profile("cartesian"), filled);
    let mut printer = setup.printer();
    let mut seen = 0;
    setup.converse(&mut printer, &["M21", "M32 !PRINT.GCO#"], &mut |_, _| {
        seen += 1;
        if seen == 180 { vec!["M112".to_owned()] } else { Vec::new() }
    });
    let said = setup.converse(&mut printer, &["M999", "M1000"], &mut nothing);
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    assert_eq!(setup.motor_steps()[..3], undisturbed.motor_steps()[..3]);
}
