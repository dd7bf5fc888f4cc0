//! Motor steps in the plane for a pulse.

use super::target::Pulse;
use ferrostep_planner::Kinematics;

/// Bits of the two motors: X and Y, or A and B.
const FIRST: u8 = 1;
const SECOND: u8 = 2;

/// A step of one or both motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MotorPulse {
    /// Mask of the motors that step.
    pub axes: u8,
    /// Mask of those of them that run backwards.
    pub backwards: u8,
    /// True if the pulse consists of two such steps: along a diagonal, a CoreXY machine moves by
    /// one motor alone.
    pub twice: bool,
}

impl MotorPulse {
    /// No steps.
    pub const NONE: Self = Self { axes: 0, backwards: 0, twice: false };

    /// Step of each motor, -1, 0 or 1.
    pub fn signed(self) -> [i8; 2] {
        [FIRST, SECOND].map(|bit| match (self.axes & bit != 0, self.backwards & bit != 0) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => -1,
        })
    }

    /// One step of one motor.
    fn of(bit: u8, sign: i8) -> Self {
        Self { axes: bit, backwards: if sign < 0 { bit } else { 0 }, twice: false }
    }
}

/// Motor steps for each kind of pulse on a line; their signs never change.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FeedSteps {
    along_x: MotorPulse,
    along_y: MotorPulse,
    diagonally: MotorPulse,
}

impl FeedSteps {
    /// No steps at all.
    pub const NONE: Self = Self { along_x: MotorPulse::NONE, along_y: MotorPulse::NONE, diagonally: MotorPulse::NONE };

    /// Creates the steps of a line in this direction; only the signs count, 0 as positive.
    pub fn new(kinematics: Kinematics, x: i64, y: i64) -> Self {
        let [x_sign, y_sign] = [x, y].map(|pulses| if pulses < 0 { -1i8 } else { 1 });
        let both = |first: i8, second: i8| {
            let (first, second) = (MotorPulse::of(FIRST, first), MotorPulse::of(SECOND, second));
            MotorPulse { axes: FIRST | SECOND, backwards: first.backwards | second.backwards, twice: false }
        };
        match kinematics {
            Kinematics::Cartesian | Kinematics::CoreXz => Self {
                along_x: MotorPulse::of(FIRST, x_sign),
                along_y: MotorPulse::of(SECOND, y_sign),
                diagonally: both(x_sign, y_sign),
            },
            // A = X + Y, B = X - Y.
            Kinematics::CoreXy => Self {
                along_x: both(x_sign, x_sign),
                along_y: both(y_sign, -y_sign),
                diagonally: MotorPulse {
                    twice: true,
                    ..MotorPulse::of(if x_sign == y_sign { FIRST } else { SECOND }, x_sign)
                },
            },
        }
    }

    /// Steps of a pulse.
    #[inline]
    pub fn of(&self, pulse: Pulse) -> MotorPulse {
        match (pulse.x, pulse.y) {
            (_, 0) => self.along_x,
            (0, _) => self.along_y,
            _ => self.diagonally,
        }
    }
}

/// Motor steps of a CoreXY machine as pulses along X and Y, X = (A + B)/2 and Y = (A - B)/2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CoreXyTarget {
    /// Pulses along X and Y.
    pub pulses: [i64; 2],
    /// Half a diagonal pulse more if A + B is odd: a step of the motor that has more steps.
    pub rest: Option<MotorPulse>,
}

impl CoreXyTarget {
    /// Converts these numbers of motor steps to pulses.
    pub fn new(first: i64, second: i64) -> Self {
        let (mut a, mut b) = (first, second);
        let mut rest = None;
        if (a ^ b) & 1 == 1 {
            rest = Some(if a.unsigned_abs() >= b.unsigned_abs() {
                let sign = a.signum();
                a -= sign;
                MotorPulse::of(FIRST, sign as i8)
            } else {
                let sign = b.signum();
                b -= sign;
                MotorPulse::of(SECOND, sign as i8)
            });
        }
        // Both even or both odd.
        Self { pulses: [(a + b) / 2, (a - b) / 2], rest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_and_the_rest_are_the_motors_steps() {
        for a in -9i64..=9 {
            for b in -9i64..=9 {
                let target = CoreXyTarget::new(a, b);
                let [x, y] = target.pulses;
                let [rest_a, rest_b] = target.rest.map_or([0; 2], MotorPulse::signed).map(i64::from);
                assert_eq!([x + y + rest_a, x - y + rest_b], [a, b]);
                assert_eq!(target.rest.is_some(), (a + b) & 1 == 1);
                // No motor overshoots its end.
                assert!((x + y).abs() <= a.abs() && (x - y).abs() <= b.abs());
                assert_eq!(x.abs() + y.abs() + i64::from(target.rest.is_some()), a.abs().max(b.abs()));
            }
        }
    }

    #[test]
    fn pulses_are_the_papers_steps_of_both_motors() {
        let of = |x: i8, y: i8| {
            let steps = FeedSteps::new(Kinematics::CoreXy, x.into(), y.into()).of(Pulse { x, y });
            steps.signed().map(|step| step * if steps.twice { 2 } else { 1 })
        };
        for x in -1..=1i8 {
            for y in -1..=1i8 {
                if (x, y) != (0, 0) {
                    assert_eq!(of(x, y), [x + y, x - y], "{x} {y}");
                    let plain = FeedSteps::new(Kinematics::Cartesian, x.into(), y.into()).of(Pulse { x, y });
                    assert_eq!((plain.signed(), plain.twice), ([x, y], false));
                }
            }
        }
    }
}
