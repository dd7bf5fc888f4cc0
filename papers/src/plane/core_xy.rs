//! A straight line as the steps of a CoreXY machine's motors.

use super::dual_rate::{DualRate, TwoRates};
use super::minimum_deviation::MinimumDeviation;
use super::motors::{CoreXyTarget, FeedSteps, MotorPulse};
use super::point_by_point::PointByPoint;
use super::target::{PlaneError, Target};
use ferrostep_planner::DualRatePeriods;
use ferrostep_planner::Kinematics;

/// Interpolation methods of the CoreXY paper, in its order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaneMethod {
    /// [`PointByPoint`].
    PointByPoint,
    /// [`MinimumDeviation`].
    MinimumDeviation,
    /// [`DualRate`], with minimum deviation in its dead zone.
    DualRate,
}

#[derive(Clone, Copy, Debug)]
enum Rule {
    PointByPoint(PointByPoint),
    MinimumDeviation(MinimumDeviation),
    TwoRates(TwoRates),
    /// The line is less than a pulse.
    Nothing,
}

/// A step of one or both motors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineEvent {
    /// Time of the event, as a share of the line's duration at a constant speed.
    pub share: f64,
    /// Steps of A and B, -1, 0 or 1 each, not both 0.
    pub steps: [i8; 2],
}

/// Steps of the motors A and B along a line. A diagonal pulse is two events, two steps of one
/// motor.
///
/// Events are in the middle of their parts of the time, as in a print: N pulses have an N-th each,
/// each half of a diagonal has half of that, and under dual-rate each motor has its own period.
#[derive(Clone, Copy, Debug)]
pub struct CoreXyLine {
    rule: Rule,
    /// Total steps of A and B.
    whole: [i64; 2],
    /// Steps of A and B so far.
    made: [i64; 2],
    /// Quarters of pulses passed so far: of minimum deviation's pulses, or 4 for each of
    /// point-by-point's.
    quarters: u64,
    /// Quarters of pulses of the whole line.
    all_quarters: u64,
    feeds: FeedSteps,
    /// Second step of a diagonal.
    second: Option<MotorPulse>,
    /// Odd step at the end.
    rest: Option<MotorPulse>,
}

impl CoreXyLine {
    /// Creates the line on which the motors make these numbers of steps, in either direction.
    ///
    /// # Errors
    /// [`PlaneError`]; errors of the periods only under [`PlaneMethod::DualRate`].
    pub fn new(method: PlaneMethod, first: i64, second: i64, periods: &DualRatePeriods) -> Result<Self, PlaneError> {
        // Checks the motors' steps, even if the pulses, half as many, are in range.
        Target::new(first, second)?;
        let feeds = |[x, y]: [i64; 2]| FeedSteps::new(Kinematics::CoreXy, x, y);
        if method == PlaneMethod::DualRate
            && let DualRate::TwoRates(line) = DualRate::new(first, second, periods)?
        {
            return Ok(Self::of(Rule::TwoRates(line), [first, second], feeds([0; 2]), 0, None));
        }
        let CoreXyTarget { pulses: [x, y], rest } = CoreXyTarget::new(first, second);
        let (rule, pulses) = match method {
            _ if [x, y] == [0; 2] => (Rule::Nothing, 0),
            PlaneMethod::PointByPoint => {
                let line = PointByPoint::new(x, y)?;
                (Rule::PointByPoint(line), line.len())
            }
            PlaneMethod::MinimumDeviation | PlaneMethod::DualRate => {
                let line = MinimumDeviation::new(x, y)?;
                (Rule::MinimumDeviation(line), line.len())
            }
        };
        Ok(Self::of(rule, [first, second], feeds([x, y]), pulses as u64, rest))
    }

    fn of(rule: Rule, whole: [i64; 2], feeds: FeedSteps, pulses: u64, rest: Option<MotorPulse>) -> Self {
        // The odd step takes as long as half a diagonal; in point-by-point, as long as a whole
        // pulse.
        let rest_quarters = match (&rule, &rest) {
            (_, None) => 0,
            (Rule::MinimumDeviation(_), Some(_)) => 2,
            _ => 4,
        };
        let all_quarters = 4 * pulses + rest_quarters;
        Self { rule, whole, made: [0; 2], quarters: 0, all_quarters, feeds, second: None, rest }
    }

    /// Returns true if each motor has its own rate.
    pub fn has_two_rates(&self) -> bool {
        matches!(self.rule, Rule::TwoRates(_))
    }
}

impl Iterator for CoreXyLine {
    type Item = LineEvent;

    fn next(&mut self) -> Option<LineEvent> {
        let steps = self.next_steps()?;
        for (made, step) in self.made.iter_mut().zip(steps) {
            *made += i64::from(step);
        }
        if !self.has_two_rates() {
            return Some(LineEvent { share: self.pass_quarters(steps), steps });
        }
        // Step k of N of the motor that steps; if both do, both give the same.
        let motor = usize::from(steps[0] == 0);
        let share = (self.made[motor].unsigned_abs() as f64 - 0.5) / self.whole[motor].unsigned_abs() as f64;
        Some(LineEvent { share, steps })
    }
}

impl CoreXyLine {
    /// Next steps of the motors.
    fn next_steps(&mut self) -> Option<[i8; 2]> {
        if let Some(second) = self.second.take() {
            return Some(second.signed());
        }
        let pulse = match &mut self.rule {
            Rule::TwoRates(line) => return line.next(),
            Rule::PointByPoint(line) => line.next(),
            Rule::MinimumDeviation(line) => line.next(),
            Rule::Nothing => None,
        };
        let Some(pulse) = pulse else { return self.rest.take().map(MotorPulse::signed) };
        let steps = self.feeds.of(pulse);
        if steps.twice {
            self.second = Some(steps);
        }
        Some(steps.signed())
    }

    /// Passes the time of these next steps; under minimum deviation they take half a pulse if one
    /// motor steps alone.
    fn pass_quarters(&mut self, steps: [i8; 2]) -> f64 {
        let is_half = matches!(self.rule, Rule::MinimumDeviation(_)) && steps.contains(&0);
        let quarters = if is_half { 2 } else { 4 };
        let middle = self.quarters + quarters / 2;
        self.quarters += quarters;
        middle as f64 / self.all_quarters as f64
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_small_line_ends_where_it_should() {
        let periods = DualRatePeriods { shortest_ns: 10, longest_ns: 50 };
        for a in -20i64..=20 {
            for b in -20i64..=20 {
                for method in [PlaneMethod::PointByPoint, PlaneMethod::MinimumDeviation, PlaneMethod::DualRate] {
                    let Ok(line) = CoreXyLine::new(method, a, b, &periods) else {
                        assert_eq!([a, b], [0; 2]);
                        continue;
                    };
                    let has_two_rates = line.has_two_rates();
                    let (mut here, mut steps) = ([0; 2], [0; 2]);
                    let mut last = 0.0;
                    for event in line {
                        assert!(event.share > last && event.share < 1.0, "{a} {b} {event:?}");
                        last = event.share;
                        for motor in 0..2 {
                            here[motor] += i64::from(event.steps[motor]);
                            steps[motor] += i64::from(event.steps[motor].abs());
                        }
                    }
                    assert_eq!(here, [a, b]);
                    let more = a.abs().max(b.abs());
                    let dead = more * 10 > a.abs().min(b.abs()) * 50;
                    assert_eq!(has_two_rates, method == PlaneMethod::DualRate && !dead);
                    match method {
                        // Both motors step in every pulse, one of them back and forth.
                        PlaneMethod::PointByPoint => {
                            let odd = (a + b) & 1;
                            assert_eq!(steps[0] + steps[1], 2 * more - odd);
                        }
                        _ => assert_eq!(steps, [a.abs(), b.abs()]),
                    }
                }
            }
        }
    }
}
