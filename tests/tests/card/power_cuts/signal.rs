//! A signal says that the supply fails, and a module feeds the board for a while: the print's place
//! at this moment is kept.

use std::cell::RefCell;
use std::rc::Rc;

use ferrostep_printer::{Profile, SupplySignal};
use ferrostep_random_cases::{Share, share_of};

use super::{JOINED_STEPS, end_of_line, filled, net, number_after, program, steps};
use crate::card::setup::{Event, Setup, StepLog, nothing};

/// Maximum number of lines that the printer holds when motion is stopped: about a second, with
/// the line under way.
const MOST_LINES: u32 = 12;

fn profile(rise_mm: i64) -> Profile {
    let supply_signal = Some(SupplySignal { failing_is_low: true, debounce_ms: 6, rise_10nm: rise_mm * 100_000 });
    Profile { supply_signal, ..crate::card::setup::profile("cartesian") }
}

fn logged(image: Vec<u8>, rise_mm: i64) -> (Setup, Rc<RefCell<Vec<Event>>>) {
    let events = Rc::new(RefCell::new(Vec::new()));
    (Setup::logged(profile(rise_mm), image, StepLog(Some(Rc::clone(&events)))), events)
}

/// State after the supply's failure at a look at the hosts.
struct Failure {
    said: Vec<String>,
    card: Vec<u8>,
    /// Events of the motors.
    events: Vec<Event>,
    steps: [i64; 4],
}

fn fail_at(filled: &[u8], look: u32, rise_mm: i64) -> Failure {
    let (setup, events) = logged(filled.to_vec(), rise_mm);
    let mut seen = 0;
    let said = setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |_, _| {
        seen += 1;
        if seen == look {
            setup.fail_supply();
        }
        Vec::new()
    });
    let card = setup.card.with_slot(|slot| slot.with_image(|image| image.clone()));
    Failure { said, card, events: events.take(), steps: setup.motor_steps() }
}

/// M207 of the program.
const RETRACTION_MM: f64 = 0.8;

/// Steps by which M900 K0.03 runs ahead of the note of a move's end, at 1 mm of filament a
/// second, and one more.
const AHEAD_STEPS: i64 = 4;

const KEPT: &str = "echo:power loss: the supply fails: the place of the print is kept";

#[test]
fn a_print_goes_on_from_where_the_supply_has_failed() {
    let text = program(14);
    let filled = filled(&text);
    let (setup, events) = logged(filled.clone(), 0);
    let mut looks = 0;
    let said = setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |_, _| {
        looks += 1;
        Vec::new()
    });
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    let (all, end) = (events.take(), setup.motor_steps());
    let steps_per_mm = profile(0).steps_per_mm[3].to_f64();
    let (mut resumed, mut before, mut most) = (0, 0, 0);
    let rise_mm = 3;
    let rise_steps = (rise_mm as f64 * profile(0).steps_per_mm[2].to_f64()).round() as usize;
    // Sixty instants: a run tries its share of them, and always the first, the last, and
    // two in the middle.
    let instants: Vec<u32> = (10..looks).step_by(looks as usize / 60).collect();
    let (middle, last) = (instants.len() / 2, instants.len() - 1);
    let always = [0, middle, middle + 1, last];
    for index in always.into_iter().chain(share_of(instants.len() as u64).map(|index| index as usize)) {
        let look = instants[index];
        // The nozzle rises every other time; the undisturbed print never goes up by
        // so much at once.
        let rises = look.is_multiple_of(2);
        let failure = fail_at(&filled, look, if rises { rise_mm } else { 0 });
        let Failure { said, card, .. } = &failure;
        // The printer says so, and is halted.
        let Some(told) = said.iter().position(|line| line.starts_with("echo:power loss: the supply fails")) else {
            assert_eq!(said.last().unwrap(), "Done printing file", "the print was over: {said:?}");
            continue;
        };
        assert!(said[told + 1].contains("kill() called"), "{said:?}");
        // The steps up to the failure are the beginning of the undisturbed print.
        let mut done = steps(&failure.events, 0b111);
        if rises && said[told] == KEPT {
            let risen = done.split_off(done.len() - rise_steps);
            assert!(risen.iter().all(|step| *step == (0b100, 0)), "look {look}");
        }
        assert_eq!(done, steps(&all, 0b111)[..done.len()], "look {look}");
        let (setup, events) = logged(card.clone(), 0);
        let mut printer = setup.printer();
        let said = setup.converse(&mut printer, &["M21"], &mut nothing);
        let Some(line) = number_after(&said, "after line ") else {
            before += 1;
            assert_ne!(failure.said[told], KEPT, "look {look}: {said:?}");
            continue;
        };
        assert_eq!(failure.said[told], KEPT, "look {look}");
        // The nozzle's height is the true one.
        let z_steps = failure.steps[2];
        assert_eq!(setup.motor_steps()[2], z_steps, "look {look}");
        // Every line that was not printed to its end is repeated, and few lines are printed twice.
        let first_missing = end_of_line(&all, line);
        let is_move = |event: &&Event| matches!(event, Event::MoveEnded(_));
        let moves_done = failure.events.iter().filter(is_move).count();
        let moves_kept = all[..first_missing].iter().filter(is_move).count();
        assert!(moves_kept <= moves_done, "look {look}: {moves_kept} moves kept, {moves_done} made");
        most = most.max(moves_done - moves_kept);
        let said = setup.converse(&mut printer, &["M1000"], &mut nothing);
        assert_eq!(said.last().unwrap(), "Done printing file", "look {look}, line {line}: {said:?}");
        let events = events.take();
        let missing = &all[first_missing..];
        let (made, wanted) = (steps(&events, 0b111), steps(missing, 0b111));
        let same = made.iter().rev().zip(wanted.iter().rev()).take_while(|(made, wanted)| made == wanted).count();
        assert!(wanted.len() - same <= 2 * JOINED_STEPS, "look {look}, line {line}: {same} of {} steps", wanted.len());
        assert_eq!(setup.motor_steps()[..3], end[..3], "look {look}, line {line}");
        // The end of G11 is not noted: its filament is among that of the missing lines.
        let is_pushed = text.split(|byte| *byte == b'\n').nth(line as usize - 1) == Some(b"G11");
        let drawn_back = if is_pushed { (RETRACTION_MM * steps_per_mm).round() as i64 } else { 0 };
        let (pushed, owed) = (net(&events, 3), net(missing, 3) - drawn_back);
        assert!((pushed - owed).abs() <= AHEAD_STEPS, "look {look}, line {line}: {pushed} instead of {owed}");
        resumed += 1;
    }
    println!("{resumed} failures resumed, {before} before the first place, at most {most} moves made twice");
    assert!(resumed > 0 && most as u32 <= MOST_LINES, "{resumed} {most}");
    assert!(resumed > 40 || !Share::of_this_run().is_all(), "{resumed}");
}

/// Fails at a wait for heat and while paused, is right again, and the print continues
/// without a reset.
#[test]
fn after_a_dip_the_print_goes_on_with_m999() {
    let filled = filled(&program(14));
    let undisturbed = Setup::new(profile(0), filled.clone());
    undisturbed.say(&["M21", "M32 !PRINT.GCO#"], &mut nothing);
    for (pauses, look) in [(false, 180), (true, 190)] {
        let (setup, _) = logged(filled.clone(), 2);
        let mut printer = setup.printer();
        let mut seen = 0;
        let said = setup.converse(&mut printer, &["M21", "M32 !PRINT.GCO#"], &mut |_, _| {
            seen += 1;
            match seen {
                150 if pauses => return vec!["M25".to_owned()],
                _ if seen == look => setup.fail_supply(),
                // No time passes without a command, and with one at each look no look at the
                // hosts would end.
                _ if seen > look && pauses && seen % 2 == 0 => return vec!["G4 P5".to_owned()],
                _ => {}
            }
            Vec::new()
        });
        assert!(said.contains(&KEPT.to_owned()), "{said:?}");
        // The heaters are off.
        let said = setup.converse(&mut printer, &["M105", "G28"], &mut nothing);
        assert!(said[0].contains(" /0.00 B") && said[0].contains("@:0 B@:0"), "{said:?}");
        assert!(said[1].contains("halted"), "{said:?}");
        let said = setup.converse(&mut printer, &["M999", "M413"], &mut nothing);
        assert!(said.contains(&"echo:Power-loss recovery ON; the supply fails by its signal".to_owned()), "{said:?}");
        setup.mend_supply();
        let said = setup.converse(&mut printer, &["G4 P50", "G4 P50", "M413", "M1000"], &mut nothing);
        assert!(
            said.contains(&"echo:Power-loss recovery ON; the supply is right by its signal".to_owned()),
            "{said:?}"
        );
        assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
        assert_eq!(setup.motor_steps()[..3], undisturbed.motor_steps()[..3], "pauses: {pauses}");
    }
}

#[test]
fn without_a_print_from_the_card_the_machine_halts() {
    let (setup, _) = logged(filled(&program(1)), 0);
    let mut printer = setup.printer();
    setup.fail_supply();
    // A signal that is there from the start may be a missing wire.
    let said = setup.converse(&mut printer, &["M21", "G28", "G4 P50", "M413"], &mut nothing);
    assert!(said.contains(&"echo:Power-loss recovery ON; the supply fails by its signal".to_owned()), "{said:?}");
    assert_eq!(said.last().unwrap(), "ok", "{said:?}");
    let said = setup.converse(&mut printer, &["M32 !PRINT.GCO#"], &mut nothing);
    let unwatched =
        "echo:power loss: by its signal the supply fails already, so it is not watched: see power_loss in the profile";
    assert!(said.contains(&unwatched.to_owned()), "{said:?}");
    assert_eq!(said.last().unwrap(), "Done printing file");
    setup.mend_supply();
    setup.converse(&mut printer, &["G4 P50", "G4 P50"], &mut nothing);
    setup.fail_supply();
    let said = setup.converse(&mut printer, &["G4 P50", "G4 P50", "G0 X20"], &mut nothing);
    let told = said.iter().position(|line| line == "echo:power loss: the supply fails").unwrap();
    assert!(said[told + 1].contains("kill() called"), "{said:?}");
    assert!(said[told + 2..].iter().any(|line| line.contains("halted")), "{said:?}");
}
