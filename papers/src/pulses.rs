//! Motor steps in the plane, event by event, for any of the methods.

use ferrostep_planner::bresenham::MAX_STEPS;
use ferrostep_planner::methods::DueEvent;
use ferrostep_planner::stretches::Stretch;
use ferrostep_planner::time_law::TimeLaw;
use ferrostep_planner::time_units::HALF_TICK;
use ferrostep_planner::{Follower, Interpolation, Kinematics, MotorSteps, StepTimes};

use crate::laws::PaperPieces;
use crate::method::Method;
use crate::plane::{CoreXyTarget, FeedSteps, MinimumDeviation, MotorPulse, PointByPoint};

/// Step times under any law of this crate.
pub(crate) type Times = StepTimes<PaperPieces>;

/// Any law of this crate along a block.
pub(crate) type Law = TimeLaw<PaperPieces>;

/// Rule that selects the motors that step in an event.
#[derive(Clone, Copy, Debug)]
enum Rule {
    /// The same motors in every event.
    Always(MotorPulse),
    /// The first motors in every event, the others with some of the steps (Wu 2024, eq. 3).
    Bresenham {
        master: u8,
        followers: [Follower; 2],
        backwards: u8,
    },
    PointByPoint(PointByPoint),
    MinimumDeviation(MinimumDeviation),
    /// Less than one pulse.
    Nothing,
}

/// Steps of some motors, at equal distances along the block.
///
/// N pulses divide the path into N parts, and pulse k is due in the middle of its part, at (k -
/// 1/2) S/N. The paper does not give the position: at the end, as for a pulse of a constant period,
/// a pulse would be late by up to a whole pulse and never early. In the middle it is off by at most
/// half a pulse either way, the rule of the default's master, and no pulse is due at the very end
/// of a block, where near standstill even a tiny path takes long. A diagonal pulse of a CoreXY
/// machine is two steps of one motor: each is in the middle of its half.
///
/// The caller's [`Times`] give the time of the middle of the next part, or of the next half if
/// pulses have halves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pulses {
    rule: Rule,
    feeds: FeedSteps,
    /// True if each pulse has two halves, which may be an event each.
    has_halves: bool,
    /// Second half of a diagonal.
    second: Option<MotorPulse>,
    /// Step after the last pulse.
    rest: Option<MotorPulse>,
    /// The next event; `None` after the last.
    next: Option<DueEvent>,
}

impl Pulses {
    /// No steps at all.
    pub const NONE: Self =
        Self { rule: Rule::Nothing, feeds: FeedSteps::NONE, has_halves: false, second: None, rest: None, next: None };

    /// Starts the steps of a single motor.
    pub fn start_alone(&mut self, times: &mut Times, law: &Law, stretch: &Stretch, bit: u8, steps: i32) {
        let count = steps.unsigned_abs().min(MAX_STEPS);
        let backwards = if steps < 0 { bit } else { 0 };
        self.rule = Rule::Always(MotorPulse { axes: bit, backwards, twice: false });
        self.begin(times, law, stretch, count, false, None);
    }

    /// Starts classic Bresenham: the motor with the most steps, with the others joining some of its
    /// steps.
    pub fn start_bresenham(&mut self, times: &mut Times, law: &Law, stretch: &Stretch) {
        let steps = stretch.steps;
        let [x, y, z] = steps.map(|steps| steps.unsigned_abs().min(MAX_STEPS));
        let (count, master, others) = if x >= y && x >= z {
            (x, 1, [(2, y), (4, z)])
        } else if y >= z {
            (y, 2, [(1, x), (4, z)])
        } else {
            (z, 4, [(1, x), (2, y)])
        };
        let bits = [1u8, 2, 4].into_iter().zip(steps);
        let backwards = bits.fold(0, |mask, (bit, steps)| if steps < 0 { mask | bit } else { mask });
        let followers = others.map(|(bit, steps)| Follower::new(bit, count, steps));
        self.rule = Rule::Bresenham { master, followers, backwards };
        self.begin(times, law, stretch, count, false, None);
    }

    /// Starts X and Y together by point-by-point comparison or minimum deviation.
    pub fn start_plane(&mut self, times: &mut Times, law: &Law, stretch: &Stretch, method: &Method) {
        let [first, second, _] = stretch.steps;
        let motors = [first, second].map(i64::from);
        let CoreXyTarget { pulses: [x, y], rest } = match method.kinematics {
            Kinematics::CoreXy => CoreXyTarget::new(motors[0], motors[1]),
            Kinematics::Cartesian | Kinematics::CoreXz => CoreXyTarget { pulses: motors, rest: None },
        };
        self.feeds = FeedSteps::new(method.kinematics, x, y);
        let mut has_halves = false;
        let mut count = 0;
        self.rule = Rule::Nothing;
        if method.interpolation == Interpolation::PointByPoint {
            if let Ok(line) = PointByPoint::new(x, y) {
                count = line.len() as u32;
                self.rule = Rule::PointByPoint(line);
            }
        } else if let Ok(line) = MinimumDeviation::new(x, y) {
            has_halves = method.kinematics == Kinematics::CoreXy;
            count = line.len() as u32 * if has_halves { 2 } else { 1 };
            self.rule = Rule::MinimumDeviation(line);
        }
        self.begin(times, law, stretch, count + u32::from(rest.is_some()), has_halves, rest);
    }

    /// Begins with `parts` equal parts of the time, including that of the first event.
    fn begin(
        &mut self,
        times: &mut Times,
        law: &Law,
        stretch: &Stretch,
        parts: u32,
        has_halves: bool,
        rest: Option<MotorPulse>,
    ) {
        self.has_halves = has_halves;
        self.second = None;
        self.rest = rest;
        times.start(law, stretch, &MotorSteps::Even { count: parts }, HALF_TICK);
        self.advance(times);
    }

    /// The next event.
    #[inline]
    pub fn next(&self) -> Option<DueEvent> {
        self.next
    }

    /// Advances to the event after the next one.
    pub fn advance(&mut self, times: &mut Times) {
        let Some(mut time) = times.next() else {
            self.next = None;
            return;
        };
        times.take(1);
        let steps = match self.second.take() {
            Some(second) => second,
            None => {
                let steps = self.next_steps();
                if steps.twice {
                    self.second = Some(steps);
                } else if let Some(half) = times.next().filter(|_| self.has_halves) {
                    // The middle of each half. Only a step after the last pulse has a single half.
                    time += (half - time) / 2;
                    times.take(1);
                }
                steps
            }
        };
        self.next = Some(DueEvent { time, axes: steps.axes, backwards: steps.backwards });
    }

    /// Steps of the next pulse; after the last pulse, the remaining step.
    fn next_steps(&mut self) -> MotorPulse {
        let pulse = match &mut self.rule {
            Rule::Always(steps) => return *steps,
            Rule::Bresenham { master, followers: [first, second], backwards } => {
                let axes = *master | first.pass(1) | second.pass(1);
                return MotorPulse { axes, backwards: *backwards & axes, twice: false };
            }
            Rule::PointByPoint(line) => line.next(),
            Rule::MinimumDeviation(line) => line.next(),
            Rule::Nothing => None,
        };
        match (pulse, self.rest) {
            (Some(pulse), _) => self.feeds.of(pulse),
            // The number of parts is that of the pulses, plus one for the remaining step.
            (None, rest) => rest.unwrap_or(MotorPulse::NONE),
        }
    }
}
