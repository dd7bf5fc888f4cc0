//! Tests of M593 and SET_INPUT_SHAPER on a machine.
#![allow(clippy::unwrap_used)]

use std::format;
use std::string::{String, ToString};

use ferrostep_planner::{AxisShaper, ChoiceError, EvenSpacing, ShaperError, ShaperKind};

use crate::error::CommandError;
use crate::motion::homing::tests::rig::{Rig, RigPrinter, execute};

fn shaper(kind: ShaperKind, frequency_hz: f64, damping: f64) -> AxisShaper {
    AxisShaper { kind, frequency_hz, damping }
}

/// Returns the machine's answer to a query.
fn state(rig: &Rig, printer: &mut RigPrinter<'_>) -> String {
    rig.last_texts();
    execute(printer, "M593").unwrap();
    let texts = rig.last_texts();
    assert_eq!(texts.len(), 1, "{texts:?}");
    texts[0].clone()
}

/// Filters of X and Y after these lines.
fn after(lines: &[&str]) -> [AxisShaper; 2] {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    for line in lines {
        execute(&mut printer, line).unwrap();
    }
    rig.choice().shapers
}

#[test]
fn each_firmwares_words_set_the_axes_that_they_name() {
    use ShaperKind::*;
    let none = AxisShaper::NONE;
    let even = EvenMzv(EvenSpacing { impulses: 5, period_thousandths: 900 });
    for (lines, x, y) in [
        (&["M593 F42 D0.15"][..], shaper(Zv, 42.0, 0.15), shaper(Zv, 42.0, 0.15)),
        (&["M593 X F42"], shaper(Zv, 42.0, 0.1), none),
        (&["M593 Y F42", "M593 X F50 D0"], shaper(Zv, 50.0, 0.0), shaper(Zv, 42.0, 0.1)),
        (&["M593 P\"mzv\" F42 S0.05"], shaper(Mzv, 42.0, 0.05), shaper(Mzv, 42.0, 0.05)),
        // A frequency alone keeps the kind.
        (&["M593 P\"ei2\" F42", "M593 X F50"], shaper(TwoHumpEi, 50.0, 0.1), shaper(TwoHumpEi, 42.0, 0.1)),
        (&["M593 P\"EI3\" F42", "M593 Y P\"none\""], shaper(ThreeHumpEi, 42.0, 0.1), shaper(None, 42.0, 0.1)),
        // Off, and on again with its earlier numbers.
        (&["M593 F50 D0.2", "M593 X F0"], shaper(None, 50.0, 0.2), shaper(Zv, 50.0, 0.2)),
        (&["M593 F50 D0.2", "M593 F0", "M593 Y P\"zvd\""], shaper(None, 50.0, 0.2), shaper(Zvd, 50.0, 0.2)),
        (&["M593 D0.2", "SET_INPUT_SHAPER SHAPER_FREQ_X=60"], shaper(Mzv, 60.0, 0.2), shaper(None, 40.0, 0.2)),
        (
            &["SET_INPUT_SHAPER SHAPER_TYPE=ei SHAPER_FREQ_X=60 SHAPER_FREQ_Y=30 DAMPING_RATIO_Y=0.4"],
            shaper(Ei, 60.0, 0.1),
            shaper(Ei, 30.0, 0.4),
        ),
        (
            &["SET_INPUT_SHAPER SHAPER_TYPE=mzv(n=5,t=0.9) SHAPER_FREQ_X=60"],
            shaper(even, 60.0, 0.1),
            shaper(even, 40.0, 0.1),
        ),
        (&["M593 P\"mzv(5,0.9)\" F42"], shaper(even, 42.0, 0.1), shaper(even, 42.0, 0.1)),
        (&["SET_INPUT_SHAPER SHAPER_TYPE_X=Ei_Old SHAPER_TYPE_Y=zvdd SHAPER_FREQ_Y=0"], shaper(EiOld, 40.0, 0.1), none),
    ] {
        assert_eq!(after(lines), [x, y], "{lines:?}");
    }
    for kind in ShaperKind::EXAMPLES {
        let shapers = after(&[&format!("M593 P\"{kind}\" F60")]);
        assert_eq!(shapers, [shaper(kind, 60.0, 0.1); 2]);
    }
}

#[test]
fn an_answer_sets_what_it_says() {
    let rig = Rig::new(|profile| profile.motion.shapers[1] = shaper(ShaperKind::EiOld, 38.625, 0.06));
    let mut printer = rig.printer();
    let said = "echo:SET_INPUT_SHAPER SHAPER_TYPE_X=none SHAPER_FREQ_X=40 DAMPING_RATIO_X=0.1 SHAPER_TYPE_Y=ei_old \
                SHAPER_FREQ_Y=38.625 DAMPING_RATIO_Y=0.06";
    assert_eq!(state(&rig, &mut printer), said);
    execute(&mut printer, "M593 Y P\"mzv(5,1.25)\"").unwrap();
    execute(&mut printer, "M593 X P\"3hump_ei\" F123.456789012 S0.123456789").unwrap();
    let shapers = rig.choice().shapers;
    let said = state(&rig, &mut printer);
    for line in ["M593 F0", "M593 P\"zv\" F77 S0"] {
        execute(&mut printer, line).unwrap();
    }
    execute(&mut printer, said.strip_prefix("echo:").unwrap()).unwrap();
    assert_eq!(rig.choice().shapers, shapers);
    execute(&mut printer, "SET_INPUT_SHAPER").unwrap();
    assert_eq!(rig.last_texts(), [said]);
}

#[test]
fn the_machine_stands_still_before_its_filters_change() {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    for line in ["G28", "G1 X50 F6000"] {
        execute(&mut printer, line).unwrap();
    }
    assert!(rig.is_moving());
    // A query and a refused line do not wait.
    state(&rig, &mut printer);
    assert!(execute(&mut printer, "M593 F700").is_err());
    assert!(rig.is_moving());
    execute(&mut printer, "M593 F50").unwrap();
    assert!(!rig.is_moving());
    assert_eq!(rig.choice().shapers, [shaper(ShaperKind::Zv, 50.0, 0.1); 2]);
    // M593 keeps the profile that M796 has chosen, and M796 keeps the filters.
    execute(&mut printer, "M796 A1").unwrap();
    execute(&mut printer, "M593 F51").unwrap();
    assert_eq!(rig.choice().acceleration, ferrostep_planner::AccelerationProfile::SCurve);
    execute(&mut printer, "M796 A0").unwrap();
    assert_eq!(rig.choice().shapers, [shaper(ShaperKind::Zv, 51.0, 0.1); 2]);
}

#[test]
fn what_cannot_be_made_is_refused_with_its_numbers_and_the_filters_stay() {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    execute(&mut printer, "SET_INPUT_SHAPER SHAPER_TYPE_X=mzv SHAPER_FREQ_X=52 SHAPER_TYPE_Y=zvd SHAPER_FREQ_Y=38")
        .unwrap();
    let good = rig.choice();
    let names = "expected none, zv, mzv, zvd, zvdd, ei, ei_old, 2hump_ei, 3hump_ei, mzv(N,T) with N impulses over T periods, ei2 \
                 (2hump_ei) or ei3 (3hump_ei) in M593 P or SHAPER_TYPE";
    let frequency = |value: &str, axis: char| {
        format!(
            "input shaper of {axis}: {value} Hz is out of range, expected 5 to 500 Hz, or 0 for none (M593 F, SHAPER_FREQ_{axis})"
        )
    };
    let damping = |value: &str, most: &str, kind: &str, axis: char| {
        format!(
            "input shaper of {axis}: a damping ratio of {value} is out of range, expected 0 to {most} for {kind} (M593 D or S, \
             DAMPING_RATIO_{axis})"
        )
    };
    for (line, says) in [
        ("M593 F500.001", frequency("500.001", 'X')),
        ("M593 Y F4.99", frequency("4.99", 'Y')),
        ("M593 F-1", frequency("-1", 'X')),
        ("M593 P\"none\" F501", frequency("501", 'X')),
        // X could be set but Y could not, so neither is.
        ("SET_INPUT_SHAPER SHAPER_FREQ_X=60 SHAPER_FREQ_Y=1", frequency("1", 'Y')),
        ("M593 D1", damping("1", "0.99", "mzv", 'X')),
        ("M593 Y D-0.1", damping("-0.1", "0.99", "zvd", 'Y')),
        ("M593 P\"ei\" S0.41", damping("0.41", "0.4", "ei", 'X')),
        ("M593 Y P\"ei2\" S0.31", damping("0.31", "0.3", "2hump_ei", 'Y')),
        ("M593 P\"ei3\" S0.21", damping("0.21", "0.2", "3hump_ei", 'X')),
        (
            "M593 Y P\"ei3\" F15",
            "input shaper of Y: 3hump_ei for 15 Hz and a damping ratio of 0.1 is longer than 100 ms, expected at least 19.83 Hz \
             (M593 F, SHAPER_FREQ_Y) or a shorter kind"
                .to_string(),
        ),
        ("M593 P\"zvddd\" F40", format!("\"zvddd\" is not an input shaper, {names}")),
        ("M593 P\"custom\"", format!("\"custom\" is not an input shaper, {names}")),
        ("SET_INPUT_SHAPER SHAPER_TYPE=mzv(5;0.9)", format!("\"mzv(5;0.9)\" is not an input shaper, {names}")),
        (
            "SET_INPUT_SHAPER SHAPER_TYPE=mzv(n=9,t=0.9)",
            "input shaper of X: mzv(9,0.900): expected mzv(N,T) with N from 3 to 5, and T below (N-1)/2 but not so small \
             that an impulse would be negative"
                .to_string(),
        ),
        ("SET_INPUT_SHAPER SHAPER_TYPE_Y=", format!("\"\" is not an input shaper, {names}")),
    ] {
        let error = execute(&mut printer, line).unwrap_err();
        assert_eq!(error.to_string(), says, "{line}");
        assert_eq!(rig.choice(), good, "{line}");
    }
    // The lowest frequency that the message names is accepted.
    execute(&mut printer, "M593 Y P\"ei3\" F19.83").unwrap();
}

#[test]
fn a_moving_average_takes_its_part_of_the_longest_filter_and_keeps_the_trapezoid() {
    let rig = Rig::new(|profile| profile.motion.smooth_time_s = Some(0.05));
    let mut printer = rig.printer();
    let good = rig.choice();
    let error = execute(&mut printer, "M593 P\"mzv\" F15").unwrap_err();
    assert_eq!(
        error.to_string(),
        "input shaper of X: mzv for 15 Hz and a damping ratio of 0.1 is longer than 100 ms with the profile's \
         input_shaper.smooth_time_s, expected at least 15.08 Hz (M593 F, SHAPER_FREQ_X) or a shorter kind"
    );
    assert_eq!(rig.choice(), good);
    execute(&mut printer, "M593 P\"mzv\" F15.08").unwrap();
    assert_eq!(rig.choice().smooth_time_s, Some(0.05));
    let s_curve = CommandError::MotionChoice(ChoiceError::Shaper(ShaperError::SmoothSCurve));
    let says = "M796: input_shaper.smooth_time_s of the profile needs trapezoids: send M796 A0";
    assert_eq!(s_curve.to_string(), says);
}
