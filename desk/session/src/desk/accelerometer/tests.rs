//! Tests of the chip's measurements on a frame.

use ferrostep_planner::Kinematics;

use super::*;

const SECOND: u64 = TICKS_PER_SECOND as u64;

/// Builds the accelerometer of a cartesian machine with 80, 80 and 400 steps/mm, or of one whose A
/// and B are like its X and Y.
fn accelerometer(kinematics: Kinematics) -> DeskAccelerometer {
    let geometry = Geometry { kinematics, ..ferrostep_profiles::load("cartesian").unwrap().geometry() };
    DeskAccelerometer::new(geometry, [Mode::new(50.0, 0.05).unwrap(), Mode::new(40.0, 0.05).unwrap()])
}

fn events(accelerometer: &DeskAccelerometer) -> Vec<RecordEvent> {
    std::iter::from_fn(|| accelerometer.take_event()).collect()
}

fn micro_g(event: &RecordEvent) -> [i32; 3] {
    let RecordEvent::Sample { micro_g, .. } = event else { panic!("{event:?}") };
    *micro_g
}

#[test]
fn a_frame_at_rest_measures_gravity_and_noise() {
    let accelerometer = accelerometer(Kinematics::Cartesian);
    accelerometer.record(2000, false).unwrap();
    let mut taken = Vec::new();
    for tick in (0..=2 * SECOND).step_by(SECOND as usize / 100) {
        accelerometer.pass_to(tick);
        taken.extend(events(&accelerometer));
    }
    assert_eq!(taken.first(), Some(&RecordEvent::Begun));
    assert_eq!(taken.last(), Some(&RecordEvent::Ended { rate_hz: 1600, overflows: 0 }));
    let samples: Vec<[i32; 3]> = taken[1..taken.len() - 1].iter().map(micro_g).collect();
    assert_eq!(samples.len(), 2000);
    for (axis, expected) in [(0, 0.0), (1, 0.0), (2, 1e6)] {
        let mean = samples.iter().map(|sample| f64::from(sample[axis])).sum::<f64>() / 2000.0;
        let deviation = samples.iter().map(|sample| (f64::from(sample[axis]) - mean).powi(2)).sum::<f64>() / 2000.0;
        assert!((mean - expected).abs() < 600.0, "axis {axis}: {mean}");
        assert!((deviation.sqrt() - NOISE_MICRO_G).abs() < 600.0, "axis {axis}: {}", deviation.sqrt());
        assert!(samples.iter().all(|sample| sample[axis] % 3906 == 0), "whole units of 13 bits");
    }
}

/// A step of 12.5 um swings the mass with (2 pi 50 Hz)^2 12.5 um = 1234 mm/s^2 = 0.126 g; a step of
/// one CoreXY motor swings both axes.
#[test]
fn a_step_swings_the_axes_that_it_moves() {
    for (kinematics, expected) in [(Kinematics::Cartesian, [125_800, 0]), (Kinematics::CoreXy, [62_900, 40_300])] {
        let accelerometer = accelerometer(kinematics);
        // The motion clock stood at 500 when the board's time was 1 s.
        accelerometer.set_time(SECOND, 500);
        accelerometer.record(20, true).unwrap();
        accelerometer.pass_to(SECOND);
        assert_eq!(events(&accelerometer), [], "it waits for a move");
        let accelerometer = Rc::new(accelerometer);
        let mut tap = Tap(Some(Rc::clone(&accelerometer)));
        tap.stepped(400, 0b1000, 0);
        assert_eq!(events(&accelerometer), [], "the extruder shakes nothing");
        tap.stepped(500, 0b1, 0);
        accelerometer.pass_to(SECOND + SECOND / 1000);
        let taken = events(&accelerometer);
        assert_eq!(taken.first(), Some(&RecordEvent::Begun));
        // The first is taken at the step, the second 0.6 ms later, when the mass has hardly moved.
        let [before, after] = [1, 2].map(|index| micro_g(&taken[index]));
        assert!(before[..2].iter().all(|value| value.abs() < 30_000), "{before:?}");
        for (axis, expected) in expected.into_iter().enumerate() {
            assert!((after[axis] - expected).abs() < 30_000, "{kinematics:?}: {after:?}");
        }
    }
}

#[test]
fn samples_that_nobody_takes_are_counted() {
    let accelerometer = accelerometer(Kinematics::Cartesian);
    accelerometer.record(100, false).unwrap();
    accelerometer.pass_to(SECOND);
    let taken = events(&accelerometer);
    let samples = taken.iter().filter(|event| matches!(event, RecordEvent::Sample { .. })).count();
    let overflows = (100 - samples) as u32;
    assert!(samples <= WAITING_SAMPLES && overflows > 0);
    assert_eq!(taken.last(), Some(&RecordEvent::Ended { rate_hz: 1600, overflows }));
}

#[test]
fn settings_are_the_chips() {
    let accelerometer = accelerometer(Kinematics::Cartesian);
    for (asked, rate_hz) in [(25, 25), (1000, 800), (1300, 1600), (3200, 3200)] {
        assert_eq!(accelerometer.set(Some(asked), None).unwrap().rate_hz, rate_hz);
    }
    for (rate_hz, resolution_bits) in [(Some(24), None), (Some(3201), None), (None, Some(9)), (Some(100), Some(14))] {
        assert!(matches!(accelerometer.set(rate_hz, resolution_bits), Err(CommandError::OutOfRange { .. })));
    }
    let settings = AccelerometerSettings { name: "ADXL345", rate_hz: 3200, resolution_bits: 10 };
    assert_eq!(accelerometer.set(None, Some(10)).unwrap(), settings, "what was refused has changed nothing");
    // A change ends a record, whose rate it would be.
    accelerometer.record(10, false).unwrap();
    accelerometer.set(Some(400), None).unwrap();
    assert_eq!(events(&accelerometer), [RecordEvent::Begun, RecordEvent::Ended { rate_hz: 3200, overflows: 0 }]);
    accelerometer.record(10, true).unwrap();
    accelerometer.record(0, false).unwrap();
    assert_eq!(events(&accelerometer), [], "one that has not begun ends silently");
}
