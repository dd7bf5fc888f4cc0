//! Pressure advance: the extruder runs ahead of the flow, by the filament that the
//! nozzle's pressure takes.
//!
//! A nozzle lets out filament in proportion to its pressure, and the pressure grows with the
//! filament that is compressed before it. So that the flow follows a plan e(t), the extruder has to
//! push e + K e' (a first-order lag, taken back). Where the line leaves a corner that is K a more
//! speed at once, and where the flow changes it is filament at once; so the advance K e' is
//! averaged over a time B: (1/B) times the filament that went K-fold into the line from B/2 before
//! to B/2 after. In the filters of [`crate::shaping`] these are two more delays.

use crate::kinematics::UNITS_PER_MM;
use crate::time_units::TICKS_PER_SECOND;

/// The most filament that a line of plastic takes for its length. A move that pushes more fills the
/// nozzle, and has no advance.
pub(crate) const MOST_FILAMENT_IN_LINE: f32 = 0.5;

/// Lead of the extruder over the flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressureAdvance {
    /// K: filament ahead for each mm/s at which it is pushed into a line, s. 0: none.
    pub seconds: f64,
    /// Another K for the filament's speed above a limit.
    pub above: Option<SecondSlope>,
    /// Time over which the lead is averaged, s; `None`: nearly as long as the filters of X and Y
    /// spread the motion.
    pub smooth_time_s: Option<f64>,
}

/// The K of fast flow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondSlope {
    /// Speed of the filament above which it applies, mm/s.
    pub filament_mm_per_s: f64,
    /// K, s.
    pub seconds: f64,
}

/// Number that is out of its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PressureAdvanceError {
    /// K: not from 0 to [`PressureAdvance::MAX_SECONDS`].
    Seconds,
    /// The speed of the second slope: not within [`PressureAdvance::FILAMENT_MM_PER_S`].
    Speed,
    /// The time for averaging: not within [`PressureAdvance::SMOOTH_TIME_S`].
    SmoothTime,
}

impl PressureAdvance {
    /// No advance.
    pub const NONE: Self = Self { seconds: 0.0, above: None, smooth_time_s: None };

    /// The largest K, s: a long tube has about 1.
    pub const MAX_SECONDS: f64 = 2.0;

    /// Speeds of the filament at which the slope may change, mm/s.
    pub const FILAMENT_MM_PER_S: [f64; 2] = [0.01, 100.0];

    /// Times for averaging, s.
    pub const SMOOTH_TIME_S: [f64; 2] = [0.001, 0.1];

    /// # Errors
    /// The first number that is out of its range.
    pub fn check(&self) -> Result<(), PressureAdvanceError> {
        let is_slope = |seconds: f64| (0.0..=Self::MAX_SECONDS).contains(&seconds);
        let is_within = |value: f64, [least, most]: [f64; 2]| (least..=most).contains(&value);
        if !is_slope(self.seconds) || self.above.is_some_and(|above| !is_slope(above.seconds)) {
            return Err(PressureAdvanceError::Seconds);
        }
        if self.above.is_some_and(|above| !is_within(above.filament_mm_per_s, Self::FILAMENT_MM_PER_S)) {
            return Err(PressureAdvanceError::Speed);
        }
        if self.smooth_time_s.is_some_and(|time_s| !is_within(time_s, Self::SMOOTH_TIME_S)) {
            return Err(PressureAdvanceError::SmoothTime);
        }
        Ok(())
    }

    /// True if the extruder runs ahead at all.
    pub fn is_some(&self) -> bool {
        self.largest_seconds() > 0.0
    }

    /// The larger K, s.
    pub fn largest_seconds(&self) -> f64 {
        let above = self.above.map_or(0.0, |above| above.seconds);
        if above > self.seconds { above } else { self.seconds }
    }
}

/// Units of a constant advance in 1/256 steps.
const PER_256TH: f64 = 4096.0;

/// Advance in ticks, for an extruder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AdvanceLaw {
    /// K, ticks.
    slow: u32,
    fast: u32,
    /// Filament speed at which the second slope begins, 1/256 steps a tick; infinite without one.
    knee: f64,
    /// Excess of the first slope's lead over the second's at the knee, 2^-20 steps.
    rest: i32,
    /// The most filament in a line, 1/256 steps for 10 nm.
    most_256ths_per_10nm: f32,
}

/// The advance while a piece of the plan lasts: a slope in ticks times the filament's speed, and a
/// constant, 2^-20 steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AdvanceSlope {
    pub ticks: u32,
    pub constant: i32,
}

impl AdvanceSlope {
    /// No lead.
    pub const NONE: Self = Self { ticks: 0, constant: 0 };
}

impl AdvanceLaw {
    /// No advance.
    pub const NONE: Self = Self { slow: 0, fast: 0, knee: f64::INFINITY, rest: 0, most_256ths_per_10nm: 0.0 };

    /// The law of an extruder with these steps/mm.
    #[cold]
    pub fn new(advance: &PressureAdvance, steps_per_mm: f64) -> Self {
        let ticks = |seconds: f64| (seconds * f64::from(TICKS_PER_SECOND) + 0.5) as u32;
        let slow = ticks(advance.seconds);
        let most_256ths_per_10nm = MOST_FILAMENT_IN_LINE * (steps_per_mm * 256.0 / UNITS_PER_MM as f64) as f32;
        let one_slope = Self { slow, fast: slow, most_256ths_per_10nm, ..Self::NONE };
        let Some(above) = advance.above else { return one_slope };
        let fast = ticks(above.seconds);
        if fast == slow {
            return one_slope;
        }
        let knee = above.filament_mm_per_s * steps_per_mm * 256.0 / f64::from(TICKS_PER_SECOND);
        // The knee is where the constant that is left after rounding makes the advance continuous.
        // At most 2048 steps: no nozzle takes millimetres of filament.
        let apart = (f64::from(slow) - f64::from(fast)) * PER_256TH;
        let rest = (apart * knee + if fast < slow { 0.5 } else { -0.5 }) as i32;
        Self { fast, knee: f64::from(rest) / apart, rest, ..one_slope }
    }

    /// True if the extruder runs ahead in a stretch of this length, units of 10 nm: it pushes
    /// filament into a line.
    pub fn advances(&self, extruder_256ths: i32, length_10nm: u32) -> bool {
        extruder_256ths > 0
            && self.slow | self.fast > 0
            && extruder_256ths as f32 <= self.most_256ths_per_10nm * length_10nm as f32
    }

    /// The speed of the filament at which the slope changes, 1/256 steps a tick.
    pub fn knee(&self) -> f64 {
        self.knee
    }

    /// The slope at a speed of the filament, 1/256 steps a tick.
    pub fn slope_at(&self, speed: f64) -> AdvanceSlope {
        if speed > self.knee {
            AdvanceSlope { ticks: self.fast, constant: self.rest }
        } else {
            AdvanceSlope { ticks: self.slow, constant: 0 }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        let advance = PressureAdvance { seconds: 0.04, ..PressureAdvance::NONE };
        assert_eq!(advance.check(), Ok(()));
        assert_eq!(PressureAdvance::NONE.check(), Ok(()));
        for seconds in [-0.001, 2.001, f64::NAN, f64::INFINITY] {
            assert_eq!(PressureAdvance { seconds, ..advance }.check(), Err(PressureAdvanceError::Seconds));
            let above = Some(SecondSlope { filament_mm_per_s: 3.0, seconds });
            assert_eq!(PressureAdvance { above, ..advance }.check(), Err(PressureAdvanceError::Seconds));
        }
        for filament_mm_per_s in [0.0, 100.5, f64::NAN] {
            let above = Some(SecondSlope { filament_mm_per_s, seconds: 0.02 });
            assert_eq!(PressureAdvance { above, ..advance }.check(), Err(PressureAdvanceError::Speed));
        }
        for time_s in [0.0, 0.2, f64::NAN] {
            let smooth_time_s = Some(time_s);
            assert_eq!(PressureAdvance { smooth_time_s, ..advance }.check(), Err(PressureAdvanceError::SmoothTime));
        }
    }

    #[test]
    fn the_advance_is_continuous_where_its_slope_changes() {
        let above = Some(SecondSlope { filament_mm_per_s: 3.0, seconds: 0.02 });
        let law = AdvanceLaw::new(&PressureAdvance { seconds: 0.05, above, smooth_time_s: None }, 400.0);
        let advance_256ths = |speed: f64| {
            let AdvanceSlope { ticks, constant } = law.slope_at(speed);
            f64::from(ticks) * speed + f64::from(constant) / PER_256TH
        };
        // 3 mm/s * 0.05 s * 400 steps/mm
        assert!((advance_256ths(law.knee()) / 256.0 - 60.0).abs() < 0.01);
        assert!((advance_256ths(law.knee() * 1.000_001) / 256.0 - 60.0).abs() < 0.02);
        // ... and 2 mm/s * 0.02 s more
        assert!((advance_256ths(law.knee() * 5.0 / 3.0) / 256.0 - 76.0).abs() < 0.01);
    }
}
