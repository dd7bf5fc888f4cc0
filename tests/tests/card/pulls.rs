//! Cards that are pulled out at random instants of a print, and put in again.

use ferrostep_hal_shim::card::CardSlot;
use ferrostep_random_cases::{Share, share_of};
use ferrostep_virtual_board::{CardFault, VirtualCard};

use crate::card::prints::printed;
use crate::card::setup::{Setup, image, nothing, profile};

/// A program of many short moves, in which every line matters. Without homing a pause leaves the
/// nozzle in place, and makes no steps.
fn program(is_homed: bool) -> Vec<u8> {
    let mut text = String::from(if is_homed { "G28\nG1 Z5 F600\nG90\n" } else { "G90\n" });
    for step in 0..120_u32 {
        let (x, y) = (10 + step * 37 % 150, 10 + step * 53 % 140);
        text += &format!("G1 X{x} Y{y}.{} F{}\n", step % 10, 3000 + step * 20);
        if step % 17 == 0 {
            text += "G91 ; relative for a while\nG1 X0.5 Y-0.5\nG90\n";
        }
    }
    text.into_bytes()
}

/// Number of prints in which a card is pulled out a thousand times; a run makes its share.
const PRINTS: u64 = 300;

/// SplitMix64.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mixed = (*state ^ *state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    mixed ^ mixed >> 31
}

#[test]
fn a_thousand_pulls_at_random_instants_change_no_step() {
    pull_a_thousand_times(false);
}

/// The nozzle goes aside and comes back at each pull: only these moves are new.
#[test]
fn a_thousand_pulls_end_where_the_print_ends() {
    pull_a_thousand_times(true);
}

fn pull_a_thousand_times(is_homed: bool) {
    let text = program(is_homed);
    let expected = printed(profile("cartesian"), &text);
    let undisturbed = Setup::new(profile("cartesian"), image());
    undisturbed.put("PRINT.GCO", &text);
    undisturbed.say(&["M21", "M32 !PRINT.GCO#"], &mut nothing);
    assert_eq!(undisturbed.digests().order, expected.order);
    let (mut prints, mut pulls) = (0, 0);
    let filled = {
        let setup = Setup::new(profile("cartesian"), image());
        setup.put("PRINT.GCO", &text);
        setup.card.with_slot(|slot| slot.with_image(|image| image.clone()))
    };
    for print in share_of(PRINTS) {
        let mut state = print << 32;
        prints += 1;
        let setup = Setup::new(profile("cartesian"), filled.clone());
        let mut was_out = 0;
        let said = setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |card, _| {
            let is_in = card.with_slot(CardSlot::is_inserted);
            if is_in && was_out == 0 {
                // Pulls the card now, or before one of the next accesses.
                match random(&mut state) % 40 {
                    0 => {
                        card.with_slot(VirtualCard::pull);
                        pulls += 1;
                    }
                    1 => {
                        let after = random(&mut state) as u32 % 6;
                        card.with_slot(|slot| slot.set_fault(Some(CardFault::PulledAfter(after))));
                    }
                    _ => {}
                }
                return Vec::new();
            }
            was_out += 1;
            match was_out {
                // A person looks for it: M24 without a card changes nothing.
                5 => vec!["M24".to_owned(), "M27".to_owned()],
                9 => {
                    card.with_slot(|slot| slot.set_fault(None));
                    card.with_slot(VirtualCard::insert);
                    if random(&mut state).is_multiple_of(2) {
                        vec!["M21".to_owned(), "M24".to_owned()]
                    } else {
                        vec!["M24".to_owned()]
                    }
                }
                // The card's first block shows if it was put in again before the
                // print has missed it.
                30 => {
                    was_out = 0;
                    vec!["M24".to_owned()]
                }
                _ => Vec::new(),
            }
        });
        assert_eq!(said.last().unwrap(), "Done printing file", "print {print}: {said:?}");
        assert_eq!(setup.motor_steps(), undisturbed.motor_steps(), "print {print}: {said:?}");
        let times = |text: &str| said.iter().filter(|line| *line == text).count();
        assert_eq!(times("//action:paused"), times("//action:resumed"), "print {print}: {said:?}");
        let is_undisturbed = !is_homed || times("//action:paused") == 0;
        assert_eq!(setup.digests().order == expected.order, is_undisturbed, "print {print}: {said:?}");
    }
    assert!(pulls > prints, "{pulls} pulls in {prints} prints");
    assert!(pulls >= 1000 || !Share::of_this_run().is_all(), "{pulls}");
}

#[test]
fn a_pulled_card_pauses_the_print_and_says_so() {
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("PRINT.GCO", &program(false));
    let mut looks = 0;
    let said = setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |card, progress| {
        looks += 1;
        match looks {
            20 => card.with_slot(VirtualCard::pull),
            200 => return vec!["M24".to_owned()],
            210 => return vec!["M21".to_owned()],
            220 => {
                assert!(progress.is_some(), "a paused print is still one");
                card.with_slot(VirtualCard::insert);
                return vec!["M24".to_owned()];
            }
            _ => {}
        }
        Vec::new()
    });
    let said: Vec<&str> = said
        .iter()
        .map(String::as_str)
        .filter(|line| line.contains("card") || line.contains("SD") || line.starts_with("//"))
        .collect();
    assert_eq!(
        said,
        [
            "echo:SD card ok",
            "echo:card: no card is in the slot; the print is paused, put the card back and send M24",
            "//action:paused",
            "//action:prompt_end",
            "//action:prompt_begin The print is paused",
            "//action:prompt_button Continue",
            "//action:prompt_show",
            "echo:card: no card is in the slot; the print waits for M24",
            "echo:No SD card",
            "//action:prompt_end",
            "//action:resumed",
        ]
    );
    assert_eq!(setup.digests().order, printed(profile("cartesian"), &program(false)).order);
}

#[test]
fn another_card_does_not_go_on_with_the_print() {
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("PRINT.GCO", &program(true));
    let mut looks = 0;
    let said = setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |card, _| {
        looks += 1;
        match looks {
            20 => card.with_slot(VirtualCard::pull),
            200 => {
                card.with_slot(|slot| slot.insert_other(image()));
                return vec!["M24".to_owned()];
            }
            230 => return vec!["M524".to_owned()],
            _ => {}
        }
        Vec::new()
    });
    assert!(said.contains(&"echo:card: file not found; the print waits for M24".to_owned()), "{said:?}");
    assert!(said.contains(&"//action:cancel".to_owned()), "{said:?}");
    // The printer can print again.
    let said = setup.say(&["M21", "M32 !PARTS/ONE.GCO#"], &mut nothing);
    assert!(said.contains(&"File selected".to_owned()), "{said:?}");
}
