//! The papers' step patterns for the planner.

use ferrostep_planner::methods::{DueEvent, StepPattern};
use ferrostep_planner::stretches::Stretch;
use ferrostep_planner::time_units::HALF_TICK;
use ferrostep_planner::{Interpolation, Kinematics, MotionChoice, MotorSteps};

use crate::laws::PaperPieces;
use crate::method::Method;
use crate::pulses::{Law, Pulses, Times};

/// Classic Bresenham, point-by-point comparison, minimum deviation or dual-rate.
///
/// X and Y are one stream of pulses, or two under dual-rate. Classic Bresenham also orders Z.
#[derive(Clone, Copy, Debug)]
pub struct PaperPattern {
    method: Method,
    streams: [(Pulses, Times); 2],
    z: Times,
}

impl PaperPattern {
    /// Creates the chosen pattern.
    pub(crate) fn new(choice: &MotionChoice, kinematics: Kinematics) -> Self {
        Self { method: Method::new(choice, kinematics), streams: [(Pulses::NONE, Times::NONE); 2], z: Times::NONE }
    }

    /// Index of the stream with the next event.
    fn next_stream(&self) -> usize {
        let [(first, _), (second, _)] = &self.streams;
        match [first.next(), second.next()] {
            [Some(first), Some(second)] if second.time < first.time => 1,
            [None, Some(_)] => 1,
            _ => 0,
        }
    }
}

impl StepPattern<PaperPieces> for PaperPattern {
    fn densest(&self, steps: [i32; 3]) -> u32 {
        self.method.densest(steps)
    }

    fn events(&self, steps: [i32; 3]) -> u32 {
        self.method.events(steps)
    }

    fn least_ticks(&self, steps: [i32; 3]) -> f32 {
        self.method.least_ticks(steps)
    }

    fn z(&self) -> &Times {
        &self.z
    }

    fn z_mut(&mut self) -> &mut Times {
        &mut self.z
    }

    fn start(&mut self, stretch: &Stretch, law: &Law) {
        let [x, y, z] = stretch.steps;
        let [(first, times), (second, second_times)] = &mut self.streams;
        *second = Pulses::NONE;
        self.z = Times::NONE;
        if self.method.interpolation == Interpolation::Bresenham {
            first.start_bresenham(times, law, stretch);
            return;
        }
        if self.method.has_two_rates(stretch.steps) {
            first.start_alone(times, law, stretch, 1, x);
            second.start_alone(second_times, law, stretch, 2, y);
        } else {
            first.start_plane(times, law, stretch, &self.method);
        }
        self.z.start(law, stretch, &MotorSteps::Even { count: z.unsigned_abs() }, HALF_TICK);
    }

    fn next(&self) -> Option<DueEvent> {
        let (pulses, _) = self.streams.get(self.next_stream())?;
        pulses.next()
    }

    fn advance(&mut self) {
        let stream = self.next_stream();
        if let Some((pulses, times)) = self.streams.get_mut(stream) {
            pulses.advance(times);
        }
    }
}
