//! Programs that no slicer writes, in short moves: no step is lost on any machine, and a prepared
//! job is executed as it was planned.

use ferrostep_gpre::Encoding;
use ferrostep_oracle::reference::ReferenceProfile;
use ferrostep_oracle::trace_ends::{Ends, count_ends};
use ferrostep_random_cases::share_of_cases;
use ferrostep_testkit::hostile::Hostile;
use proptest::prelude::*;

use crate::end_to_end::desk::{profile, rehearse_at, rehearse_far};
use crate::end_to_end::prepared::prepared;

/// Prints a program and counts.
fn ends_of(program: &Hostile) -> Ends {
    let profile = ferrostep_profiles::parse(&program.profile, "hostile").unwrap();
    let reference = ReferenceProfile::from_toml(&program.profile).unwrap();
    let ended = rehearse_at(&profile, program.look_ahead, &mut program.text.as_bytes());
    assert!(ended.outcome.is_ok(), "{:?}\n{}", ended.outcome, program.profile);
    count_ends(&ended.trace[..], program.text.as_bytes(), &reference).unwrap()
}

/// A machine of the three that are shipped.
fn ends_on(name: &str, text: &str) -> Ends {
    let machine = profile(name);
    let reference = ReferenceProfile::from_toml(ferrostep_profiles::builtin_text(name).unwrap()).unwrap();
    let ended = rehearse_at(&machine, 128, &mut text.as_bytes());
    assert!(ended.outcome.is_ok(), "{:?}", ended.outcome);
    count_ends(&ended.trace[..], text.as_bytes(), &reference).unwrap()
}

#[test]
fn a_block_starting_with_a_stepless_move_loses_no_step() {
    for text in [
        "G28\nG1 X20 F1200\nG1 X20.004\nG1 X20.21\n",
        "G28\nG1 X10 Y10 F6000\nG1 X10.000 Y10.307 F1200\nG1 X10.000 Y10.346\nG1 X10.000 Y10.352\nG1 X10.000 Y10.558\n",
        "G28\nG1 X20 F1200\nG1 X20.004\nG1 X20.5\n",
    ] {
        for name in ["cartesian", "corexy", "prusa-mini"] {
            assert_eq!(ends_on(name, text).wrong, 0, "{name}: {text}");
        }
    }
}

#[test]
fn the_step_count_detects_a_lost_step() {
    let text = "G28\nG1 X20 F1200\nG1 X20.5\n";
    let ended = rehearse_at(&profile("cartesian"), 128, &mut text.as_bytes());
    let other = "G28\nG1 X20 F1200\nG1 X20.52\n";
    let ends = count_ends(&ended.trace[..], other.as_bytes(), &ReferenceProfile::cartesian()).unwrap();
    assert_eq!((ends.moves, ends.wrong), (2, 1));
}

proptest! {
    #![proptest_config(share_of_cases(256))]

    #[test]
    fn every_motor_ends_every_move_exactly(seed in any::<u64>()) {
        let program = Hostile::new(seed, 400);
        let ends = ends_of(&program);
        prop_assert!(ends.moves >= 300);
        prop_assert_eq!(ends.wrong, 0, "{:?} of seed {}", ends.first, seed);
    }

    #[test]
    fn what_is_prepared_is_executed(seed in any::<u64>()) {
        let program = Hostile::new(seed, 150);
        let machine = ferrostep_profiles::parse(&program.profile, "hostile").unwrap();
        let planned = rehearse_far(&machine, &mut program.text.as_bytes(), false);
        prop_assert!(planned.outcome.is_ok());
        for encoding in [Encoding::Compact, Encoding::Wide] {
            let job = prepared(&machine, program.text.as_bytes(), encoding);
            prop_assert_eq!(job.is_some(), program.is_trapezoid, "seed {}", seed);
            let Some(job) = job else { continue };
            let executed = rehearse_far(&machine, &mut &job[..], true);
            prop_assert!(executed.outcome.is_ok(), "seed {seed}, {encoding:?}: {:?}", executed.outcome);
            prop_assert!(executed.trace == planned.trace, "seed {seed}, {encoding:?}: other records");
        }
    }
}

#[test]
fn nanometre_moves_are_executed_in_both_encodings() {
    let text =
        "M302 P1\nG28\nG1 X50 Y50 Z1 F6000\nG91\nG1 X.00001\nG1 X.00001\nG1 Y.00003 E.00003\nG1 X5 E.1\nG1 X.00005\n";

    for name in ["cartesian", "corexy", "prusa-mini"] {
        let machine = profile(name);
        let planned = rehearse_far(&machine, &mut text.as_bytes(), false);
        for encoding in [Encoding::Compact, Encoding::Wide] {
            let job = prepared(&machine, text.as_bytes(), encoding).unwrap();
            let executed = rehearse_far(&machine, &mut &job[..], true);
            assert!(executed.outcome.is_ok(), "{name}, {encoding:?}: {:?}", executed.outcome);
            assert!(executed.trace == planned.trace, "{name}, {encoding:?}: other records");
        }
    }
}
