//! Motion of the motors at the start of a window of time.

use crate::square_root::square_root_f32;
use crate::u64_to_f32::of_i64;

/// A motor that turns this soon, ticks, turns at once.
const SOON_TICKS: f32 = 1.0;

/// Differences of positions below this, 2^-32 step, are the rounding of sums.
const ROUNDING: f32 = 256.0;

/// The shortest window in which a motor's speed is taken to change, ticks.
const SHORTEST_TICKS: u32 = 24;

/// Speed, acceleration and jerk of all motors, in steps and ticks.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorStates {
    pub speed: [f32; 4],
    pub acceleration: [f32; 4],
    pub jerk: [f32; 4],
}

impl MotorStates {
    /// The motion through four places, 2^-32 step: at the start of a window, two times a third of
    /// it later (in whole ticks, the rest of which is left to the last one), and at its end.
    ///
    /// A polynomial of third degree by its divided differences. The second ones are subtracted in
    /// whole numbers: of motors that hardly move beside others nothing is lost.
    #[inline(never)]
    pub fn through(places: &[[i64; 4]; 4], third: u32, ticks: u32) -> Self {
        const STEPS: f32 = 1.0 / (1_u64 << super::fixed::STEP_BITS) as f32;
        let mut states = Self { speed: [0.0; 4], acceleration: [0.0; 4], jerk: [0.0; 4] };
        let (g, last) = (third as f32, ticks.wrapping_sub(2_u32.wrapping_mul(third)));
        let left_over = last.wrapping_sub(third) as f32;
        let (last, whole) = (last as f32, ticks as f32);
        let [start, one, two, end] = places;
        let rates = states.speed.iter_mut().zip(&mut states.acceleration).zip(&mut states.jerk);
        for ((((rates, start), one), two), end) in rates.zip(start).zip(one).zip(two).zip(end) {
            let ((speed, acceleration), jerk) = rates;
            if ticks < SHORTEST_TICKS {
                *speed = of_i64(end.wrapping_sub(*start)) * STEPS / whole;
                continue;
            }
            let (first, middle) = (one.wrapping_sub(*start), two.wrapping_sub(*one));
            let before = of_i64(middle.wrapping_sub(first));
            // Extrapolated as if the last part were as long as the others.
            let rest = i64::from((left_over * (of_i64(middle) / g)) as i32);
            let after = of_i64(end.wrapping_sub(*two).wrapping_sub(middle).wrapping_sub(rest));
            let after = after * (2.0 * g * g / (last * (g + last)));
            let change = after - before;
            let change = if change.abs() < ROUNDING { 0.0 } else { change };
            let before = if change == 0.0 && before.abs() < ROUNDING { 0.0 } else { before };
            // Divided differences of second and third order.
            let second = before * STEPS / (2.0 * g * g);
            let third = change * STEPS / (2.0 * g * g) / whole;
            *speed = of_i64(first) * STEPS / g - g * (second - 2.0 * g * third);
            *acceleration = 2.0 * (second - 3.0 * g * third);
            *jerk = 6.0 * third;
        }
        states
    }

    /// The first time within `ticks` at which a motor turns, or its acceleration, if it
    /// changes, passes zero.
    pub fn first_turn(&self, ticks: f32) -> f32 {
        let mut first = ticks;
        let Self { speed, acceleration, jerk } = self;
        for ((speed, acceleration), jerk) in speed.iter().zip(acceleration).zip(jerk) {
            let mut consider = |time: f32| {
                // NaN is in no range.
                if time > SOON_TICKS && time < first {
                    first = time;
                }
            };
            if *jerk == 0.0 {
                consider(-speed / acceleration);
                continue;
            }
            consider(-acceleration / jerk);
            // speed + acceleration t + jerk t^2 / 2 = 0, by the root without cancellation and the
            // other by their product.
            let under = acceleration * acceleration - 2.0 * jerk * speed;
            if under >= 0.0 {
                let root = square_root_f32(under);
                let sum = -(acceleration + if *acceleration < 0.0 { -root } else { root });
                consider(sum / jerk);
                consider(2.0 * speed / sum);
            }
        }
        first
    }
}
