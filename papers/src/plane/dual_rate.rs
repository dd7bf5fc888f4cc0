//! Dual-rate interpolation (CoreXY paper, the improved method of section 2.3).

use super::target::{PlaneError, Target};
use ferrostep_planner::DualRatePeriods;

/// Converts periods T_min and T_max from microseconds, to the nearest nanosecond.
///
/// # Errors
/// [`PlaneError::NoPeriod`] for a number of nanoseconds that is not from 1 to 2^32 - 1,
/// [`PlaneError::PeriodsReversed`].
pub fn periods_from_us(shortest_us: f64, longest_us: f64) -> Result<DualRatePeriods, PlaneError> {
    let [shortest_ns, longest_ns] = [shortest_us, longest_us].map(|us| {
        let ns = us * 1e3 + 0.5;
        // NaN fails every range check.
        if (1.0..4_294_967_296.0).contains(&ns) { ns as u32 } else { 0 }
    });
    let periods = DualRatePeriods { shortest_ns, longest_ns };
    check(&periods)?;
    Ok(periods)
}

/// Checks that the periods are in range.
fn check(periods: &DualRatePeriods) -> Result<(), PlaneError> {
    if periods.shortest_ns == 0 || periods.longest_ns == 0 {
        return Err(PlaneError::NoPeriod);
    }
    if periods.longest_ns < periods.shortest_ns { Err(PlaneError::PeriodsReversed) } else { Ok(()) }
}

/// Returns true if the motor with fewer pulses would be slower than T_max while the other is at
/// T_min, because |A| : |B| is beyond T_max / T_min (the paper's eq. 8), or if it does not turn at
/// all.
pub(crate) fn is_dead_zone(periods: &DualRatePeriods, one: u32, other: u32) -> bool {
    let (more, fewer) = (one.max(other), one.min(other));
    // T_more = T_min, and |A| T_1 = |B| T_2.
    u64::from(more) * u64::from(periods.shortest_ns) > u64::from(fewer) * u64::from(periods.longest_ns)
}

/// A line of two motors, each at its own rate.
#[derive(Clone, Copy, Debug)]
pub enum DualRate {
    /// Each motor has its own period.
    TwoRates(TwoRates),
    /// One motor would be too slow; the paper falls back to [`super::MinimumDeviation`].
    DeadZone,
}

impl DualRate {
    /// Creates the line on which the motors make these numbers of pulses, in either direction.
    ///
    /// # Errors
    /// [`PlaneError`]; errors of the periods come before those of the line.
    pub fn new(first: i64, second: i64, periods: &DualRatePeriods) -> Result<Self, PlaneError> {
        check(periods)?;
        let target = Target::new(first, second)?;
        let [first, second] = target.magnitudes;
        if is_dead_zone(periods, first, second) {
            return Ok(Self::DeadZone);
        }
        Ok(Self::TwoRates(TwoRates { target, made: [0; 2], shortest_ns: periods.shortest_ns }))
    }
}

/// Pulses of two motors that start and end together, each at a constant period: |A| T_1 = |B| T_2.
///
/// The motor with more pulses runs at T_min. Pulse k of N is due at (k - 1/2) D / N, with D the
/// duration: the paper does not say where in its period a pulse is. With pulses in the middle of
/// their periods, each motor is within half a pulse of the line at every instant; at the end,
/// within one. Pulses due together are one event.
#[derive(Clone, Copy, Debug)]
pub struct TwoRates {
    target: Target,
    made: [u32; 2],
    shortest_ns: u32,
}

impl TwoRates {
    /// Duration of the line, ns: the larger number of pulses at T_min.
    pub fn duration_ns(&self) -> u64 {
        let [first, second] = self.target.magnitudes;
        u64::from(first.max(second)) * u64::from(self.shortest_ns)
    }

    /// Pulse period of each motor, ns.
    pub fn periods_ns(&self) -> [f64; 2] {
        // Both motors have pulses: otherwise the line would be in the dead zone.
        self.target.magnitudes.map(|pulses| self.duration_ns() as f64 / f64::from(pulses))
    }
}

impl Iterator for TwoRates {
    /// Step of each motor, -1, 0 or 1, not both 0.
    type Item = [i8; 2];

    fn next(&mut self) -> Option<[i8; 2]> {
        let [first, second] = self.target.magnitudes;
        // The next pulse k of N is due at (2k - 1) / 2N of the duration; compared crosswise,
        // without a division.
        let due = |made: u32, other: u32| (2 * u64::from(made) + 1) * u64::from(other);
        let (first_due, second_due) = (due(self.made[0], second), due(self.made[1], first));
        if self.made == [first, second] {
            return None;
        }
        let steps = [first_due <= second_due, second_due <= first_due];
        for (made, steps) in self.made.iter_mut().zip(steps) {
            *made += u32::from(steps);
        }
        let [first_sign, second_sign] = self.target.signs;
        Some([i8::from(steps[0]) * first_sign, i8::from(steps[1]) * second_sign])
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ferrostep_planner::bresenham::MAX_STEPS;
    use proptest::prelude::*;

    fn two_rates(first: i64, second: i64, periods: &DualRatePeriods) -> TwoRates {
        match DualRate::new(first, second, periods).unwrap() {
            DualRate::TwoRates(line) => line,
            DualRate::DeadZone => panic!("dead zone"),
        }
    }

    #[test]
    fn the_worked_example() {
        // Line from (11.3, -8.4) to (12.5, -8.7) in pulses of 0.01 mm: X = 120, Y = -30, so A = X +
        // Y and B = X - Y.
        let periods = periods_from_us(500.0, 2_500.0).unwrap();
        let line = two_rates(120 - 30, 120 + 30, &periods);
        assert_eq!(line.target.magnitudes, [90, 150]);
        assert_eq!(line.target.signs, [1, 1]);
        let [first_ns, second_ns] = line.periods_ns();
        assert!((first_ns - 833_333.3).abs() < 0.1 && second_ns == 500_000.0);
        assert_eq!(line.duration_ns(), 75_000_000);
        assert_eq!(line.fold([0; 2], |sum, [a, b]| [sum[0] + i32::from(a), sum[1] + i32::from(b)]), [90, 150]);
    }

    #[test]
    fn the_dead_zone_begins_beyond_the_ratio_of_the_periods() {
        let periods = periods_from_us(500.0, 2_500.0).unwrap();
        assert!(matches!(DualRate::new(500, -100, &periods), Ok(DualRate::TwoRates(_))));
        assert!(matches!(DualRate::new(501, -100, &periods), Ok(DualRate::DeadZone)));
        assert!(matches!(DualRate::new(0, 7, &periods), Ok(DualRate::DeadZone)));
    }

    #[test]
    fn bad_periods_are_refused() {
        for bad in [0.0, -1.0, 0.000_1, f64::NAN, f64::INFINITY, 1e10] {
            assert_eq!(periods_from_us(bad, 3_000.0), Err(PlaneError::NoPeriod), "{bad}");
            assert_eq!(periods_from_us(10.0, bad), Err(PlaneError::NoPeriod), "{bad}");
        }
        assert_eq!(periods_from_us(10.0, 9.0), Err(PlaneError::PeriodsReversed));
        assert!(periods_from_us(10.0, 10.0).is_ok());
        let reversed = DualRatePeriods { shortest_ns: 2, longest_ns: 1 };
        assert_eq!(DualRate::new(1, 1, &reversed).err(), Some(PlaneError::PeriodsReversed));
        let none = DualRatePeriods { shortest_ns: 0, longest_ns: 0 };
        assert_eq!(DualRate::new(0, 0, &none).err(), Some(PlaneError::NoPeriod));
        assert_eq!(DualRate::new(0, 0, &periods_from_us(1.0, 2.0).unwrap()).err(), Some(PlaneError::NoLength));
        for far in [1 << 31, -(1 << 31), i64::MIN, i64::MAX] {
            let periods = DualRatePeriods { shortest_ns: u32::MAX, longest_ns: u32::MAX };
            assert_eq!(DualRate::new(far, 1, &periods).err(), Some(PlaneError::TooLong));
        }
        let slowest = DualRatePeriods { shortest_ns: u32::MAX, longest_ns: u32::MAX };
        let longest = i64::from(MAX_STEPS);
        assert_eq!(two_rates(longest, -longest, &slowest).take(1_000).count(), 1_000);
    }

    proptest! {
        #[test]
        fn both_motors_keep_their_ratio(first in -3_000i64..3_000, second in -3_000i64..3_000) {
            prop_assume!(first != 0 && second != 0);
            let line = two_rates(first, second, &DualRatePeriods { shortest_ns: 1, longest_ns: 4_000 });
            let mut made = [0i64; 2];
            let mut count = 0;
            for [a, b] in line {
                prop_assert!((a, b) != (0, 0));
                made = [made[0] + i64::from(a), made[1] + i64::from(b)];
                count += i64::from(a.abs()) + i64::from(b.abs());
                // Half a pulse of each motor: |a B - b A| <= (|A| + |B|) / 2, so within one pulse
                // of either.
                let off = (made[0] * second - made[1] * first).abs();
                prop_assert!(2 * off <= first.abs() + second.abs(), "{:?}", made);
                prop_assert!(off <= first.abs().max(second.abs()));
            }
            prop_assert_eq!(made, [first, second]);
            prop_assert_eq!(count, first.abs() + second.abs());
        }
    }
}
