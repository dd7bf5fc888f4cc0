//! Pulses, and the target of a line of pulses.

use ferrostep_planner::bresenham::MAX_STEPS;

/// Reason for which there is no such line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaneError {
    /// The line ends where it starts.
    NoLength,
    /// An axis has more than 2^28 pulses.
    TooLong,
    /// A pulse period is zero or negative, not a number, or too long for 32 bits of nanoseconds.
    NoPeriod,
    /// The longest pulse period is shorter than the shortest.
    PeriodsReversed,
}

/// A pulse: the advance of X and Y, -1, 0 or 1 each, not both 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// Step along X.
    pub x: i8,
    /// Step along Y.
    pub y: i8,
}

/// Number of pulses of each kind on a line, and their directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target {
    /// Pulses, at most [`MAX_STEPS`] each, not both 0.
    pub magnitudes: [u32; 2],
    /// Signs of the pulses, -1 or 1; 1 for no pulses.
    pub signs: [i8; 2],
}

impl Target {
    /// Creates the target of a line from 0 to (x, y).
    pub fn new(x: i64, y: i64) -> Result<Self, PlaneError> {
        if x == 0 && y == 0 {
            return Err(PlaneError::NoLength);
        }
        let [Some(x_pulses), Some(y_pulses)] = [x, y].map(|pulses| match u32::try_from(pulses.unsigned_abs()) {
            Ok(magnitude) if magnitude <= MAX_STEPS => Some(magnitude),
            _ => None,
        }) else {
            return Err(PlaneError::TooLong);
        };
        Ok(Self { magnitudes: [x_pulses, y_pulses], signs: [x, y].map(|pulses| if pulses < 0 { -1 } else { 1 }) })
    }

    /// A pulse along X.
    pub fn along_x(&self) -> Pulse {
        Pulse { x: self.signs[0], y: 0 }
    }

    /// A pulse along Y.
    pub fn along_y(&self) -> Pulse {
        Pulse { x: 0, y: self.signs[1] }
    }

    /// A pulse along both.
    pub fn diagonally(&self) -> Pulse {
        Pulse { x: self.signs[0], y: self.signs[1] }
    }
}
