//! Models the nozzle: filament that is pushed in compresses the material ahead of it, and the
//! pressure drives it out.
//!
//! The state is the compressed volume. The flow is a piecewise linear function of it. With one
//! slope it is the volume divided by the time constant, which linear pressure advance undoes; with
//! two slopes, the second one applies above a given flow. A negative volume is the gap that a
//! retraction leaves: nothing flows until the gap is filled. For a constant feed the state is known
//! in closed form.

use std::fmt;
use std::ops::RangeInclusive;

/// Range of time constants, s; 0 would be a nozzle without pressure.
pub const TIME_CONSTANT_S: RangeInclusive<f64> = 0.001..=2.0;

/// Second slope of a nozzle's flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondSlope {
    /// Flow above which the second slope applies, mm^3/s.
    pub above_mm3_per_s: f64,
    /// Compressed volume for each mm^3/s above that flow, s.
    pub time_constant_s: f64,
}

/// Parameters of a nozzle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NozzleSettings {
    /// Compressed volume for each mm^3/s of flow, s: Klipper's `pressure_advance`, Marlin's K.
    pub time_constant_s: f64,
    /// Second slope, with a smaller (or larger) time constant at large flows.
    pub second: Option<SecondSlope>,
}

impl Default for NozzleSettings {
    /// Returns the nozzle of a direct extruder: 0.04 s, one slope.
    fn default() -> Self {
        Self { time_constant_s: 0.04, second: None }
    }
}

/// Reason why a nozzle cannot have these settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NozzleError {
    /// A time constant is out of range; its value, s.
    TimeConstant(f64),
    /// The flow at which the second slope begins is not positive; its value, mm^3/s.
    Flow(f64),
}

impl fmt::Display for NozzleError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (low, high) = (TIME_CONSTANT_S.start(), TIME_CONSTANT_S.end());
        match self {
            Self::TimeConstant(value) => {
                write!(out, "the nozzle's time constant is {value} s, expected {low} to {high} s")
            }
            Self::Flow(value) => {
                write!(out, "the nozzle's second slope begins at {value} mm^3/s, expected more than 0")
            }
        }
    }
}

impl std::error::Error for NozzleError {}

/// Nozzle and its state.
#[derive(Clone, Copy, Debug)]
pub struct Nozzle {
    settings: NozzleSettings,
    /// Compressed volume; negative for the gap after a retraction.
    compressed_mm3: f64,
}

/// Part of the flow curve: its ends, the flow at its lower end, and its slope.
struct Part {
    from_mm3: f64,
    to_mm3: f64,
    flow_mm3_per_s: f64,
    per_s: f64,
}

impl Nozzle {
    /// Creates a nozzle without pressure.
    ///
    /// # Errors
    /// A setting is out of range.
    pub fn new(settings: NozzleSettings) -> Result<Self, NozzleError> {
        let second = settings.second.map(|second| second.time_constant_s);
        for value in [Some(settings.time_constant_s), second].into_iter().flatten() {
            if !TIME_CONSTANT_S.contains(&value) {
                return Err(NozzleError::TimeConstant(value));
            }
        }
        match settings.second {
            Some(SecondSlope { above_mm3_per_s, .. }) if !(above_mm3_per_s > 0.0 && above_mm3_per_s.is_finite()) => {
                Err(NozzleError::Flow(above_mm3_per_s))
            }
            _ => Ok(Self { settings, compressed_mm3: 0.0 }),
        }
    }

    /// Returns the present flow out of the nozzle, mm^3/s.
    pub fn flow_mm3_per_s(&self) -> f64 {
        if self.compressed_mm3 <= 0.0 {
            return 0.0;
        }
        let part = self.part(true);
        part.flow_mm3_per_s + (self.compressed_mm3 - part.from_mm3) * part.per_s
    }

    /// Returns the part of the curve that contains the state; at a joint, the part that the state
    /// moves into.
    fn part(&self, rising: bool) -> Part {
        let NozzleSettings { time_constant_s, second } = self.settings;
        let volume = self.compressed_mm3;
        if volume < 0.0 || (volume == 0.0 && !rising) {
            return Part { from_mm3: f64::NEG_INFINITY, to_mm3: 0.0, flow_mm3_per_s: 0.0, per_s: 0.0 };
        }
        let joint_mm3 = second.map_or(f64::INFINITY, |second| second.above_mm3_per_s * time_constant_s);
        match second {
            Some(second) if volume > joint_mm3 || (volume == joint_mm3 && rising) => Part {
                from_mm3: joint_mm3,
                to_mm3: f64::INFINITY,
                flow_mm3_per_s: second.above_mm3_per_s,
                per_s: 1.0 / second.time_constant_s,
            },
            _ => Part { from_mm3: 0.0, to_mm3: joint_mm3, flow_mm3_per_s: 0.0, per_s: 1.0 / time_constant_s },
        }
    }

    /// Advances time while filament is pushed in at a rate in mm^3/s; returns the volume that has
    /// come out, mm^3.
    pub fn advance(&mut self, time_s: f64, feed_mm3_per_s: f64) -> f64 {
        let before_mm3 = self.compressed_mm3;
        let mut left_s = time_s;
        // The state moves in one direction under a constant feed, so it passes each joint once.
        for _ in 0..4 {
            let rising = feed_mm3_per_s > self.flow_mm3_per_s();
            let part = self.part(rising);
            let (end_mm3, reach_s) = part.step(self.compressed_mm3, feed_mm3_per_s, left_s, rising);
            self.compressed_mm3 = end_mm3;
            left_s -= reach_s;
            if left_s <= 0.0 {
                break;
            }
        }
        feed_mm3_per_s * time_s - (self.compressed_mm3 - before_mm3)
    }
}

impl Part {
    /// Returns the state after `time_s` or at the part's end, whichever comes first, and the time
    /// until then.
    fn step(&self, volume_mm3: f64, feed: f64, time_s: f64, rising: bool) -> (f64, f64) {
        let joint_mm3 = if rising { self.to_mm3 } else { self.from_mm3 };
        if self.per_s == 0.0 {
            let end_mm3 = volume_mm3 + feed * time_s;
            let passes = rising && end_mm3 > joint_mm3;
            return if passes { (joint_mm3, (joint_mm3 - volume_mm3) / feed) } else { (end_mm3, time_s) };
        }
        // Volume at which the flow would equal the feed.
        let rest_mm3 = self.from_mm3 + (feed - self.flow_mm3_per_s) / self.per_s;
        let end_mm3 = rest_mm3 + (volume_mm3 - rest_mm3) * (-self.per_s * time_s).exp();
        let passes = if rising { end_mm3 > joint_mm3 } else { end_mm3 < joint_mm3 };
        if !passes {
            return (end_mm3, time_s);
        }
        let reach_s = ((volume_mm3 - rest_mm3) / (joint_mm3 - rest_mm3)).ln() / self.per_s;
        (joint_mm3, reach_s.clamp(0.0, time_s))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_slope_approaches_the_feed_exponentially() {
        let mut nozzle = Nozzle::new(NozzleSettings::default()).unwrap();
        let out = nozzle.advance(0.1, 9.0);
        assert!((nozzle.flow_mm3_per_s() - 9.0 * (1.0 - (-2.5f64).exp())).abs() < 1e-12);
        assert!((out + nozzle.compressed_mm3 - 0.9).abs() < 1e-12);
    }

    #[test]
    fn a_retraction_leaves_a_gap_that_must_be_filled() {
        let mut nozzle = Nozzle::new(NozzleSettings::default()).unwrap();
        nozzle.advance(1.0, 9.0);
        // 0.36 mm^3 are compressed; 1.9 mm^3 are drawn back.
        nozzle.advance(0.05, -38.0);
        assert_eq!(nozzle.flow_mm3_per_s(), 0.0);
        assert_eq!(nozzle.advance(1.0, 0.0), 0.0);
        let gap_mm3 = -nozzle.compressed_mm3;
        let out = nozzle.advance(gap_mm3 / 38.0, 38.0);
        assert!(out.abs() < 1e-12 && nozzle.compressed_mm3.abs() < 1e-12);
    }

    #[test]
    fn two_slopes_meet_at_their_flow() {
        let second = SecondSlope { above_mm3_per_s: 5.0, time_constant_s: 0.01 };
        let mut nozzle = Nozzle::new(NozzleSettings { time_constant_s: 0.05, second: Some(second) }).unwrap();
        nozzle.advance(5.0, 12.0);
        assert!((nozzle.flow_mm3_per_s() - 12.0).abs() < 1e-9);
        assert!((nozzle.compressed_mm3 - (0.25 + 0.07)).abs() < 1e-9);
        nozzle.advance(5.0, 3.0);
        assert!((nozzle.compressed_mm3 - 0.15).abs() < 1e-9);
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        let error = Nozzle::new(NozzleSettings { time_constant_s: 0.0, second: None }).unwrap_err();
        assert_eq!(error.to_string(), "the nozzle's time constant is 0 s, expected 0.001 to 2 s");
        let second = |above_mm3_per_s, time_constant_s| {
            let second = Some(SecondSlope { above_mm3_per_s, time_constant_s });
            Nozzle::new(NozzleSettings { time_constant_s: 0.04, second }).map(|_| ())
        };
        assert_eq!(second(5.0, 9.0), Err(NozzleError::TimeConstant(9.0)));
        assert_eq!(second(0.0, 0.01), Err(NozzleError::Flow(0.0)));
    }

    proptest! {
        #[test]
        fn volume_is_kept_and_cuts_change_nothing(
            slope in 0.001f64..2.0, second in 0.001f64..2.0, above in 0.1f64..20.0,
            feeds in prop::collection::vec((-60.0f64..60.0, 0.0001f64..0.2, 0.05f64..0.95), 1..20),
        ) {
            let second = Some(SecondSlope { above_mm3_per_s: above, time_constant_s: second });
            let mut whole = Nozzle::new(NozzleSettings { time_constant_s: slope, second }).unwrap();
            let mut parts = whole;
            let (mut fed, mut out) = (0.0, 0.0);
            for (feed, time_s, part) in feeds {
                let volume = whole.advance(time_s, feed);
                prop_assert!(volume >= -1e-9, "nothing is drawn in: {volume}");
                parts.advance(time_s * part, feed);
                parts.advance(time_s * (1.0 - part), feed);
                fed += feed * time_s;
                out += volume;
                prop_assert!((whole.compressed_mm3 - parts.compressed_mm3).abs() < 1e-7 * (1.0 + whole.compressed_mm3.abs()));
                prop_assert!(whole.flow_mm3_per_s() >= 0.0);
            }
            prop_assert!((fed - out - whole.compressed_mm3).abs() < 1e-9);
        }
    }
}
