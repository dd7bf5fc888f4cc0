//! Commands of a file that change the limits, and what each firmware makes of them.

use crate::motion::Axis;

/// The letters of a command with their numbers.
#[derive(Clone, Copy, Debug)]
pub struct Words<'a>(&'a [(char, f64)]);

impl<'a> Words<'a> {
    /// The words of a command, letters in capitals.
    pub const fn new(words: &'a [(char, f64)]) -> Self {
        Self(words)
    }

    /// The number of a letter, where the command has it.
    pub fn get(&self, letter: char) -> Option<f64> {
        self.0.iter().find(|(other, _)| *other == letter).map(|(_, value)| *value)
    }

    /// The number of a letter, if it is finite and above 0.
    pub fn positive(&self, letter: char) -> Option<f64> {
        self.get(letter).filter(|value| value.is_finite() && *value > 0.0)
    }
}

/// The words of Klipper's `SET_VELOCITY_LIMIT`.
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
    /// `ACCEL_TO_DECEL`, mm/s^2, which `minimum_cruise_ratio` has replaced: the ratio is what it
    /// lacks of the acceleration.
    pub accel_to_decel: Option<f64>,
}

/// A command that changes limits.
#[derive(Clone, Copy, Debug)]
pub enum Change<'a> {
    /// Largest accelerations of axes.
    M201(Words<'a>),
    /// Largest speeds of axes.
    M203(Words<'a>),
    /// Accelerations along the path.
    M204(Words<'a>),
    /// Jerk, junction deviation, smallest speeds.
    M205(Words<'a>),
    /// RepRapFirmware's jerk, in mm/min.
    M566(Words<'a>),
    /// Klipper's limits.
    VelocityLimit(VelocityLimit),
}

/// The effect of a command on the limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// The moves after it have other limits.
    Changed,
    /// The firmware has the command, and none of its words changes a limit.
    Unchanged,
    /// The firmware has no such command, or none in this build.
    Unknown,
    /// The firmware refuses a word's value; nothing has changed.
    Refused,
}

/// Takes what a command says of axes, each times `factor`. Values that are not above 0 are
/// refused, all of them.
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
