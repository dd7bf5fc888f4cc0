//! From machine coordinates to motor steps.

use core::fmt;
use core::num::NonZeroU32;

use crate::division::Divisor;

/// Units of 10 nm in a millimetre.
pub const UNITS_PER_MM: i64 = 100_000;

/// Largest coordinate, either sign, in units of 10 nm: 5 m. Keeps every product below, and the time of a slow
/// move, in 64 bits.
pub const MAX_COORDINATE_10NM: i64 = 5_000 * UNITS_PER_MM;

/// Units of [`StepsPerMm`] times 10 nm in a step.
const UNIT: u64 = UNITS_PER_MM as u64 * 100_000;

/// A position of coordinates within [`MAX_COORDINATE_10NM`]; `None` if one is not.
#[inline(always)]
pub(crate) fn narrow(position_10nm: [i64; 3]) -> Option<[i32; 3]> {
    let near = position_10nm.map(|coordinate| coordinate as i32);
    let [x, y, z] = near;
    let within = |wide: i64, near: i32| i64::from(near) == wide && Coordinate::new(near).is_some();
    let [wide_x, wide_y, wide_z] = position_10nm;
    (within(wide_x, x) && within(wide_y, y) && within(wide_z, z)).then_some(near)
}

/// A machine coordinate of at most [`MAX_COORDINATE_10NM`] either way, units of 10 nm: whoever has one need not look again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coordinate(i32);

impl Coordinate {
    /// The coordinate; `None` where it is too large.
    #[inline(always)]
    pub const fn new(coordinate_10nm: i32) -> Option<Self> {
        // From -most to most, moved to begin at zero.
        const MOST: u32 = MAX_COORDINATE_10NM as u32;
        let is_near = coordinate_10nm.cast_unsigned().wrapping_add(MOST) <= 2 * MOST;
        if is_near { Some(Self(coordinate_10nm)) } else { None }
    }

    /// The coordinate so much further; `None` where it is too large.
    #[inline(always)]
    pub const fn advanced(self, by_10nm: i32) -> Option<Self> {
        // A sum that wraps is too large, too: it is more than 2^31 - 5 * 10^8 either way.
        Self::new(self.0.wrapping_add(by_10nm))
    }

    /// Units of 10 nm.
    #[inline(always)]
    pub const fn units(self) -> i32 {
        self.0
    }
}

/// How X and Y are driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kinematics {
    /// One motor an axis.
    Cartesian,
    /// Two fixed motors, both driving both axes: A = X + Y, B = X - Y.
    CoreXy,
}

/// Steps a millimetre, exact to five decimals, above 0 and at most 10,000.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct StepsPerMm {
    hundred_thousandths: i64,
    /// The value in steps per unit of 10 nm.
    steps_per_10nm: Fraction,
    /// The value in 1/256 steps per unit of filament.
    of_filament: Fraction,
}

/// A fraction in its lowest terms, both of 32 bits; 0 / 1 where they have more.
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

    /// Whether it is one.
    pub(crate) fn is_some(self) -> bool {
        self.numerator != 0
    }

    /// A whole number times the fraction, if it [is one](Self::is_some), rounded to the nearest whole number; of two the
    /// larger. `None` where the product leaves 32 bits: the processor divides no more.
    #[inline(always)]
    fn rounded(self, number: u32) -> Option<u32> {
        let product = u64::from(number) * u64::from(self.numerator) + u64::from(self.denominator.get() / 2);
        // Of an odd denominator half is no whole number: 2 (p + half) is odd too, and never a multiple.
        let product = u32::try_from(product).ok()?;
        Some(product / self.denominator)
    }
}

impl fmt::Debug for StepsPerMm {
    /// As an expression: the image's profile is compiled from it.
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

    /// The nearest value with five decimals that there is: values outside 0.00001 to 10,000 become these ends, NaN the lower.
    pub fn nearest(steps_per_mm: f64) -> Self {
        Self::clamped((steps_per_mm * 100_000.0 + 0.5) as i64)
    }

    /// The value in units of 1e-5 steps/mm, 1 to 1,000,000,000; values outside become these ends.
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
            of_filament: Fraction::new(numerator, crate::extruder::UNITS_PER_256TH),
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

    /// The motor position for a coordinate of at most twice [`MAX_COORDINATE_10NM`]: the exact product, rounded half
    /// away from zero.
    pub fn steps(self, coordinate_10nm: i64) -> i32 {
        let limit = 2 * MAX_COORDINATE_10NM;
        self.steps_of_near(coordinate_10nm.clamp(-limit, limit) as i32)
    }

    /// The same for a coordinate that is known to be no larger.
    #[inline(always)]
    pub(crate) fn steps_of_near(&self, coordinate_10nm: i32) -> i32 {
        let near = if self.steps_per_10nm.is_some() { self.steps_if_near(coordinate_10nm) } else { None };
        near.unwrap_or_else(|| self.steps_of_far(coordinate_10nm))
    }

    /// The same where the processor can divide, as it can on any printer; `None` elsewhere.
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

    /// The same by one division of the processor, which takes 32 bits. Below 5.4 m four roundings in double precision are
    /// off by less than 2^-21; a quotient by less than 2^20 that is no half is further from the nearest half.
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

/// Which motors a machine has and how far a step goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// How X and Y are driven.
    pub kinematics: Kinematics,
    /// Steps/mm of X, Y, Z and the extruder (CoreXY: of the motors A and B for X and Y).
    pub steps_per_mm: [StepsPerMm; 4],
    /// Step events nearer than this join, in ticks; also the shortest interval of any motor.
    pub minimum_event_interval_ticks: u32,
    /// Processor time that a step event costs, in ticks, drawn out by the share of the processor that motion gets: a
    /// block takes at least this long for each of its events. 0 where steps cost nothing.
    pub event_cost_ticks: u32,
    /// The same for each move, from its line to its last step, its events not counted.
    pub move_cost_ticks: u32,
}

impl Geometry {
    /// Where the X, Y and Z motors stand for a machine position in units of 10 nm.
    ///
    /// CoreXY: A = round((x + y) s), B = round((x - y) s).
    pub fn motor_steps(&self, position_10nm: [i64; 3]) -> [i32; 3] {
        let [x, y, z] = position_10nm;
        let [steps_x, steps_y, steps_z, _] = self.steps_per_mm;
        match self.kinematics {
            Kinematics::Cartesian => [steps_x.steps(x), steps_y.steps(y), steps_z.steps(z)],
            Kinematics::CoreXy => [steps_x.steps(x + y), steps_y.steps(x - y), steps_z.steps(z)],
        }
    }

    /// The same, where another position and its motors are known: what is the same there is not worked out again.
    /// Both are within [`MAX_COORDINATE_10NM`].
    #[inline(always)]
    pub(crate) fn motor_steps_from(
        &self,
        position_10nm: [i32; 3],
        other_10nm: [i32; 3],
        other_steps: [i32; 3],
    ) -> [i32; 3] {
        let [x, y, z] = position_10nm;
        let [.., other_z] = other_10nm;
        let [.., other_z_steps] = other_steps;
        let [steps_x, steps_y, steps_z, _] = &self.steps_per_mm;
        let z_steps = if z == other_z { other_z_steps } else { steps_z.steps_of_near(z) };
        let [first, second] = self.of_motors(x, y);
        [steps_x.steps_of_near(first), steps_y.steps_of_near(second), z_steps]
    }

    /// What the motors of X and Y make steps of: sums of two coordinates are below 2^30.
    #[inline(always)]
    fn of_motors(&self, x_10nm: i32, y_10nm: i32) -> [i32; 2] {
        match self.kinematics {
            Kinematics::Cartesian => [x_10nm, y_10nm],
            Kinematics::CoreXy => [x_10nm.wrapping_add(y_10nm), x_10nm.wrapping_sub(y_10nm)],
        }
    }

    /// The machine position, in units of 10 nm, nearest to where the motors stand.
    pub fn position_10nm(&self, motor_steps: [i64; 3]) -> [i64; 3] {
        let [steps_x, steps_y, steps_z, _] = self.steps_per_mm;
        let first = steps_x.coordinate_10nm(motor_steps[0]);
        let second = steps_y.coordinate_10nm(motor_steps[1]);
        let z = steps_z.coordinate_10nm(motor_steps[2]);
        match self.kinematics {
            Kinematics::Cartesian => [first, second, z],
            Kinematics::CoreXy => [(first + second) / 2, (first - second) / 2, z],
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    fn steps(value: f64) -> StepsPerMm {
        StepsPerMm::from_f64(value).unwrap()
    }

    fn geometry(kinematics: Kinematics) -> Geometry {
        Geometry {
            kinematics,
            steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(95.0)],
            minimum_event_interval_ticks: 168,
            event_cost_ticks: 0,
            move_cost_ticks: 0,
        }
    }

    #[test]
    fn halves_round_away_from_zero() {
        // 0.00625 mm is half a step at 80 steps/mm.
        assert_eq!(steps(80.0).steps(625), 1);
        assert_eq!(steps(80.0).steps(-625), -1);
        assert_eq!(steps(80.0).steps(624), 0);
        assert_eq!(steps(80.0).steps(-624), 0);
    }

    #[test]
    fn steps_per_mm_outside_their_range_are_refused() {
        for bad in [0.0, -1.0, 0.000_001, 10_001.0, f64::NAN, f64::INFINITY] {
            assert_eq!(StepsPerMm::from_f64(bad), None, "{bad}");
        }
        assert_eq!(steps(415.305).hundred_thousandths(), 41_530_500);
        assert_eq!(StepsPerMm::clamped(41_530_500), steps(415.305));
        for (outside, end) in
            [(0, 1), (-1, 1), (i64::MIN, 1), (1_000_000_001, 1_000_000_000), (i64::MAX, 1_000_000_000)]
        {
            assert_eq!(StepsPerMm::clamped(outside).hundred_thousandths(), end);
        }
        assert_eq!(StepsPerMm::nearest(f64::NAN).hundred_thousandths(), 1);
    }

    #[test]
    fn core_xy_turns_both_motors_for_either_axis() {
        let machine = geometry(Kinematics::CoreXy);
        assert_eq!(machine.motor_steps([1_000_000, 0, 0]), [800, 800, 0]);
        assert_eq!(machine.motor_steps([0, 1_000_000, 0]), [800, -800, 0]);
        // CoreXY paper: X = 120, Y = -30 pulses of 0.01 mm make A = 90, B = 150.
        let paper = Geometry { steps_per_mm: [steps(100.0), steps(100.0), steps(400.0), steps(95.0)], ..machine };
        assert_eq!(paper.motor_steps([120_000, -30_000, 0]), [90, 150, 0]);
    }

    proptest! {
        #[test]
        fn the_product_is_exact(
            coordinate in prop_oneof![-MAX_COORDINATE_10NM..=MAX_COORDINATE_10NM, (-800_000i64..800_000).prop_map(|steps| steps * 625)],
            scaled in prop_oneof![1i64..=1_000_000_000, (1i64..=10_000).prop_map(|steps| steps * 100_000), Just(8_000_000), Just(41_530_500)],
        ) {
            let value = StepsPerMm::of(scaled);
            let product = i128::from(coordinate) * i128::from(scaled);
            let half = 5_000_000_000i128;
            let expected = if product < 0 { -((-product + half) / (2 * half)) } else { (product + half) / (2 * half) };
            prop_assert_eq!(i128::from(value.steps(coordinate)), expected);
        }

        #[test]
        fn coordinates_are_those_of_double_precision(
            steps in prop_oneof![-50_000_000i64..50_000_000, -200_000i64..200_000, any::<i32>().prop_map(i64::from)],
            scaled in prop_oneof![
                1i64..=1_000_000_000,
                (1i64..=10_000).prop_map(|steps| steps * 100_000),
                (1i64..=10_000).prop_map(|steps| steps * 3_125),
                Just(8_000_000), Just(9_500_000), Just(41_530_500), Just(800_000_000),
            ],
        ) {
            let value = StepsPerMm::of(scaled);
            prop_assert_eq!(value.coordinate_10nm(steps), value.far_coordinate_10nm(steps));
            prop_assert_eq!(value.step_10nm(), 10_000_000_000 / scaled);
        }

        #[test]
        fn positions_come_back_within_half_a_step(x in -30_000_000i64..30_000_000, y in -30_000_000i64..30_000_000, core in any::<bool>()) {
            let machine = geometry(if core { Kinematics::CoreXy } else { Kinematics::Cartesian });
            let motors = machine.motor_steps([x, y, 0]);
            let back = machine.position_10nm(motors.map(i64::from));
            prop_assert!((back[0] - x).abs() <= 626 && (back[1] - y).abs() <= 626);
        }
    }
}
