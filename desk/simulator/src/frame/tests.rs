#![allow(clippy::unwrap_used)]

use super::*;
use crate::shapers::{Shaper, ShaperKind};
use proptest::prelude::*;

#[test]
fn a_step_gives_the_response_of_the_textbook() {
    // x(t) = 1 - exp(-z w t) (cos wd t + z w / wd sin wd t)
    let (hz, damping) = (50.0, 0.06);
    let mut mode = Mode::new(hz, damping).unwrap();
    let (omega, mut time_s) = (TAU * hz, 0.0);
    let damped = omega * (1.0f64 - damping * damping).sqrt();
    // The parts are uneven, because the solution must not depend on them.
    for part_s in [0.0001, 0.003, 0.000_000_012, 0.02, 0.0007] {
        mode.advance(part_s, Motion::standing(1.0));
        time_s += part_s;
        let left = (-damping * omega * time_s).exp();
        let expected = 1.0 - left * ((damped * time_s).cos() + damping * omega / damped * (damped * time_s).sin());
        assert!((mode.position_mm() - expected).abs() < 1e-12);
    }
    // The amplitude after a step of 1 is 1 / sqrt(1 - z^2), decaying.
    let expected = (-damping * omega * time_s).exp() / (1.0f64 - damping * damping).sqrt();
    assert!((mode.ringing_mm(Motion::standing(1.0)) - expected).abs() < 1e-12);
}

#[test]
fn under_steady_acceleration_the_mode_lags_by_the_acceleration_over_omega_squared() {
    let mut mode = Mode::new(40.0, 0.2).unwrap();
    let start = Motion { position_mm: 3.0, speed_mm_per_s: -7.0, acceleration_mm_per_s2: 1000.0 };
    mode.advance(2.0, start);
    let (omega, end) = (TAU * 40.0, start.after(2.0));
    let lag_s = 2.0 * 0.2 / omega;
    let expected = end.position_mm - lag_s * end.speed_mm_per_s + (4.0 * 0.04 - 1.0) / (omega * omega) * 1000.0;
    assert!((mode.position_mm() - expected).abs() < 1e-6);
    let without_damping = Mode::new(40.0, 0.0).unwrap();
    let steady = without_damping.steady(start);
    assert!((start.position_mm - steady.position_mm - 1000.0 / (omega * omega)).abs() < 1e-12);
}

#[test]
fn zero_vibration_cancels_its_own_mode() {
    let (hz, damping) = (37.0, 0.08);
    let shaper = Shaper::new(ShaperKind::Zv, hz, damping).unwrap();
    let [first, second] = shaper.impulses() else { panic!("two impulses") };
    let mut mode = Mode::new(hz, damping).unwrap();
    mode.advance(second.delay_s - first.delay_s, Motion::standing(first.weight * 5.0));
    assert!(mode.ringing_mm(Motion::standing(5.0)) < 1e-12);
    mode.advance(0.3, Motion::standing(5.0));
    assert!((mode.position_mm() - 5.0).abs() < 1e-12);
}

#[test]
fn two_modes_share_the_place() {
    let second = SecondMode { amplitude: 0.25, ..SecondMode::default() };
    let settings = FrameSettings { second: Some(second), ..FrameSettings::default() };
    let mut frame = Frame::new(&settings).unwrap();
    frame.advance(0.004, [Motion::standing(1.0), Motion::standing(-2.0)]);
    let mut modes = [Mode::new(50.0, 0.06).unwrap(), Mode::new(85.0, 0.04).unwrap()];
    modes.iter_mut().for_each(|mode| mode.advance(0.004, Motion::standing(1.0)));
    let expected = (modes[0].position_mm() + 0.25 * modes[1].position_mm()) / 1.25;
    assert!((frame.position_mm()[0] - expected).abs() < 1e-12);
    frame.advance(9.0, [Motion::standing(1.0), Motion::standing(-2.0)]);
    assert!((frame.position_mm()[1] + 2.0).abs() < 1e-9);
    assert!(frame.ringing_mm([Motion::standing(1.0), Motion::standing(-2.0)]) < 1e-9);
}

#[test]
fn numbers_out_of_range_are_named() {
    let frame = |change: fn(&mut FrameSettings)| {
        let mut settings = FrameSettings::default();
        change(&mut settings);
        Frame::new(&settings).map(|_| ())
    };
    assert_eq!(frame(|_| {}), Ok(()));
    let error = frame(|settings| settings.frequency_hz[1] = 0.2).unwrap_err();
    assert_eq!(error.to_string(), "a mode of the frame is at 0.2 Hz, expected 1 to 1000 Hz");
    assert!(matches!(frame(|settings| settings.damping = 1.0), Err(FrameError::Damping(_))));
    assert!(matches!(frame(|settings| settings.damping = f64::NAN), Err(FrameError::Damping(_))));
    let second = |ratio, amplitude| SecondMode { frequency_ratio: ratio, damping: 0.04, amplitude };
    let with = |second| Frame::new(&FrameSettings { second: Some(second), ..FrameSettings::default() }).map(|_| ());
    assert_eq!(with(second(100.0, 0.5)), Err(FrameError::Frequency(5000.0)));
    assert_eq!(with(second(1.5, 2.0)), Err(FrameError::Amplitude(2.0)));
}

proptest! {
    #[test]
    fn any_cut_of_the_time_gives_the_same_state(
        hz in 1.0f64..1000.0, damping in 0.0f64..0.95, speed in -500.0f64..500.0, acceleration in -20_000.0f64..20_000.0,
        cuts in prop::collection::vec(1e-7f64..0.02, 1..20),
    ) {
        let command = Motion { position_mm: 1.5, speed_mm_per_s: speed, acceleration_mm_per_s2: acceleration };
        let (mut whole, mut parts) = (Mode::new(hz, damping).unwrap(), Mode::new(hz, damping).unwrap());
        let total: f64 = cuts.iter().sum();
        whole.advance(total, command);
        let mut time_s = 0.0;
        for cut in cuts {
            parts.advance(cut, command.after(time_s));
            time_s += cut;
        }
        prop_assert!((whole.position_mm() - parts.position_mm()).abs() < 1e-9 * (1.0 + whole.position_mm().abs()));
        prop_assert!((whole.speed_mm_per_s() - parts.speed_mm_per_s()).abs() < 1e-7 * (1.0 + whole.speed_mm_per_s().abs()));
    }
}
