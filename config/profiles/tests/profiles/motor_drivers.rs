//! Motor drivers: pulses that the step interrupt keeps, and steps that follow from the screw.

use ferrostep_profiles::{builtin_text, parse};

use crate::refusals::assert_conflict;

/// A pulse that the step interrupt cannot keep is refused, with the time it needs and
/// what to do instead.
#[test]
fn a_pulse_lasts_as_long_as_the_step_interrupt_needs() {
    assert_conflict("cartesian", "pulse_width_us = 1.0", "pulse_width_us = 0.99", "driver.pulse_width_us");
    assert_conflict("cartesian", "event_interval_us = 2.0", "event_interval_us = 1.99", "minimum_event_interval_us");
    let short = builtin_text("prusa-mini").unwrap().replace("both_edges = true", "both_edges = false");
    let error = parse(&short, "test.toml").unwrap_err().to_string();
    for part in ["test.toml:", "driver.pulse_width_us = 0.2", "at least 1 us", "driver.both_edges = true"] {
        assert!(error.contains(part), "{error}");
    }
    // A direction that changes between two edges takes a separate event.
    assert_conflict("corexy", "direction_setup_us = 0.1", "direction_setup_us = 1.01", "driver.direction_setup_us");
}

#[test]
fn steps_follow_from_the_screw_and_its_microsteps() {
    let mini = |from: &str, to: &str| {
        let text = builtin_text("prusa-mini").unwrap();
        assert!(text.contains(from), "{from}");
        parse(&text.replacen(from, to, 1), "test.toml")
    };
    // Half the layer height with full flow: 16 microsteps at 400 steps/mm.
    let error = mini("microsteps = 8\n", "microsteps = 16\n").unwrap_err();
    assert_eq!(error.key(), Some("drivers.z.mm_per_turn"));
    let error = error.to_string();
    for part in ["8.000 mm", "steps_per_mm.z = 800.00 instead of 400", "microsteps = 8 instead of 16", "200 full steps"]
    {
        assert!(error.contains(part), "{part}: {error}");
    }
    // A motor of 0.9 degrees a step.
    assert!(mini("full_steps_per_turn = 200", "full_steps_per_turn = 400").is_err());
    // Pulleys of 16 and of 20 teeth; an extruder that was calibrated.
    assert!(mini("mm_per_turn = 32", "mm_per_turn = 40").is_err());
    assert!(mini("e = 325 }", "e = 312.5 }").is_ok());
    // Without the travel of a turn there is nothing to check, and a key without effect is refused.
    assert!(mini("full_steps_per_turn = 200\nmm_per_turn = 4\n", "").is_ok());
    let error = mini("mm_per_turn = 4\n", "").unwrap_err();
    assert_eq!(error.key(), Some("drivers.z.full_steps_per_turn"));
}
