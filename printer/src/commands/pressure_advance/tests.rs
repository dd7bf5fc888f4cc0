//! Tests of M900, M572 and SET_PRESSURE_ADVANCE on a machine.
#![allow(clippy::unwrap_used)]

use std::string::ToString;

use ferrostep_planner::{PressureAdvance, SecondSlope};

use crate::motion::homing::tests::rig::{Rig, execute};

/// The advance after these lines.
fn after(lines: &[&str]) -> PressureAdvance {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    for line in lines {
        execute(&mut printer, line).unwrap();
    }
    rig.choice().pressure_advance
}

#[test]
fn each_firmwares_words_set_what_they_name() {
    let plain = |seconds: f64| PressureAdvance { seconds, ..PressureAdvance::NONE };
    let above = Some(SecondSlope { filament_mm_per_s: 4.0, seconds: 0.03 });
    for (lines, expected) in [
        (&["M900 K0.05"][..], plain(0.05)),
        (&["M900 K0.05", "M900 K=0"], plain(0.0)),
        (&["M572 D0 S0.05"], plain(0.05)),
        (&["M572 S0.05 W0.02"], PressureAdvance { smooth_time_s: Some(0.02), ..plain(0.05) }),
        // The averaging time stays, whatever K is.
        (&["M572 S0.05 W0.02", "M900 K0.1"], PressureAdvance { smooth_time_s: Some(0.02), ..plain(0.1) }),
        (&["SET_PRESSURE_ADVANCE SMOOTH_TIME=0.03"], PressureAdvance { smooth_time_s: Some(0.03), ..plain(0.0) }),
        (&["M572 S0.05 L0.03 T4"], PressureAdvance { above, ..plain(0.05) }),
        // One K applies to every flow.
        (&["M572 S0.05 L0.03 T4", "SET_PRESSURE_ADVANCE ADVANCE=0.04"], plain(0.04)),
    ] {
        assert_eq!(after(lines), expected, "{lines:?}");
    }
}

#[test]
fn an_answer_sets_what_it_says() {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    execute(&mut printer, "M572 S0.05 L0.0301 T4.25 W0.025").unwrap();
    let advance = rig.choice().pressure_advance;
    rig.last_texts();
    execute(&mut printer, "M900").unwrap();
    let said = rig.last_texts().pop().unwrap();
    execute(&mut printer, "M900 K0.1").unwrap();
    execute(&mut printer, said.strip_prefix("echo:").unwrap()).unwrap();
    assert_eq!(rig.choice().pressure_advance, advance);
    rig.last_texts();
    for query in ["M572", "SET_PRESSURE_ADVANCE", "M572 D0"] {
        execute(&mut printer, query).unwrap();
        assert_eq!(rig.last_texts(), std::slice::from_ref(&said), "{query}");
    }
}

#[test]
fn what_is_out_of_range_is_refused_with_its_numbers_and_the_advance_stays() {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    execute(&mut printer, "M572 S0.05 W0.02").unwrap();
    let good = rig.choice();
    for (line, says) in [
        ("M572 S2.1", "pressure advance: 2.1 s is out of range, expected 0 to 2 s (M572 S or L, ADVANCE)"),
        (
            "SET_PRESSURE_ADVANCE ADVANCE=-0.1",
            "pressure advance: -0.1 s is out of range, expected 0 to 2 s (M572 S or L, ADVANCE)",
        ),
        ("M572 S0.1 L3 T4", "pressure advance: 3 s is out of range, expected 0 to 2 s (M572 S or L, ADVANCE)"),
        ("M572 S0.1 L0.05 T0", "pressure advance: 0 mm/s is out of range, expected 0.01 to 100 mm/s (M572 T)"),
        ("M572 S0.1 W0.2", "pressure advance: 0.2 s is out of range, expected 0.001 to 0.1 s (M572 W, SMOOTH_TIME)"),
        (
            "SET_PRESSURE_ADVANCE SMOOTH_TIME=0",
            "pressure advance: 0 s is out of range, expected 0.001 to 0.1 s (M572 W, SMOOTH_TIME)",
        ),
    ] {
        assert_eq!(execute(&mut printer, line).unwrap_err().to_string(), says, "{line}");
        assert_eq!(rig.choice(), good, "{line}");
    }
    // Such numbers have no effect in M900: they are those of Linear Advance 1.0, which has another
    // unit.
    for line in ["M900 K30", "M900 K2.1", "M900 K-0.1", "M900 K45 T0"] {
        execute(&mut printer, line).unwrap();
        assert_eq!(rig.choice(), good, "{line}");
    }
    execute(&mut printer, "M900 K2").unwrap();
    assert_eq!(rig.choice().pressure_advance.seconds, 2.0);
}

#[test]
fn what_the_extruder_cannot_follow_is_said() {
    let rig = Rig::new(|profile| {
        profile.limits.max_acceleration_mm_per_s2[3] = 500.0;
        profile.limits.print_acceleration_mm_per_s2 = 3000.0;
    });
    let mut printer = rig.printer();
    execute(&mut printer, "M900 K0.5").unwrap();
    let said = rig.last_texts().pop().unwrap();
    assert!(said.starts_with("echo:pressure advance: lines of 0.45 x 0.2 mm accelerate by at most "), "{said}");
    rig.last_texts();
    execute(&mut printer, "M900 K0.001").unwrap();
    assert!(rig.last_texts().is_empty());
}
