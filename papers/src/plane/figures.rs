//! Quality figures of a method's line.

use super::core_xy::{CoreXyLine, LineEvent, PlaneMethod};
use super::target::{PlaneError, Target};
use ferrostep_planner::DualRatePeriods;
use ferrostep_planner::square_root::square_root;

/// Cost and deviation of a line, at the paper's constant periods on a CoreXY machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineFigures {
    /// True if each motor had its own rate.
    pub has_two_rates: bool,
    /// Number of interpolation steps as the paper counts them: pulses along X, Y or a diagonal;
    /// under dual-rate those of the motor that has more.
    pub feeds: u64,
    /// Number of instants at which one or both motors step.
    pub events: u64,
    /// Steps of both motors together.
    pub motor_steps: u64,
    /// Steps of the motor that makes more of them.
    pub busiest_motor_steps: u64,
    /// Number of times that a motor reverses.
    pub reversals: u64,
    /// Largest distance from the ideal line after an event, pulses along X or Y.
    pub largest_distance: f64,
    /// Mean distance from the ideal line over the line's duration, with the motors standing still
    /// between their steps, pulses.
    pub mean_distance: f64,
}

impl LineFigures {
    /// Computes the figures of the line from 0 to (x, y) pulses.
    ///
    /// # Errors
    /// [`PlaneError`]; |x| + |y| is at most 2^28.
    pub fn new(method: PlaneMethod, x: i64, y: i64, periods: &DualRatePeriods) -> Result<Self, PlaneError> {
        let target = Target::new(x, y)?;
        let (first, second) = (x + y, x - y);
        let line = CoreXyLine::new(method, first, second, periods)?;
        let [x_pulses, y_pulses] = target.magnitudes.map(u64::from);
        let has_two_rates = line.has_two_rates();
        let feeds = match method {
            PlaneMethod::PointByPoint => x_pulses + y_pulses,
            PlaneMethod::DualRate if has_two_rates => first.unsigned_abs().max(second.unsigned_abs()),
            PlaneMethod::MinimumDeviation | PlaneMethod::DualRate => x_pulses.max(y_pulses),
        };
        Ok(Self { has_two_rates, ..Self::measured(&target, feeds, line) })
    }

    /// Computes the figures of any events that make the line from 0 to (x, y) pulses.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_events(x: i64, y: i64, events: impl Iterator<Item = LineEvent>) -> Result<Self, PlaneError> {
        let figures = Self::measured(&Target::new(x, y)?, 0, events);
        Ok(Self { feeds: figures.events, ..figures })
    }

    fn measured(target: &Target, feeds: u64, line: impl Iterator<Item = LineEvent>) -> Self {
        let [x, y] = [0, 1].map(|axis| i64::from(target.magnitudes[axis]) * i64::from(target.signs[axis]));
        let mut here = [0i64; 2];
        let mut steps = [0u64; 2];
        let mut last = [0i8; 2];
        let mut reversals = 0;
        let mut events = 0u64;
        let (mut largest, mut sum) = (0u64, 0.0);
        let (mut off, mut since) = (0u64, 0.0);
        for LineEvent { share, steps: event } in line {
            sum += off as f64 * (share - since);
            since = share;
            for motor in 0..2 {
                here[motor] += i64::from(event[motor]);
                steps[motor] += u64::from(event[motor].unsigned_abs());
                if event[motor] != 0 {
                    reversals += u64::from(event[motor] == -last[motor]);
                    last[motor] = event[motor];
                }
            }
            events += 1;
            // The distance is |X y - Y x| / sqrt(X^2 + Y^2); in half pulses the point is whole.
            let [twice_x, twice_y] = [here[0] + here[1], here[0] - here[1]];
            off = (x * twice_y - y * twice_x).unsigned_abs();
            largest = largest.max(off);
        }
        let half_length = 0.5 / square_root((x * x + y * y) as f64);
        Self {
            has_two_rates: false,
            feeds,
            events,
            motor_steps: steps[0] + steps[1],
            busiest_motor_steps: steps[0].max(steps[1]),
            reversals,
            largest_distance: largest as f64 * half_length,
            mean_distance: sum * half_length,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    const PERIODS: DualRatePeriods = DualRatePeriods { shortest_ns: 500_000, longest_ns: 2_500_000 };

    fn figures(method: PlaneMethod, x: i64, y: i64) -> LineFigures {
        LineFigures::new(method, x, y, &PERIODS).unwrap()
    }

    #[test]
    fn a_line_of_few_pulses_by_hand() {
        // (2, 1) by x y x: F is -1, 1, 0 after the pulses, a third of the time each, and the
        // distances |F| / sqrt(5).
        let line = figures(PlaneMethod::PointByPoint, 2, 1);
        assert_eq!((line.feeds, line.events, line.motor_steps, line.busiest_motor_steps), (3, 3, 6, 3));
        // B runs forwards, backwards, forwards.
        assert_eq!(line.reversals, 2);
        assert!((line.largest_distance - 1.0 / 5f64.sqrt()).abs() < 1e-12);
        assert!((line.mean_distance - 2.0 / 3.0 / 5f64.sqrt()).abs() < 1e-12);
        // A diagonal in two halves, then along x: (1/2, 1/2) is 1/2 beside the line, (1, 1) is 1.
        let line = figures(PlaneMethod::MinimumDeviation, 2, 1);
        assert_eq!((line.feeds, line.events, line.motor_steps, line.reversals), (2, 3, 4, 0));
        assert!((line.largest_distance - 1.0 / 5f64.sqrt()).abs() < 1e-12);
        // 1/2 for a quarter of the time, 1 for three eighths.
        assert!((line.mean_distance - 0.5 / 5f64.sqrt()).abs() < 1e-12);
        // A = 3, B = 1: A, both, A.
        let line = figures(PlaneMethod::DualRate, 2, 1);
        assert_eq!((line.feeds, line.events, line.motor_steps, line.has_two_rates), (3, 3, 4, true));
        assert!((line.largest_distance - 0.5 / 5f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_line_is_refused() {
        for method in [PlaneMethod::PointByPoint, PlaneMethod::MinimumDeviation, PlaneMethod::DualRate] {
            assert_eq!(LineFigures::new(method, 0, 0, &PERIODS).err(), Some(PlaneError::NoLength));
            assert_eq!(LineFigures::new(method, 1 << 28, 1, &PERIODS).err(), Some(PlaneError::TooLong));
            assert_eq!(LineFigures::new(method, i64::MIN, 0, &PERIODS).err(), Some(PlaneError::TooLong));
        }
    }

    proptest! {
        #[test]
        fn no_line_is_further_off_than_its_method_allows(x in -2_000i64..2_000, y in -2_000i64..2_000) {
            prop_assume!((x, y) != (0, 0));
            let length = ((x * x + y * y) as f64).sqrt();
            let (longer, shorter) = (x.abs().max(y.abs()) as f64, x.abs().min(y.abs()) as f64);
            let point = figures(PlaneMethod::PointByPoint, x, y);
            prop_assert!(point.largest_distance <= longer / length + 1e-9);
            // Half a pulse across the longer axis, and after half a diagonal half of what
            // that leads away.
            let minimum = figures(PlaneMethod::MinimumDeviation, x, y);
            prop_assert!(minimum.largest_distance <= 0.5 * longer / length + 1e-9);
            // Half a step of either motor, which is half a pulse along both axes: (|A| + |B|) / 4
            // over the length.
            let dual = figures(PlaneMethod::DualRate, x, y);
            let bound = 0.5 * longer / length;
            prop_assert!(dual.largest_distance <= bound + 1e-9, "{} {}", dual.largest_distance, bound);
            for line in [point, minimum, dual] {
                prop_assert!(line.mean_distance <= line.largest_distance);
            }
            // The number of motor pulses is the same under all methods: none of them is faster than
            // another.
            let most = (longer + shorter) as u64;
            prop_assert_eq!([point, minimum, dual].map(|line| line.busiest_motor_steps), [most; 3]);
        }
    }
}
