//! Commands in a file that change the limits, and their effect on each firmware.

use crate::motion::Axis;

/// Words of a command: letters with their numbers.
#[derive(Clone, Copy, Debug)]
pub struct Words<'a>(&'a [(char, f64)]);

impl<'a> Words<'a> {
    /// Wraps the words of a command; letters are upper case.
    pub const fn new(words: &'a [(char, f64)]) -> Self {
        Self(words)
    }

    /// Returns the number of a letter, if the command has that letter.
    pub fn get(&self, letter: char) -> Option<f64> {
        self.0.iter().find(|(other, _)| *other == letter).map(|(_, value)| *value)
    }

    /// Returns the number of a letter, if it is finite and above 0.
    pub fn positive(&self, letter: char) -> Option<f64> {
        self.get(letter).filter(|value| value.is_finite() && *value > 0.0)
    }
}

/// Parameters of Klipper's `SET_VELOCITY_LIMIT`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VelocityLimit {
    /// `VELOCITY`, mm/s.
    pub velocity: Option<f64>,
    /// `ACCEL`, mm/s^2.
    pub accel: Option<f64>,
    /// `SQUARE_CORNER_VELOCITY`, mm/s.
    pub square_corner_velocity: Option<f64>,
    /// `MINIMUM_CRUISE_RATIO`.
    pub minimum_cruise_ratio: Option<f64>,
    /// `ACCEL_TO_DECEL`, mm/s^2, replaced by `minimum_cruise_ratio`: the ratio is 1 minus its
    /// quotient with the acceleration.
    pub accel_to_decel: Option<f64>,
}

/// Command that changes limits.
#[derive(Clone, Copy, Debug)]
pub enum Change<'a> {
    /// Maximum accelerations of axes.
    M201(Words<'a>),
    /// Maximum speeds of axes.
    M203(Words<'a>),
    /// Accelerations along the path.
    M204(Words<'a>),
    /// Jerk, junction deviation, minimum speeds.
    M205(Words<'a>),
    /// RepRapFirmware's jerk, in mm/min.
    M566(Words<'a>),
    /// Klipper's limits.
    VelocityLimit(VelocityLimit),
}

/// Effect of a command on the limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// The limits of later moves have changed.
    Changed,
    /// The firmware knows the command, but none of its words changes a limit.
    Unchanged,
    /// The firmware does not know the command, or not in this build.
    Unknown,
    /// The firmware refuses the value of a word; nothing has changed.
    Refused,
}

/// Sets the values of the axes that a command names, each multiplied by `factor`. If one value is
/// not above 0, all are refused.
pub(crate) fn set_axes(words: &Words<'_>, values: &mut [f64; 4], factor: f64) -> Effect {
    let mut changed = *values;
    let mut effect = Effect::Unchanged;
    for (axis, value) in Axis::ALL.into_iter().zip(&mut changed) {
        if words.get(axis.letter()).is_some() {
            let Some(number) = words.positive(axis.letter()) else { return Effect::Refused };
            *value = number * factor;
            effect = Effect::Changed;
        }
    }
    *values = changed;
    effect
}
