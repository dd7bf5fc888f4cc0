//! A straight line as the steps of a CoreXY machine's motors.

use super::{CoreXyTarget, DualRate, FeedSteps, MinimumDeviation, MotorSteps, PlaneError, PointByPoint, TwoRates};
use crate::kinematics::Kinematics;
use crate::motion_choice::DualRatePeriods;

/// The methods of the CoreXY paper, in its order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaneMethod {
    /// [`PointByPoint`].
    PointByPoint,
    /// [`MinimumDeviation`].
    MinimumDeviation,
    /// [`DualRate`], and minimum deviation in its dead zone.
    DualRate,
}

#[derive(Clone, Copy, Debug)]
enum Rule {
    PointByPoint(PointByPoint),
    MinimumDeviation(MinimumDeviation),
    TwoRates(TwoRates),
    /// Less than a pulse.
    Nothing,
}

/// What the motors A and B do along a line, event by event, -1, 0 or 1 each and not both 0. A diagonal pulse is two
/// events, two steps of one motor.
#[derive(Clone, Copy, Debug)]
pub struct CoreXyLine {
    rule: Rule,
    feeds: FeedSteps,
    /// The second step of a diagonal.
    second: Option<MotorSteps>,
    /// The odd step at the end.
    rest: Option<MotorSteps>,
}

impl CoreXyLine {
    /// The line on which the motors make so many steps, either way.
    ///
    /// # Errors
    /// [`PlaneError`]; of the periods under [`PlaneMethod::DualRate`] only.
    pub fn new(method: PlaneMethod, first: i64, second: i64, periods: &DualRatePeriods) -> Result<Self, PlaneError> {
        // The motors' steps are in range even where the pulses, half as many, would be.
        super::Target::new(first, second)?;
        let feeds = |[x, y]: [i64; 2]| FeedSteps::new(Kinematics::CoreXy, x, y);
        if method == PlaneMethod::DualRate
            && let DualRate::TwoRates(line) = DualRate::new(first, second, periods)?
        {
            return Ok(Self { rule: Rule::TwoRates(line), feeds: feeds([0; 2]), second: None, rest: None });
        }
        let CoreXyTarget { pulses: [x, y], rest } = CoreXyTarget::new(first, second);
        let rule = match method {
            _ if [x, y] == [0; 2] => Rule::Nothing,
            PlaneMethod::PointByPoint => Rule::PointByPoint(PointByPoint::new(x, y)?),
            PlaneMethod::MinimumDeviation | PlaneMethod::DualRate => {
                Rule::MinimumDeviation(MinimumDeviation::new(x, y)?)
            }
        };
        Ok(Self { rule, feeds: feeds([x, y]), second: None, rest })
    }

    /// Whether each motor has a rate of its own.
    pub fn has_two_rates(&self) -> bool {
        matches!(self.rule, Rule::TwoRates(_))
    }
}

impl Iterator for CoreXyLine {
    type Item = [i8; 2];

    fn next(&mut self) -> Option<[i8; 2]> {
        if let Some(second) = self.second.take() {
            return Some(second.signed());
        }
        let pulse = match &mut self.rule {
            Rule::TwoRates(line) => return line.next(),
            Rule::PointByPoint(line) => line.next(),
            Rule::MinimumDeviation(line) => line.next(),
            Rule::Nothing => None,
        };
        let Some(pulse) = pulse else { return self.rest.take().map(MotorSteps::signed) };
        let steps = self.feeds.of(pulse);
        if steps.twice {
            self.second = Some(steps);
        }
        Some(steps.signed())
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
                    for events in line {
                        for motor in 0..2 {
                            here[motor] += i64::from(events[motor]);
                            steps[motor] += i64::from(events[motor].abs());
                        }
                    }
                    assert_eq!(here, [a, b]);
                    let more = a.abs().max(b.abs());
                    let dead = more * 10 > a.abs().min(b.abs()) * 50;
                    assert_eq!(has_two_rates, method == PlaneMethod::DualRate && !dead);
                    match method {
                        // Both motors step in every pulse, one of them to and fro.
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
