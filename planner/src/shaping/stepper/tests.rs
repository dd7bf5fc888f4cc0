#![allow(clippy::unwrap_used)]
use super::super::path_pieces::PathPieces;
use super::*;
use crate::kinematics::Geometry;
use crate::limits::Limits;
use crate::look_ahead::Slot;
use crate::s_curve::law::Curve;
use crate::s_curve::{Jerk, Run};
use crate::step_queue::StepKind;
use crate::{AXES, Acceleration, AxisShaper, Move, Planner, PressureAdvance, ShaperKind, Speed, StepsPerMm};
use proptest::prelude::*;

/// Maximum number of ticks by which a step may move when the plan is cut. Both solutions keep
/// within 20 ticks of the filtered law (`tests/shaped.rs`); a cut adds no error, since a piece
/// begins and ends where the law is.
const MOST_TICKS: u64 = 20;

/// ... or by which the motor moves in between, steps. A motor of CoreXY that hardly moves while X
/// and Y run has the sum of their accelerations in single precision: over a ramp of 1200 steps, an
/// eighth of 6e-8 of them.
const MOST_STEPS: f64 = 1e-5;

/// The steps of each motor: tick, and whether it goes backwards. And the ends of moves.
#[derive(Default)]
struct Steps {
    tick: u64,
    directions: u8,
    motors: [Vec<(u64, bool)>; 4],
    ended_lines: Vec<u32>,
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
                    for (motor, steps) in self.motors.iter_mut().enumerate().filter(|(motor, _)| axes >> motor & 1 == 1)
                    {
                        steps.push((self.tick, self.directions >> motor & 1 == 1));
                    }
                }
            }
        }
    }

    fn notice(&mut self, notice: Notice) {
        if let Notice::MoveEnded { line, .. } = notice {
            self.ended_lines.push(line);
        }
    }
}

impl Plan {
    /// Adds a block of one move as [`Self::add`] does, with every piece of its law cut at these
    /// shares of its time.
    fn add_cut(&mut self, planned: &PlannedBlock, law: &TimeLaw, shares: &[f64]) -> u64 {
        let block = &planned.block;
        let [dx, dy, dz] = block.steps;
        let line = [dx, dy, dz, block.extruder_256ths];
        let advances = self.advance.advances(block.extruder_256ths, block.length_10nm);
        let mut pieces = PathPieces::NONE;
        pieces.add(planned, law);
        for piece in pieces.iter() {
            let [start, end] = [piece.start, piece.end].map(|ticks| (ticks + 0.5) as u64);
            let mut cuts: Vec<u64> =
                shares.iter().map(|share| start + (share * (end - start) as f64) as u64).chain([start]).collect();
            cuts.sort_unstable();
            cuts.dedup();
            cuts.retain(|cut| (start..end).contains(cut));
            for (index, &cut) in cuts.iter().enumerate() {
                let lasts = cuts.get(index + 1).unwrap_or(&end) - cut;
                let part = piece.path.after(cut as f64 - piece.start).scaled(0.0, 1.0 / f64::from(block.length_10nm));
                self.add_part(self.end + cut, lasts, &line, &part, advances);
            }
        }
        self.ring.end_move(block.line, block.ends_move);
        let [x, y, z] = self.steps;
        self.steps = [x + dx, y + dy, z + dz];
        self.extruder_256ths += i64::from(block.extruder_256ths);
        self.end += pieces.duration_ticks;
        pieces.duration_ticks
    }
}

/// A machine: its shapers, how its extruder advances, and the time of its moving average, s. Where
/// the filament is faster or slower than that of a second slope a piece is cut anyway.
type Machine = (Kinematics, [AxisShaper; 2], PressureAdvance, Option<f64>);

/// Steps/mm of its extruder.
const EXTRUDER_STEPS_PER_MM: f64 = 140.0;

fn machine(smooth_time_s: impl Strategy<Value = Option<f64>>) -> impl Strategy<Value = Machine> {
    let shaper = || {
        (prop::sample::select(&ShaperKind::EXAMPLES[1..]), 22.0..120.0_f64, 0.0..0.19_f64)
            .prop_map(|(kind, frequency_hz, damping)| AxisShaper { kind, frequency_hz, damping })
    };
    let advance =
        prop_oneof![Just(0.0), 0.01..0.2_f64].prop_map(|seconds| PressureAdvance { seconds, ..PressureAdvance::NONE });
    (prop::sample::select(&[Kinematics::Cartesian, Kinematics::CoreXy]), [shaper(), shaper()], advance, smooth_time_s)
}

/// No moving average, or one that leaves the longest shaper room.
fn smooth_time_s() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![Just(None), (0.001..0.008_f64).prop_map(Some)]
}

/// Executes blocks with these filters, their pieces cut at these shares or whole. The ring still
/// holds all pieces.
fn motion(
    (kinematics, shapers, advance, smooth_time_s): Machine,
    blocks: &[(PlannedBlock, TimeLaw)],
    shares: Option<&[f64]>,
) -> (ShapedStepper, Steps) {
    let mut stepper = ShapedStepper::new(1, kinematics);
    stepper.set_shaping(&Shaping::new(&shapers, smooth_time_s, &advance).unwrap());
    stepper.set_advance(AdvanceLaw::new(&advance, EXTRUDER_STEPS_PER_MM));
    stepper.start(&Standing { clock: 0, last_event: 0, steps: [0; 3], extruder_256ths: 0, directions: 0 });
    let mut steps = Steps::default();
    let mut finish = |stepper: &mut ShapedStepper| {
        while stepper.is_busy() {
            stepper.advance(&mut steps);
        }
    };
    for (planned, law) in blocks {
        match shares {
            None => stepper.begin(planned, law),
            Some(shares) => {
                stepper.is_busy = true;
                stepper.plan.add_cut(planned, law, shares)
            }
        };
        finish(&mut stepper);
    }
    stepper.begin_rest();
    finish(&mut stepper);
    assert!(stepper.is_at_rest());
    (stepper, steps)
}

/// Executes blocks whole and cut, and compares: number, order and directions of each motor's steps
/// are the same, and their times to rounding.
fn compare(machine: Machine, blocks: &[(PlannedBlock, TimeLaw)], shares: &[f64]) {
    let ((stepper, whole), (_, cut)) = (motion(machine, blocks, None), motion(machine, blocks, Some(shares)));
    assert_eq!(whole.ended_lines, cut.ended_lines);
    assert!(whole.motors.iter().any(|steps| !steps.is_empty()));
    let position = |motor: usize, tick: u64| {
        let mut taps = stepper.taps;
        taps.rewind();
        taps.move_to(tick, &stepper.plan.ring, &[0; 4]);
        taps.positions(tick, &stepper.plan.ring, &[0; 4])[motor]
    };
    for (motor, (one, other)) in whole.motors.iter().zip(&cut.motors).enumerate() {
        assert_eq!(one.len(), other.len(), "motor {motor}");
        for (&(tick, is_backwards), &(cut_tick, is_cut_backwards)) in one.iter().zip(other) {
            assert_eq!(is_backwards, is_cut_backwards, "motor {motor} at {tick} and {cut_tick}");
            if tick.abs_diff(cut_tick) > MOST_TICKS {
                let moved =
                    position(motor, tick).abs_diff(position(motor, cut_tick)) as f64 / fixed::of_steps(1) as f64;
                assert!(moved <= MOST_STEPS, "motor {motor} at {tick} and {cut_tick}, {moved:e} steps apart");
            }
        }
    }
}

/// A move, relative: mm, turn from the one before, filament and feed, mm and mm/s.
type Relative = (f64, f64, f64, f64);

/// The blocks of a planner with corners, at most three pieces each; every move is one, too
/// long to be joined.
fn planned(
    (kinematics, shapers, pressure_advance, smooth_time_s): Machine,
    acceleration: f64,
    moves: &[Relative],
) -> Vec<PlannedBlock> {
    let steps = |value: f64| StepsPerMm::from_f64(value).unwrap();
    let geometry = Geometry {
        kinematics,
        steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(EXTRUDER_STEPS_PER_MM)],
        minimum_event_interval_ticks: 1,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    };
    let limits = Limits {
        max_feed_mm_per_s: [400.0, 400.0, 20.0, 100.0],
        max_acceleration_mm_per_s2: [20_000.0, 20_000.0, 500.0, 10_000.0],
        print_acceleration_mm_per_s2: acceleration,
        travel_acceleration_mm_per_s2: acceleration,
        retract_acceleration_mm_per_s2: 3_000.0,
        junction_deviation_mm: 0.05,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; AXES],
    };
    let mut planner: Planner<Vec<Slot>> = Planner::new(geometry, limits, vec![Slot::EMPTY; 64]);
    planner
        .set_motion_choice(&crate::MotionChoice {
            shapers,
            pressure_advance,
            smooth_time_s,
            ..crate::MotionChoice::DEFAULT
        })
        .unwrap();
    let (mut direction, mut place) = (0.0f64, [0.0, 0.0]);
    for (index, &(length, turn, filament, feed)) in moves.iter().enumerate() {
        direction += turn;
        place = [place[0] + length * direction.cos(), place[1] + length * direction.sin()];
        let [x, y] = place.map(|mm| (mm * 1e5) as i64);
        let (filament_100pm, feed_mm_per_s, line) = ((filament * 1e7) as i64, feed as f32, index as u32 + 1);
        let one = Move { target_10nm: [x, y, 0], filament_100pm, feed_mm_per_s, line, ends_move: true };
        planner.add(&one).unwrap();
    }
    planner.flush();
    std::iter::from_fn(|| planner.next_planned()).collect()
}

fn relative() -> impl Strategy<Value = Relative> {
    (1.0..20.0_f64, -3.2..3.2_f64, -0.1..0.4_f64, 5.0..300.0_f64)
}

proptest! {
    /// The ring holds all pieces of a case, cut as they are: 5 blocks of 3 pieces, each cut into 4.
    #[test]
    fn any_cut_of_the_plan_gives_the_same_steps(
        machine in machine(smooth_time_s()), acceleration in 300.0..20_000.0_f64,
        moves in prop::collection::vec(relative(), 1..=5), shares in prop::collection::vec(0.0..1.0_f64, 1..=3),
    ) {
        let blocks = planned(machine, acceleration, &moves);
        prop_assert_eq!(blocks.len(), moves.len());
        let blocks: Vec<_> = blocks.into_iter().map(|planned| (planned, TimeLaw::trapezoid(&planned))).collect();
        compare(machine, &blocks, &shares);
    }

    #[test]
    fn any_cut_of_an_s_curve_gives_the_same_steps(
        machine in machine(Just(None)), acceleration in 300.0..20_000.0_f64, jerk_ratio in 10.0..300.0_f64,
        one in relative(), angle in -3.2..3.2_f64, shares in prop::collection::vec(0.0..1.0_f64, 1..=7),
    ) {
        let (_, _, filament, feed) = one;
        let jerk = acceleration * jerk_ratio;
        // Length for both ramps.
        let length = 1.0 + 2.0 * feed * ((feed / jerk).sqrt() + feed / acceleration + acceleration / jerk);
        let [planned] = planned(machine, acceleration, &[(length, angle, filament, feed)]).try_into().unwrap();
        let run = Run {
            length_10nm: planned.block.length_10nm,
            entry: Speed::ZERO,
            peak: planned.block.nominal,
            exit: Speed::ZERO,
            acceleration: Acceleration::from_mm_per_s2(acceleration),
            jerk: Jerk::from_mm_per_s3(jerk).unwrap(),
        };
        let (law, _) = TimeLaw::along(&Curve::new(&run), 0, run.length_10nm);
        compare(machine, &[(planned, law)], &shares);
    }
}
