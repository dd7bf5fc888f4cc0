//! Conversion of machine coordinates to motor steps: [the motors of each axis](LinearKinematics),
//! and the length of a step.

mod cartesian;
mod core_xy;
mod core_xz;
mod kinds;
mod linear;

use core::fmt;
use core::num::{NonZeroU32, Wrapping};

use crate::division::Divisor;
use crate::units::UNITS_PER_256TH;

pub use cartesian::Cartesian;
pub use core_xy::CoreXy;
pub use core_xz::CoreXz;
pub use kinds::Kinematics;
pub use linear::{Length, LinearKinematics};

pub use crate::units::UNITS_PER_MM;

/// Largest coordinate, either sign, units of 10 nm: 5 m. It keeps every product below, and the time
/// of a slow move, within 64 bits.
pub const MAX_COORDINATE_10NM: i64 = 5_000 * UNITS_PER_MM;

/// Units of [`StepsPerMm`] times 10 nm in a step.
const UNIT: u64 = UNITS_PER_MM as u64 * 100_000;

/// A position with coordinates within [`MAX_COORDINATE_10NM`]; `None` if one is not.
#[inline(always)]
pub(crate) fn narrow(position_10nm: [i64; 3]) -> Option<[i32; 3]> {
    let near = position_10nm.map(|coordinate| coordinate as i32);
    let [x, y, z] = near;
    let within = |wide: i64, near: i32| i64::from(near) == wide && Coordinate::new(near).is_some();
    let [wide_x, wide_y, wide_z] = position_10nm;
    (within(wide_x, x) && within(wide_y, y) && within(wide_z, z)).then_some(near)
}

/// A machine coordinate of at most [`MAX_COORDINATE_10NM`] either way, units of 10 nm: a value of
/// this type needs no second check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coordinate(i32);

impl Coordinate {
    /// Coordinate of this value; `None` if it is too large.
    #[inline(always)]
    pub const fn new(coordinate_10nm: i32) -> Option<Self> {
        // Shifts the range from -most to most so that it begins at zero.
        const MOST: u32 = MAX_COORDINATE_10NM as u32;
        let is_near = coordinate_10nm.cast_unsigned().wrapping_add(MOST) <= 2 * MOST;
        if is_near { Some(Self(coordinate_10nm)) } else { None }
    }

    /// Coordinate moved by `by_10nm`; `None` if it is too large.
    #[inline(always)]
    pub const fn advanced(self, by_10nm: i32) -> Option<Self> {
        // A sum that wraps is too large as well: it exceeds 2^31 - 5 * 10^8 either way.
        Self::new(self.0.wrapping_add(by_10nm))
    }

    /// The coordinate, units of 10 nm.
    #[inline(always)]
    pub const fn units(self) -> i32 {
        self.0
    }
}

/// Steps per mm, exact to five decimals, above 0 and at most 10,000.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct StepsPerMm {
    hundred_thousandths: i64,
    /// The value in steps per unit of 10 nm.
    steps_per_10nm: Fraction,
    /// The value in 1/256 steps per unit of filament.
    of_filament: Fraction,
}

/// A fraction in its lowest terms, both of 32 bits; 0 / 1 if they need more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fraction {
    pub(crate) numerator: u32,
    pub(crate) denominator: NonZeroU32,
}

impl Fraction {
    const fn new(numerator: u64, denominator: u64) -> Self {
        let (mut divisor, mut rest) = (denominator, numerator);
        while rest != 0 {
            (divisor, rest) = (rest, divisor % rest);
        }
        const NONE: Fraction = Fraction { numerator: 0, denominator: NonZeroU32::MIN };
        if divisor == 0 || numerator / divisor > u32::MAX as u64 || denominator / divisor > u32::MAX as u64 {
            return NONE;
        }
        match NonZeroU32::new((denominator / divisor) as u32) {
            Some(denominator) => Self { numerator: (numerator / divisor) as u32, denominator },
            None => NONE,
        }
    }

    /// True if the fraction is set.
    pub(crate) fn is_some(self) -> bool {
        self.numerator != 0
    }

    /// Product of a whole number and the fraction, if it [is set](Self::is_some), rounded to the
    /// nearest whole number, halves up. `None` if the product exceeds 32 bits, the processor's
    /// limit for division.
    #[inline(always)]
    fn rounded(self, number: u32) -> Option<u32> {
        let product = u64::from(number) * u64::from(self.numerator) + u64::from(self.denominator.get() / 2);
        // Half of an odd denominator is not a whole number: 2 (p + half) is then odd too, and never
        // a multiple.
        let product = u32::try_from(product).ok()?;
        Some(product / self.denominator)
    }
}

impl fmt::Debug for StepsPerMm {
    /// Writes a Rust expression: the image's profile is compiled from it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "StepsPerMm::clamped({})", self.hundred_thousandths)
    }
}

impl StepsPerMm {
    /// The nearest value with five decimals; `None` outside 0.00001 to 10,000.
    pub fn from_f64(steps_per_mm: f64) -> Option<Self> {
        let scaled = steps_per_mm * 100_000.0 + 0.5;
        // NaN is in no range.
        (1.0..1e9 + 1.0).contains(&scaled).then(|| Self::nearest(steps_per_mm))
    }

    /// Nearest possible value with five decimals: values outside 0.00001 to 10,000 become these
    /// ends, NaN the lower.
    pub fn nearest(steps_per_mm: f64) -> Self {
        Self::clamped((steps_per_mm * 100_000.0 + 0.5) as i64)
    }

    /// The value in units of 1e-5 steps/mm, clamped to 1 to 1,000,000,000.
    pub const fn clamped(hundred_thousandths: i64) -> Self {
        match hundred_thousandths {
            ..1 => Self::of(1),
            1..=1_000_000_000 => Self::of(hundred_thousandths),
            _ => Self::of(1_000_000_000),
        }
    }

    const fn of(hundred_thousandths: i64) -> Self {
        let numerator = hundred_thousandths.unsigned_abs();
        Self {
            hundred_thousandths,
            steps_per_10nm: Fraction::new(numerator, UNIT),
            of_filament: Fraction::new(numerator, UNITS_PER_256TH),
        }
    }

    /// The value in 1/256 steps per unit of filament.
    #[inline]
    pub(crate) fn of_filament(self) -> Fraction {
        self.of_filament
    }

    /// The value, steps/mm.
    pub fn to_f64(self) -> f64 {
        self.hundred_thousandths as f64 / 100_000.0
    }

    /// The value in units of 1e-5 steps/mm.
    pub const fn hundred_thousandths(self) -> i64 {
        self.hundred_thousandths
    }

    /// The motor position for a coordinate of at most twice [`MAX_COORDINATE_10NM`]: the exact
    /// product, rounded half away from zero.
    pub fn steps(self, coordinate_10nm: i64) -> i32 {
        let limit = 2 * MAX_COORDINATE_10NM;
        self.steps_of_near(coordinate_10nm.clamp(-limit, limit) as i32)
    }

    /// Version of [`Self::steps`] for a coordinate known to be in range.
    #[inline(always)]
    pub(crate) fn steps_of_near(&self, coordinate_10nm: i32) -> i32 {
        let near = if self.steps_per_10nm.is_some() { self.steps_if_near(coordinate_10nm) } else { None };
        near.unwrap_or_else(|| self.steps_of_far(coordinate_10nm))
    }

    /// Version using hardware division, which suffices on any printer; `None` if it does not.
    #[inline(always)]
    fn steps_if_near(&self, coordinate_10nm: i32) -> Option<i32> {
        let magnitude = self.steps_per_10nm.rounded(coordinate_10nm.unsigned_abs())? as i32;
        Some(if coordinate_10nm < 0 { magnitude.wrapping_neg() } else { magnitude })
    }

    #[inline(never)]
    fn steps_of_far(&self, coordinate: i32) -> i32 {
        const BY_UNIT: Divisor = Divisor::new(UNIT);
        // |product| <= 1e9 * 1e9, in range of i64; the quotient, at most 1e8, is in range of i32.
        // Both factors have 32 bits.
        let scale = self.hundred_thousandths as i32;
        let product = i64::from(coordinate) * i64::from(scale);
        let (magnitude, _) = BY_UNIT.divide(product.unsigned_abs() + UNIT / 2);
        if product < 0 { -(magnitude as i32) } else { magnitude as i32 }
    }

    /// Largest whole number of units of 10 nm in a step.
    pub fn step_10nm(&self) -> i64 {
        let Fraction { numerator, denominator } = self.steps_per_10nm;
        match denominator.get().checked_div(numerator) {
            Some(length) => length.into(),
            None => UNIT as i64 / self.hundred_thousandths.max(1),
        }
    }

    /// The coordinate in units of 10 nm nearest to a motor position.
    pub fn coordinate_10nm(self, steps: i64) -> i64 {
        match self.near_coordinate_10nm(steps) {
            Some(coordinate) => coordinate,
            None => self.far_coordinate_10nm(steps),
        }
    }

    /// Version with one hardware division, which takes 32 bits. Below 5.4 m four roundings in
    /// double precision are off by less than 2^-21; a quotient by less than 2^20 that is not a half
    /// is further than that from the nearest half.
    #[inline(always)]
    fn near_coordinate_10nm(&self, steps: i64) -> Option<i64> {
        let Fraction { numerator, denominator } = self.steps_per_10nm;
        let steps = i32::try_from(steps).ok()?;
        let product = steps.unsigned_abs().checked_mul(denominator.get())?;
        let quotient = product.checked_div(numerator)?;
        let rest = product.wrapping_sub(quotient.wrapping_mul(numerator));
        if numerator >> 20 != 0 || quotient >> 29 != 0 || 2 * rest == numerator {
            return None;
        }
        let magnitude = i64::from(quotient + u32::from(2 * rest > numerator));
        Some(if steps < 0 { -magnitude } else { magnitude })
    }

    #[inline(never)]
    fn far_coordinate_10nm(&self, steps: i64) -> i64 {
        let exact = steps as f64 / self.to_f64() * UNITS_PER_MM as f64;
        round_half_away(exact)
    }
}

/// Nearest integer, halves away from zero; saturates at the range of i64.
pub fn round_half_away(x: f64) -> i64 {
    (if x < 0.0 { x - 0.5 } else { x + 0.5 }) as i64
}

/// A machine's motors and their step lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Relation between motors and axes.
    pub kinematics: Kinematics,
    /// Steps/mm of the motors that the board names X, Y and Z, and of the extruder.
    pub steps_per_mm: [StepsPerMm; 4],
    /// Distance below which step events join, ticks; also the minimum interval of any motor.
    pub minimum_event_interval_ticks: u32,
    /// Processor time of a step event, ticks, scaled up by the share of the processor that motion
    /// gets: a block takes at least this long for each of its events. 0 if steps cost nothing.
    pub event_cost_ticks: u32,
    /// Processor time of a move, from its line to its last step, without its events, ticks.
    pub move_cost_ticks: u32,
}

impl Geometry {
    /// Steps of the X, Y and Z motors at a machine position in units of 10 nm: each is the exact
    /// product of its coordinate with its steps/mm, rounded half away from zero.
    pub fn motor_steps(&self, position_10nm: [i64; 3]) -> [i32; 3] {
        let [first, second, third] = self.kinematics.motors(position_10nm);
        let [steps_x, steps_y, steps_z, _] = self.steps_per_mm;
        [steps_x.steps(first), steps_y.steps(second), steps_z.steps(third)]
    }

    /// Version of [`Self::motor_steps`] for a known other position and its motors: an unchanged
    /// third motor is not computed again. Both positions must be within [`MAX_COORDINATE_10NM`].
    #[inline(always)]
    pub(crate) fn motor_steps_from(
        &self,
        position_10nm: [i32; 3],
        other_10nm: [i32; 3],
        other_steps: [i32; 3],
    ) -> [i32; 3] {
        let [first, second, third] = self.kinematics.motors(position_10nm.map(Wrapping));
        let [.., other_third] = self.kinematics.motors(other_10nm.map(Wrapping));
        let [.., other_third_steps] = other_steps;
        let [steps_x, steps_y, steps_z, _] = &self.steps_per_mm;
        let third_steps = if third == other_third { other_third_steps } else { steps_z.steps_of_near(third.0) };
        [steps_x.steps_of_near(first.0), steps_y.steps_of_near(second.0), third_steps]
    }

    /// Machine position nearest to that of the motors, units of 10 nm.
    pub fn position_10nm(&self, motor_steps: [i64; 3]) -> [i64; 3] {
        let [first, second, third] = motor_steps;
        let [steps_x, steps_y, steps_z, _] = self.steps_per_mm;
        self.kinematics.position([
            steps_x.coordinate_10nm(first),
            steps_y.coordinate_10nm(second),
            steps_z.coordinate_10nm(third),
        ])
    }
}

#[cfg(test)]
mod tests;
