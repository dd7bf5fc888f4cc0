//! A move made of integers: the interface between look-ahead and interpolation.

use crate::inner_ends::InnerEnds;
use crate::kinematics::UNITS_PER_MM;
use crate::square_root::square_root_f32;
use crate::time_units::TICKS_PER_SECOND;

/// A speed along the path in units of 2^-16 mm/s.
///
/// Fine enough that 0.01 mm/s is met to 0.2 %, coarse enough for 32 bits (65 m/s).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Speed(pub u32);

impl Speed {
    /// Standstill.
    pub const ZERO: Self = Self(0);

    /// Largest representable speed not above `mm_per_s`; zero for NaN and negative values.
    pub fn from_mm_per_s(mm_per_s: f64) -> Self {
        Self((mm_per_s * 65_536.0) as u32)
    }

    /// The speed, mm/s.
    pub fn mm_per_s(self) -> f64 {
        f64::from(self.0) / 65_536.0
    }

    /// Ticks for a length in units of 10 nm at this speed, to single precision; the maximum for
    /// standstill.
    pub fn ticks_for(self, length_10nm: u32) -> u64 {
        // Units of 10 nm in a tick at one unit of speed.
        const PER_10NM: f32 = (65_536 * (TICKS_PER_SECOND as i64 / UNITS_PER_MM)) as f32;
        (length_10nm as f32 * PER_10NM / self.0 as f32) as u64
    }

    /// Nearest single-precision value, mm/s: the unit is a power of two.
    pub fn mm_per_s_f32(self) -> f32 {
        self.0 as f32 / 65_536.0
    }

    /// Square of the speed, mm^2/s^2.
    pub fn squared(self) -> f64 {
        self.mm_per_s() * self.mm_per_s()
    }

    /// Single-precision version of [`Self::from_mm_per_s`].
    pub fn from_mm_per_s_f32(mm_per_s: f32) -> Self {
        Self((mm_per_s * 65_536.0) as u32)
    }
}

/// A squared speed, in units of 1/12,800,000 mm^2/s^2.
///
/// The unit is that of twice an [`Acceleration`]'s unit times 10 nm, so that 2 a S is an
/// exact product of integers and the passes of look-ahead add and compare without rounding. A
/// speed of 2^-16 mm/s is 0.003 units, one of 0.003 mm/s is 115; the square of the largest
/// [`Speed`] takes 56 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct SquaredSpeed(u64);

impl SquaredSpeed {
    /// Standstill.
    pub const ZERO: Self = Self(0);

    /// Squared speed of this many units.
    pub const fn from_units(units: u64) -> Self {
        Self(units)
    }

    /// Number of units.
    pub const fn units(self) -> u64 {
        self.0
    }

    /// Largest squared speed that can be reached from this one over a block, or from which this one
    /// can be reached: v^2 + 2 a S (Yu 2019).
    pub fn changed_over(self, block: &Block) -> Self {
        self.changed_by(block.reach())
    }

    /// Version of [`Self::changed_over`] for a known [`Block::reach`].
    #[inline(always)]
    pub(crate) fn changed_by(self, reach: u64) -> Self {
        Self(self.0.saturating_add(reach))
    }

    /// Smallest squared speed that can be reached from this one over a block.
    pub fn slowed_over(self, block: &Block) -> Self {
        self.slowed_by(block.reach())
    }

    /// Version of [`Self::slowed_over`] for a known [`Block::reach`].
    #[inline(always)]
    pub(crate) fn slowed_by(self, reach: u64) -> Self {
        Self(self.0.saturating_sub(reach))
    }

    /// Largest speed whose square is not above this.
    pub fn root(self) -> Speed {
        // 2^32 / 12,800,000: from these units to squared units of Speed.
        const SCALE: f32 = 1_048_576.0 / 3_125.0;
        const FASTEST: Speed = Speed(u32::MAX);
        if self >= Self::from(FASTEST) {
            return FASTEST;
        }
        // The single-precision root is off by a few units, more at higher speeds: 2 at 256 mm/s, 12
        // at 2 m/s.
        let mut speed = square_root_f32(crate::u64_to_f32::of_u64(self.0) * SCALE) as u32;
        // Remainder, in 2^-20 units: so far below 2^63 that the terms may wrap.
        let square = u64::from(speed) * u64::from(speed);
        let mut rest = (self.0 << 20).wrapping_sub(square.wrapping_mul(3_125)).cast_signed();
        // Difference between the squares of a speed and of the next one.
        let step = |speed: u32| (2 * i64::from(speed) + 1) * 3_125;
        while rest < 0 {
            speed = speed.wrapping_sub(1);
            rest += step(speed);
        }
        while rest >= step(speed) {
            rest -= step(speed);
            speed = speed.wrapping_add(1);
        }
        Speed(speed)
    }
}

impl From<Speed> for SquaredSpeed {
    /// The square, rounded up to whole units, so that only standstill becomes zero.
    fn from(speed: Speed) -> Self {
        // 12,800,000 / 2^32 = 3,125 / 2^20, in two parts so that 64 bits are enough.
        let square = u64::from(speed.0) * u64::from(speed.0);
        let (high, low) = (square >> 20, square & 0xF_FFFF);
        Self(high * 3_125 + ((low * 3_125 + 0xF_FFFF) >> 20))
    }
}

/// An acceleration along the path in units of 2^-8 mm/s^2, never zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Acceleration(u32);

impl Acceleration {
    /// The largest: 8 km/s^2, so that 2 a S is below 2^63.
    pub(crate) const MAX: Self = Self(i32::MAX as u32);

    /// The largest representable acceleration not above `mm_per_s2`, but at least 2^-8 mm/s^2.
    pub fn from_mm_per_s2(mm_per_s2: f64) -> Self {
        Self::from_quantised((mm_per_s2 * 256.0) as u32)
    }

    /// Acceleration of this many units of 2^-8 mm/s^2, clamped to the range from one
    /// unit to the largest.
    pub fn from_quantised(units: u32) -> Self {
        Self(units.clamp(1, Self::MAX.0))
    }

    /// The acceleration in units of 2^-8 mm/s^2.
    pub fn quantised(self) -> u32 {
        self.0
    }

    /// The acceleration, mm/s^2.
    pub fn mm_per_s2(self) -> f64 {
        f64::from(self.0) / 256.0
    }

    /// The nearest single-precision number of mm/s^2: the unit is a power of two.
    pub fn mm_per_s2_f32(self) -> f32 {
        self.0 as f32 / 256.0
    }

    /// Single-precision version of [`Self::from_mm_per_s2`].
    pub fn from_mm_per_s2_f32(mm_per_s2: f32) -> Self {
        Self::from_quantised((mm_per_s2 * 256.0) as u32)
    }
}

/// A straight move, ready to be executed at any speeds up to its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Signed steps of the X, Y and Z motors (CoreXY: A, B, Z), at most 2^28 either way.
    pub steps: [i32; 3],
    /// Signed travel of the extruder in 1/256 steps.
    pub extruder_256ths: i32,
    /// Path length in units of 10 nm, at least 1: that of X, Y and Z, or of the filament if it
    /// moves alone. A move can be too short for a step and still take its time.
    pub length_10nm: u32,
    /// Largest speed along the path.
    pub nominal: Speed,
    /// Acceleration and deceleration along the path.
    pub acceleration: Acceleration,
    /// Number of the source line.
    pub line: u32,
    /// True if the line's move ends with this block (an arc has many).
    pub ends_move: bool,
    /// Moves that end inside the block, if several were merged.
    pub inner_ends: InnerEnds,
}

impl Block {
    /// Content of an unused place.
    pub(crate) const NONE: Self = Self {
        steps: [0; 3],
        extruder_256ths: 0,
        length_10nm: 0,
        nominal: Speed::ZERO,
        acceleration: Acceleration(1),
        line: 0,
        ends_move: false,
        inner_ends: InnerEnds::NONE,
    };

    /// Copies the other block. Its inner ends are copied only if there are any: they are most of a
    /// block, and few blocks have them.
    #[inline(always)]
    pub(crate) fn become_block(&mut self, other: &Self) {
        let Self { steps, extruder_256ths, length_10nm, nominal, acceleration, line, ends_move, inner_ends } = self;
        *steps = other.steps;
        *extruder_256ths = other.extruder_256ths;
        *length_10nm = other.length_10nm;
        *nominal = other.nominal;
        *acceleration = other.acceleration;
        *line = other.line;
        *ends_move = other.ends_move;
        if other.inner_ends.is_empty() {
            inner_ends.clear();
        } else {
            *inner_ends = other.inner_ends;
        }
    }

    /// Path length, mm.
    pub fn length_mm(&self) -> f64 {
        f64::from(self.length_10nm) / UNITS_PER_MM as f64
    }

    /// 2 a S in units of [`SquaredSpeed`], below 2^63.
    pub(crate) fn reach(&self) -> u64 {
        u64::from(self.acceleration.0) * u64::from(self.length_10nm)
    }

    /// Number of step events: those of the motor with most steps; the others step with it.
    pub fn master_steps(&self) -> u32 {
        self.steps.iter().fold(0, |most, steps| steps.unsigned_abs().max(most))
    }
}

/// A block whose end speeds are final.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedBlock {
    /// The move.
    pub block: Block,
    /// Speed at the block's start.
    pub entry: Speed,
    /// Speed at the block's end.
    pub exit: Speed,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Units of a squared speed, in 128 bits.
    fn units(speed: u64) -> u64 {
        ((u128::from(speed) * u128::from(speed) * 12_800_000 + u128::from(u32::MAX)) >> 32) as u64
    }

    proptest! {
        #[test]
        fn a_square_has_its_root(speed in prop_oneof![0u32..100_000, 100_000u32..40_000_000, any::<u32>()]) {
            let squared = SquaredSpeed::from(Speed(speed));
            prop_assert_eq!(squared.0, units(u64::from(speed)));
            let root = squared.root();
            // Below 0.003 mm/s several speeds have the same square; the root is always the same one
            // of them.
            prop_assert!(root.0 >= speed && units(u64::from(root.0)) == squared.0);
            prop_assert!(root.0 == speed || speed < 200);
        }

        #[test]
        fn a_root_is_the_largest_speed_that_is_not_above(units_of_square in 0u64..1 << 56) {
            let root = SquaredSpeed(units_of_square).root();
            prop_assert!(units(u64::from(root.0)) <= units_of_square);
            prop_assert!(root.0 == u32::MAX || units(u64::from(root.0) + 1) > units_of_square);
        }
    }

    #[test]
    fn the_ends_of_the_range_have_roots() {
        assert_eq!(SquaredSpeed(u64::MAX).root(), Speed(u32::MAX));
        assert_eq!(SquaredSpeed::ZERO.root(), Speed::ZERO);
    }
}
