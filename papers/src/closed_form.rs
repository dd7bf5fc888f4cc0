//! The S-curve in closed form, for figures, tests and comparisons.

use crate::curve_error::{CurveError, MOST, is_in_range, is_zero_or_in_range};
use crate::five_segments::bounds::RampBounds;

/// A ramp between two speeds in two halves of opposite jerk (Li 2017, eqs. 1 to 4). Any unit of
/// length; seconds.
///
/// Li's ramp has no acceleration limit; with one, t1 = max(sqrt(dv/j), dv/a) and the jerk is
/// dv/t1^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    from: f64,
    to: f64,
    half_time_s: f64,
}

/// Path and its derivatives at a point in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Path from the start.
    pub length: f64,
    /// First derivative of the path.
    pub speed: f64,
    /// Second derivative of the path.
    pub acceleration: f64,
}

fn bounds(jerk: f64, acceleration: f64) -> Result<RampBounds, CurveError> {
    if !is_in_range(jerk) {
        return Err(CurveError::Jerk);
    }
    // An infinite acceleration sets no limit.
    if !(is_in_range(acceleration) || acceleration > MOST) {
        return Err(CurveError::Acceleration);
    }
    Ok(RampBounds { jerk, acceleration })
}

fn speeds(speeds: &[f64]) -> Result<(), CurveError> {
    if speeds.iter().all(|&speed| is_zero_or_in_range(speed)) { Ok(()) } else { Err(CurveError::Speed) }
}

impl Ramp {
    /// Creates the ramp between two speeds with this jerk and acceleration limit (infinite for
    /// none).
    ///
    /// # Errors
    /// [`CurveError`] if a number is out of range.
    pub fn new(from: f64, to: f64, jerk: f64, acceleration: f64) -> Result<Self, CurveError> {
        let bounds = bounds(jerk, acceleration)?;
        speeds(&[from, to])?;
        Ok(Self { from, to, half_time_s: bounds.half_time(from, to) })
    }

    /// t1, half the duration of the ramp, s.
    pub fn half_time_s(&self) -> f64 {
        self.half_time_s
    }

    /// Path length of the ramp: (V0 + Vt) t1.
    pub fn length(&self) -> f64 {
        (self.from + self.to) * self.half_time_s
    }

    /// Greatest acceleration, at t1; negative in a deceleration.
    pub fn peak_acceleration(&self) -> f64 {
        if self.half_time_s > 0.0 { (self.to - self.from) / self.half_time_s } else { 0.0 }
    }

    /// Jerk of the first half.
    pub fn jerk(&self) -> f64 {
        if self.half_time_s > 0.0 { self.peak_acceleration() / self.half_time_s } else { 0.0 }
    }

    /// State at a time, s; times outside give the state at the nearer end.
    pub fn at(&self, time_s: f64) -> State {
        let jerk = self.jerk();
        let rest_s = 2.0 * self.half_time_s - time_s;
        if time_s <= 0.0 {
            State { length: 0.0, speed: self.from, acceleration: 0.0 }
        } else if rest_s <= 0.0 {
            State { length: self.length(), speed: self.to, acceleration: 0.0 }
        } else if time_s <= self.half_time_s {
            State {
                length: time_s * (self.from + jerk * time_s * time_s / 6.0),
                speed: self.from + 0.5 * jerk * time_s * time_s,
                acceleration: jerk * time_s,
            }
        } else {
            State {
                length: self.length() - rest_s * (self.to - jerk * rest_s * rest_s / 6.0),
                speed: self.to - 0.5 * jerk * rest_s * rest_s,
                acceleration: jerk * rest_s,
            }
        }
    }
}

/// A ramp, a cruise and a ramp over a length (Li 2017, fig. 1): five segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    up: Ramp,
    down: Ramp,
    cruise_s: f64,
    length: f64,
}

impl Profile {
    /// Creates the curve from `entry` to `exit` over a length, at most at `most` in between.
    /// Without room for that speed there is no cruise, and the peak is the speed at which the two
    /// ramps fill the length. This is Li's case (b), planned anew; the table cuts its ramps off
    /// there while their acceleration is not zero.
    ///
    /// # Errors
    /// [`CurveError`] if a number is out of range, or the length does not even hold a ramp from
    /// `entry` to `exit`.
    pub fn new([entry, most, exit]: [f64; 3], length: f64, jerk: f64, acceleration: f64) -> Result<Self, CurveError> {
        let bounds = bounds(jerk, acceleration)?;
        speeds(&[entry, most, exit])?;
        if !is_zero_or_in_range(length) {
            return Err(CurveError::Length);
        }
        // Zero speed covers no length.
        if length > 0.0 && entry + most + exit <= 0.0 {
            return Err(CurveError::Speed);
        }
        if bounds.length(entry, exit) > length {
            return Err(CurveError::TooShort);
        }
        let peak = bounds.peak(entry, exit, most, length);
        let up = Ramp::new(entry, peak, jerk, acceleration)?;
        let down = Ramp::new(peak, exit, jerk, acceleration)?;
        let cruise = length - up.length() - down.length();
        let cruise_s = if cruise > 0.0 && peak > 0.0 { cruise / peak } else { 0.0 };
        Ok(Self { up, down, cruise_s, length })
    }

    /// The ramps.
    pub fn ramps(&self) -> [Ramp; 2] {
        [self.up, self.down]
    }

    /// Duration of the cruise, s.
    pub fn cruise_s(&self) -> f64 {
        self.cruise_s
    }

    /// Duration, s.
    pub fn duration_s(&self) -> f64 {
        2.0 * (self.up.half_time_s + self.down.half_time_s) + self.cruise_s
    }

    /// State at a time, s; times outside give the state at the nearer end.
    pub fn at(&self, time_s: f64) -> State {
        let up_s = 2.0 * self.up.half_time_s;
        let down_start_s = up_s + self.cruise_s;
        if time_s < up_s {
            self.up.at(time_s)
        } else if time_s < down_start_s {
            let speed = self.up.to;
            State { length: self.up.length() + speed * (time_s - up_s), speed, acceleration: 0.0 }
        } else {
            let state = self.down.at(time_s - down_start_s);
            State { length: self.length - self.down.length() + state.length, ..state }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ferrostep_planner::s_curve::Jerk;
    use proptest::prelude::*;

    #[test]
    fn the_paper_s_ramp() {
        let ramp = Ramp::new(1_000.0, 10_000.0, 100_000.0, f64::INFINITY).unwrap();
        assert!((ramp.half_time_s() - 0.3).abs() < 1e-12);
        assert!((ramp.peak_acceleration() - 30_000.0).abs() < 1e-6);
        assert!((ramp.length() - 3_300.0).abs() < 1e-9);
        assert!((ramp.at(0.3).speed - 5_500.0).abs() < 1e-9 && (ramp.at(0.3).length - 750.0).abs() < 1e-9);
    }

    #[test]
    fn bad_numbers_are_told() {
        for bad in [0.0, -1.0, f64::NAN] {
            assert_eq!(Jerk::from_mm_per_s3(bad), None);
            assert_eq!(Ramp::new(0.0, 1.0, bad, 1.0).unwrap_err(), CurveError::Jerk);
            assert_eq!(Ramp::new(0.0, 1.0, 1.0, bad).unwrap_err(), CurveError::Acceleration);
        }
        assert_eq!(Ramp::new(0.0, 1.0, f64::INFINITY, 1.0).unwrap_err(), CurveError::Jerk);
        assert_eq!(Ramp::new(-1.0, 1.0, 1.0, 1.0).unwrap_err(), CurveError::Speed);
        assert_eq!(Profile::new([0.0, f64::NAN, 0.0], 1.0, 1.0, 1.0).unwrap_err(), CurveError::Speed);
        assert_eq!(Profile::new([0.0, 0.0, 0.0], 1.0, 1.0, 1.0).unwrap_err(), CurveError::Speed);
        assert_eq!(Profile::new([0.0, 1.0, 0.0], -1.0, 1.0, 1.0).unwrap_err(), CurveError::Length);
        assert_eq!(Profile::new([9.0, 9.0, 0.0], 1.0, 1.0, 1.0).unwrap_err(), CurveError::TooShort);
        assert_eq!(Profile::new([0.0, 1.0, 0.0], 0.0, 1.0, 1.0).unwrap().duration_s(), 0.0);
    }

    /// Any float, NaN and infinities included.
    fn any_number() -> impl Strategy<Value = f64> {
        prop_oneof![
            proptest::num::f64::ANY,
            proptest::sample::select(&[0.0, -0.0, -1.0, f64::MIN_POSITIVE, f64::MAX, f64::INFINITY, f64::NAN][..]),
            -10.0f64..1e6,
        ]
    }

    proptest! {
        #![proptest_config(ferrostep_random_cases::cases(20_000))]

        #[test]
        fn the_acceleration_lowers_the_jerk(
            from in 0.0f64..500.0, to in 0.0f64..500.0, jerk in 10.0f64..1e7, acceleration in 10.0f64..50_000.0,
        ) {
            prop_assume!((to - from).abs() > 1e-6);
            let ramp = Ramp::new(from, to, jerk, acceleration).unwrap();
            let effective = jerk.min(acceleration * acceleration / (to - from).abs());
            prop_assert!((ramp.jerk().abs() / effective - 1.0).abs() < 1e-9, "{} {}", ramp.jerk(), effective);
        }

        #[test]
        fn whatever_is_asked_is_answered_or_refused(
            speeds in proptest::array::uniform3(any_number()), length in any_number(), jerk in any_number(),
            acceleration in any_number(), time in any_number(),
        ) {
            let is_good = |state: State| [state.length, state.speed, state.acceleration].iter().all(|x| x.is_finite());
            if let Ok(ramp) = Ramp::new(speeds[0], speeds[1], jerk, acceleration) {
                prop_assert!(ramp.half_time_s().is_finite() && ramp.length().is_finite());
                prop_assert!(time.is_nan() || is_good(ramp.at(time)), "{:?} {}", ramp, time);
            }
            if let Ok(profile) = Profile::new(speeds, length, jerk, acceleration) {
                prop_assert!(profile.duration_s().is_finite(), "{:?}", profile);
                prop_assert!(time.is_nan() || is_good(profile.at(time)), "{:?} {}", profile, time);
            }
        }
    }

    proptest! {
        #[test]
        fn profiles_keep_their_limits_and_fill_their_length(
            entry in 0.0f64..200.0, exit in 0.0f64..200.0, more in 0.0f64..200.0, extra in 0.0f64..50.0,
            jerk in 1e3f64..1e6, acceleration in 100.0f64..10_000.0,
        ) {
            let length = Ramp::new(entry, exit, jerk, acceleration).unwrap().length() * (1.0 + 1e-9) + extra;
            let most = entry.max(exit) + more;
            let profile = Profile::new([entry, most, exit], length, jerk, acceleration).unwrap();
            let duration = profile.duration_s();
            prop_assert!(duration.is_finite());
            prop_assert!((profile.at(duration).length - length).abs() <= 1e-4 * length + 1e-9);
            for ramp in profile.ramps() {
                prop_assert!(ramp.jerk().abs() <= jerk * (1.0 + 1e-12));
                prop_assert!(ramp.peak_acceleration().abs() <= acceleration * (1.0 + 1e-12));
            }
            // Derivatives of each other.
            let h = duration * 1e-5;
            for part in 1..50 {
                let t = duration * f64::from(part) / 50.0;
                let [before, here, after] = [t - h, t, t + h].map(|t| profile.at(t));
                let scale = 1.0 + most;
                prop_assert!(((after.length - before.length) / (2.0 * h) - here.speed).abs() <= 1e-3 * scale + jerk * h * h);
                prop_assert!(((after.speed - before.speed) / (2.0 * h) - here.acceleration).abs() <= jerk * h + 1e-4 * scale);
            }
        }
    }
}
