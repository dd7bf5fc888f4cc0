//! Several motors that lift Z, as a profile describes them.

/// A further motor of Z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ZMotor {
    /// The board's name for it.
    pub socket: &'static str,
    /// True if it runs the other way round.
    pub is_inverted: bool,
}

/// A part of a profile that most machines do not have, kept apart: where it is missing, an image
/// does not hold its room.
///
/// Its `Debug` is an expression of Rust, as that of all parts of a profile.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Kept<T: 'static>(pub &'static T);

impl<T: core::fmt::Debug> core::fmt::Debug for Kept<T> {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(out, "Kept(&{:?})", self.0)
    }
}

/// The motors of Z, where there are several. The first is that of the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZMotors {
    /// The further ones.
    pub further: [Option<ZMotor>; ZMotors::FURTHER],
    /// Alignment of the motors (G34); `None`: by hand.
    pub alignment: Option<ZAlignment>,
}

impl ZMotors {
    /// The most further motors.
    pub const FURTHER: usize = 3;

    /// Number of motors, the axis's own included.
    pub const fn count(&self) -> usize {
        let mut count = 1;
        while count <= Self::FURTHER && self.further[count - 1].is_some() {
            count += 1;
        }
        count
    }
}

/// Alignment of the motors of Z. Places are machine coordinates X and Y, units of 10 nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZAlignment {
    /// Places where each motor lifts the bed or the gantry.
    pub places_10nm: [[i64; 2]; ZMotors::FURTHER + 1],
    /// Places where the bed is probed.
    pub points_10nm: [Option<[i64; 2]>; ZAlignment::MAX_POINTS],
    /// Weights, for each motor, of the heights at these points for the height at its place.
    pub weights: [[f32; ZAlignment::MAX_POINTS]; ZMotors::FURTHER + 1],
    /// Maximum distance between the heights of the motors, units of 10 nm.
    pub max_correction_10nm: i64,
}

impl ZAlignment {
    /// The most points.
    pub const MAX_POINTS: usize = 8;
}
