//! Limits that are other than the profile and the file say, by a factor.

use ferrostep_printer::Profile;
use ferrostep_profiles::RuleKeys;

use super::settings::square_corner_velocity;
use crate::desk::LimitFactors;

/// A limit that can be scaled: all of its kind, those of commands in the file too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scaled {
    /// The speeds that lines ask for.
    AskedSpeed,
    /// The machine's largest speeds.
    LargestSpeed,
    /// Accelerations.
    Acceleration,
    /// Speeds of corners: by jerk, square corner velocity or junction deviation.
    Corner,
    /// Klipper's part of the acceleration for short moves: what the minimum cruise ratio leaves.
    ShortMove,
}

/// Factors of the limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Factor of the speeds that lines ask for.
    pub asked_speed: f64,
    /// Factor of the machine's largest speeds.
    pub largest_speed: f64,
    /// Factor of accelerations.
    pub acceleration: f64,
    /// Factor of the speeds of corners.
    pub corner: f64,
    /// Factor of what the minimum cruise ratio leaves of the acceleration.
    pub short_move: f64,
}

impl Scale {
    /// The limits as they are.
    pub const NONE: Self =
        Self { asked_speed: 1.0, largest_speed: 1.0, acceleration: 1.0, corner: 1.0, short_move: 1.0 };

    /// One limit by a factor.
    pub const fn of(limit: Scaled, factor: f64) -> Self {
        match limit {
            Scaled::AskedSpeed => Self { asked_speed: factor, ..Self::NONE },
            Scaled::LargestSpeed => Self { largest_speed: factor, ..Self::NONE },
            Scaled::Acceleration => Self { acceleration: factor, ..Self::NONE },
            Scaled::Corner => Self { corner: factor, ..Self::NONE },
            Scaled::ShortMove => Self { short_move: factor, ..Self::NONE },
        }
    }

    /// The factors of this firmware's own planner.
    pub(super) const fn of_own_planner(&self) -> LimitFactors {
        LimitFactors { acceleration: self.acceleration, corners: self.corner * self.corner }
    }

    /// A minimum cruise ratio with its factor.
    pub(super) fn ratio(&self, ratio: f64) -> f64 {
        // Without a factor a ratio that is out of range is refused where it is used.
        if self.short_move == 1.0 { ratio } else { (1.0 - (1.0 - ratio) * self.short_move).clamp(0.0, 0.99) }
    }

    /// The limits of a profile with these factors.
    pub(super) fn apply(&self, profile: &Profile, keys: &RuleKeys) -> (Profile, RuleKeys) {
        let (mut profile, mut keys) = (*profile, *keys);
        // Klipper's corners keep their speed whatever the acceleration.
        let corner_mm_per_s = square_corner_velocity(&profile, &keys) * self.corner;
        keys.square_corner_velocity_mm_per_s = Some(corner_mm_per_s);
        let limits = &mut profile.limits;
        limits.max_feed_mm_per_s = limits.max_feed_mm_per_s.map(|speed| speed * self.largest_speed);
        limits.max_acceleration_mm_per_s2 = limits.max_acceleration_mm_per_s2.map(|axis| axis * self.acceleration);
        limits.print_acceleration_mm_per_s2 *= self.acceleration;
        limits.travel_acceleration_mm_per_s2 *= self.acceleration;
        limits.retract_acceleration_mm_per_s2 *= self.acceleration;
        // The speed of a corner grows with the root of the deviation.
        limits.junction_deviation_mm *= self.corner * self.corner;
        limits.instantaneous_corner_velocity_mm_per_s =
            limits.instantaneous_corner_velocity_mm_per_s.map(|speed| speed * self.corner);
        keys.jerk_mm_per_s = keys.jerk_mm_per_s.map(|jerk| jerk.map(|speed| speed * self.corner));
        keys.minimum_cruise_ratio = self.ratio(keys.minimum_cruise_ratio);
        (profile, keys)
    }
}
