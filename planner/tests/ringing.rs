//! Vibration of a frame that shaped steps leave: as much as the shaper's formula predicts.

#![allow(clippy::unwrap_used, missing_docs)]

mod chart;

use std::path::Path;

use chart::Panel;
use ferrostep_checked_toml::book::REFRESH_VARIABLE;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AXES, AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, Notice, Planner, Progress, ShaperKind,
    StepEntry, StepKind, StepSink, StepsPerMm, TICKS_PER_SECOND,
};
use ferrostep_simulator::frame::Mode;
use ferrostep_simulator::motion::Motion;
use ferrostep_simulator::shapers::Shaper;

/// Frequencies that the shapers are made for, Hz; at the lowest, the longest filter is nearly as
/// long as one may be.
const FREQUENCIES_HZ: [f64; 8] = [20.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0, 120.0];

/// Frequencies of the frame, as parts of the shaper's.
const PARTS: [f64; 5] = [0.8, 0.9, 1.0, 1.1, 1.2];

/// Damping ratio that the shapers are made for, and those of the frame.
const DAMPING: f64 = 0.1;
const FRAME_DAMPINGS: [f64; 3] = [0.05, 0.1, 0.15];

/// Steps/mm of all motors.
const STEPS_PER_MM: f64 = 160.0;

/// The most by which steps and formula may differ, as a part of the unshaped vibration. Whole steps
/// shake the frame by a tenth of a step, however they are shaped; at 120 Hz that is 0.5 %.
const MOST: f64 = 0.01;

/// Steps of X and Y in order: seconds, and where both motors' steps put X and Y, mm.
struct Steps {
    kinematics: Kinematics,
    tick: u64,
    directions: u8,
    motors: [i32; 2],
    places: Vec<(f64, [f64; 2])>,
}

impl StepSink for Steps {
    fn entry(&mut self, entry: StepEntry) {
        match entry.kind() {
            StepKind::Directions { directions } => self.directions = directions,
            StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                for index in 1..=count {
                    self.tick += u64::from(interval_ticks);
                    let axes = if index == count { axes ^ added } else { axes };
                    for (motor, steps) in self.motors.iter_mut().enumerate() {
                        let sign = if self.directions >> motor & 1 == 1 { -1 } else { 1 };
                        *steps += sign * i32::from(axes >> motor & 1);
                    }
                    let [x, y, _] = self.kinematics.position([self.motors[0], self.motors[1], 0].map(f64::from));
                    self.places.push((seconds(self.tick), [x, y].map(|steps| steps / STEPS_PER_MM)));
                }
            }
        }
    }

    fn notice(&mut self, _: Notice) {}
}

fn seconds(ticks: u64) -> f64 {
    ticks as f64 / f64::from(TICKS_PER_SECOND)
}

/// A line of 60 mm that stops from 200 mm/s (X: 160, Y: 120) within 2 ms; its steps, and when
/// the motors rest, s.
fn line(kinematics: Kinematics, shapers: [AxisShaper; 2]) -> (Vec<(f64, [f64; 2])>, f64) {
    let geometry = Geometry {
        kinematics,
        steps_per_mm: [STEPS_PER_MM; 4].map(|value| StepsPerMm::from_f64(value).unwrap()),
        minimum_event_interval_ticks: 168,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    };
    let limits = Limits {
        max_feed_mm_per_s: [400.0; AXES],
        max_acceleration_mm_per_s2: [100_000.0; AXES],
        print_acceleration_mm_per_s2: 100_000.0,
        travel_acceleration_mm_per_s2: 100_000.0,
        retract_acceleration_mm_per_s2: 3_000.0,
        junction_deviation_mm: 0.05,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; AXES],
    };
    let mut planner: Planner<Vec<Slot>> = Planner::new(geometry, limits, vec![Slot::EMPTY; 8]);
    planner.set_motion_choice(&MotionChoice { shapers, ..MotionChoice::DEFAULT }).unwrap();
    let target_10nm = [4_800_000, -3_600_000, 0];
    let one = Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 200.0, line: 1, ends_move: true };
    planner.add(&one).unwrap();
    planner.flush();
    let mut steps = Steps { kinematics, tick: 0, directions: 0, motors: [0; 2], places: Vec::new() };
    while planner.advance(&mut steps) == Progress::Worked {}
    (steps.places, seconds(planner.motion_ticks()))
}

/// Amplitudes with which X and Y ring on a frame when the motors have come to rest, mm.
fn ringing(places: &[(f64, [f64; 2])], rest_s: f64, frequency_hz: f64, damping: f64) -> [f64; 2] {
    [0, 1].map(|axis: usize| {
        let mut mode = Mode::new(frequency_hz, damping).unwrap();
        let (mut time_s, mut command) = (0.0, Motion::standing(0.0));
        for &(next_s, place_mm) in places {
            mode.advance(next_s - time_s, command);
            (time_s, command) = (next_s, Motion::standing(place_mm[axis]));
        }
        mode.advance(rest_s - time_s, command);
        mode.ringing_mm(command)
    })
}

#[test]
fn shaped_steps_leave_as_much_vibration_as_the_formula_says() {
    let mut worst = (0.0, String::new());
    let mut tried = 0;
    for kinematics in [Kinematics::Cartesian, Kinematics::CoreXy] {
        let (unshaped, unshaped_rest_s) = line(kinematics, [AxisShaper::NONE; 2]);
        for kind in ShaperKind::EXAMPLES.into_iter().filter(|kind| *kind != ShaperKind::None) {
            for frequency_hz in FREQUENCIES_HZ {
                let shaper = AxisShaper { kind, frequency_hz, damping: DAMPING };
                let formula = Shaper::new(kind.to_string().parse().unwrap(), frequency_hz, DAMPING).unwrap();
                let (shaped, rest_s) = line(kinematics, [shaper; 2]);
                for part in PARTS {
                    for damping in FRAME_DAMPINGS {
                        let frame_hz = frequency_hz * part;
                        let before = ringing(&unshaped, unshaped_rest_s, frame_hz, damping);
                        let after = ringing(&shaped, rest_s, frame_hz, damping);
                        let expected = formula.residual(frame_hz, damping);
                        for (axis, (before, after)) in before.into_iter().zip(after).enumerate() {
                            tried += 1;
                            let found = after / before;
                            let difference = (found - expected).abs();
                            let case = format!(
                                "{kinematics:?} {} {frequency_hz} Hz, frame at {part} of it with damping {damping}, axis {axis}: \
                                 {found:.4}, the formula {expected:.4}",
                                kind
                            );
                            assert!(difference <= MOST, "{case}");
                            if difference > worst.0 {
                                worst = (difference, case);
                            }
                        }
                    }
                }
            }
        }
    }
    println!("{tried} cases, worst: {}", worst.1);
}

/// The frequency that the shapers of the book's chart are made for, Hz.
const CHART_HZ: f64 = 50.0;

/// Points of a curve of the chart.
const CHART_POINTS: u32 = 91;

/// The book's chart shows what the steps leave over the frame's frequency.
#[test]
fn the_books_chart_is_what_the_steps_leave() {
    let (unshaped, unshaped_rest_s) = line(Kinematics::Cartesian, [AxisShaper::NONE; 2]);
    let panels: Vec<Panel> = ShaperKind::NAMED
        .into_iter()
        .filter(|(_, kind)| *kind != ShaperKind::None)
        .map(|(name, kind)| {
            let shaper = AxisShaper { kind, frequency_hz: CHART_HZ, damping: DAMPING };
            let formula = Shaper::new(name.parse().unwrap(), CHART_HZ, DAMPING).unwrap();
            let (shaped, rest_s) = line(Kinematics::Cartesian, [shaper; 2]);
            let [low, high] = chart::ACROSS;
            let points = (0..CHART_POINTS).map(|index| {
                let part = low + (high - low) * f64::from(index) / f64::from(CHART_POINTS - 1);
                let frame_hz = CHART_HZ * part;
                let [before, _] = ringing(&unshaped, unshaped_rest_s, frame_hz, DAMPING);
                let [after, _] = ringing(&shaped, rest_s, frame_hz, DAMPING);
                [part, after / before, formula.residual(frame_hz, DAMPING)]
            });
            Panel { name, points: points.collect() }
        })
        .collect();
    for Panel { name, points } in &panels {
        for [part, steps, formula] in points {
            assert!((steps - formula).abs() <= MOST, "{name} at {part}: {steps:.4}, the formula {formula:.4}");
        }
    }
    let title = "What shaped steps leave of the ringing, over the frame's frequency as a part of the shaper's";
    let note =
        "Red: the steps on the frame. Blue: the formula. Shapers for 50 Hz, damping 0.1 of both, a stop from 160 mm/s.";
    let drawn = chart::svg(title, note, &panels);
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src/images/ringing.svg");
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        std::fs::write(&kept, &drawn).unwrap();
    }
    let kept = std::fs::read_to_string(&kept).unwrap_or_default();
    assert!(kept == drawn, "images/ringing.svg has changed: look at it, then set {REFRESH_VARIABLE} to keep it");
}
