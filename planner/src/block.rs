//! What look-ahead hands to interpolation: a move made of integers.

use crate::inner_ends::InnerEnds;
use crate::kinematics::UNITS_PER_MM;

/// A speed along the path in units of 2^-16 mm/s.
///
/// Fine enough that 0.01 mm/s is met to 0.2 %, coarse enough for 32 bits (65 m/s).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Speed(pub u32);

impl Speed {
    /// Standstill.
    pub const ZERO: Self = Self(0);

    /// The largest representable speed not above `mm_per_s`; zero for NaN and below zero.
    pub fn from_mm_per_s(mm_per_s: f64) -> Self {
        Self((mm_per_s * 65_536.0) as u32)
    }

    /// The speed, mm/s.
    pub fn mm_per_s(self) -> f64 {
        f64::from(self.0) / 65_536.0
    }

    /// Its square, mm^2/s^2.
    pub fn squared(self) -> f64 {
        self.mm_per_s() * self.mm_per_s()
    }
}

/// An acceleration along the path in units of 2^-8 mm/s^2, never zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Acceleration(u32);

impl Acceleration {
    /// The largest representable acceleration not above `mm_per_s2`, but at least 2^-8 mm/s^2.
    pub fn from_mm_per_s2(mm_per_s2: f64) -> Self {
        Self(((mm_per_s2 * 256.0) as u32).max(1))
    }

    /// The acceleration in units of 2^-8 mm/s^2.
    pub fn quantised(self) -> u32 {
        self.0
    }

    /// The acceleration, mm/s^2.
    pub fn mm_per_s2(self) -> f64 {
        f64::from(self.0) / 256.0
    }
}

/// A straight move, ready to be executed at any speeds up to its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Signed steps of the X, Y and Z motors (CoreXY: A, B, Z), at most 2^28 either way.
    pub steps: [i32; 3],
    /// Signed travel of the extruder in 1/256 steps.
    pub extruder_256ths: i32,
    /// Path length in units of 10 nm, at least 1: that of X, Y and Z, of the filament where nothing else moves. A move
    /// can be too short for a step and still take its time.
    pub length_10nm: u32,
    /// Largest speed along the path.
    pub nominal: Speed,
    /// Acceleration and deceleration along the path.
    pub acceleration: Acceleration,
    /// Number of the source line.
    pub line: u32,
    /// Whether the line's move ends with this block (an arc has many).
    pub ends_move: bool,
    /// Moves that end inside, where several were merged.
    pub inner_ends: InnerEnds,
}

impl Block {
    /// Path length, mm.
    pub fn length_mm(&self) -> f64 {
        f64::from(self.length_10nm) / UNITS_PER_MM as f64
    }
}

/// A block whose end speeds are settled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedBlock {
    /// The move.
    pub block: Block,
    /// Speed at its start.
    pub entry: Speed,
    /// Speed at its end.
    pub exit: Speed,
}
