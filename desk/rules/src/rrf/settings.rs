//! RepRapFirmware's limits, and the commands that change them.

use crate::change::{Change, Effect, Words, set_axes};
use crate::setting::{SettingError, not_negative, positive, positive_axes, refused};

/// Minimum acceleration that M201 and M204 set, mm/s^2.
const LEAST_ACCELERATION: f64 = 0.1;
/// Minimum jerk that M205 and M566 set, mm/s.
const LEAST_JERK: f64 = 0.1;
/// Minimum speed that M203 I sets, mm/s.
const LEAST_SPEED: f64 = 0.01;

/// Moves that join without a stop, M566 P.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JerkPolicy {
    /// P0: moves of the same kind.
    SameKind,
    /// P1: all moves.
    Always,
}

/// RepRapFirmware's limits. Axes are X, Y, Z, E.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RrfSettings {
    /// Maximum speeds, M203, mm/s.
    pub max_feed_mm_per_s: [f64; 4],
    /// Maximum accelerations, M201, mm/s^2.
    pub max_acceleration_mm_per_s2: [f64; 4],
    /// Jerk, M566 or M205, mm/s.
    pub jerk_mm_per_s: [f64; 4],
    /// Acceleration of prints, M204 P, mm/s^2; infinite if not set.
    pub print_acceleration_mm_per_s2: f64,
    /// Acceleration of travels, M204 T, mm/s^2; infinite if not set.
    pub travel_acceleration_mm_per_s2: f64,
    /// Minimum speed, M203 I, mm/s.
    pub min_speed_mm_per_s: f64,
    /// Jerk policy, M566 P.
    pub jerk_policy: JerkPolicy,
    /// Pressure advance, M572 S, s.
    pub pressure_advance_s: f64,
    /// Number of moves that the ring holds, M595 P.
    pub ring_length: usize,
    /// True if motors A and B move X and Y together.
    pub is_core_xy: bool,
}

impl RrfSettings {
    /// Returns RepRapFirmware's values when `config.g` sets none, on a board of the Duet 3 6
    /// series.
    pub const fn defaults() -> Self {
        Self {
            max_feed_mm_per_s: [100.0, 100.0, 5.0, 20.0],
            max_acceleration_mm_per_s2: [1000.0, 1000.0, 200.0, 500.0],
            jerk_mm_per_s: [15.0, 15.0, 15.0, 5.0],
            print_acceleration_mm_per_s2: 50_000.0,
            travel_acceleration_mm_per_s2: 50_000.0,
            min_speed_mm_per_s: 0.5,
            jerk_policy: JerkPolicy::SameKind,
            pressure_advance_s: 0.0,
            ring_length: 60,
            is_core_xy: false,
        }
    }

    /// Checks that a plan can be made with these settings.
    ///
    /// # Errors
    /// The first setting that is out of range.
    pub fn check(&self) -> Result<(), SettingError> {
        positive_axes("M203", self.max_feed_mm_per_s)?;
        positive_axes("M201", self.max_acceleration_mm_per_s2)?;
        positive_axes("M566", self.jerk_mm_per_s)?;
        positive("M204 P", self.print_acceleration_mm_per_s2)?;
        positive("M204 T", self.travel_acceleration_mm_per_s2)?;
        not_negative("M203 I", self.min_speed_mm_per_s)?;
        not_negative("M572 S", self.pressure_advance_s)?;
        if self.max_acceleration_mm_per_s2.iter().any(|value| !value.is_finite()) {
            return Err(refused("M201", f64::INFINITY, "a finite acceleration"));
        }
        if !(4..=1 << 12).contains(&self.ring_length) {
            return Err(refused("M595 P", self.ring_length as f64, "4 to 4096"));
        }
        Ok(())
    }

    /// Applies a command: M201 (mm/s^2), M203 (mm/min, or mm/s with S1), M204 P T S, M205 (mm/s),
    /// or M566 (mm/min) with P.
    pub fn change(&mut self, change: &Change<'_>) -> Effect {
        match change {
            Change::M201(words) => at_least(LEAST_ACCELERATION, &mut self.max_acceleration_mm_per_s2, |values| {
                set_axes(words, values, 1.0)
            }),
            Change::M203(words) => self.set_speeds(words),
            Change::M204(words) => self.set_accelerations(words),
            Change::M205(words) => at_least(LEAST_JERK, &mut self.jerk_mm_per_s, |values| set_axes(words, values, 1.0)),
            Change::M566(words) => self.set_jerk(words),
            Change::VelocityLimit(_) => Effect::Unknown,
        }
    }

    fn set_speeds(&mut self, words: &Words<'_>) -> Effect {
        let factor = if words.get('S') == Some(1.0) { 1.0 } else { 1.0 / 60.0 };
        let least = words.get('I').map_or(self.min_speed_mm_per_s, |speed| (speed * factor).max(LEAST_SPEED));
        let effect = at_least(least, &mut self.max_feed_mm_per_s, |values| set_axes(words, values, factor));
        if effect == Effect::Refused || words.get('I').is_none() {
            return effect;
        }
        self.min_speed_mm_per_s = least;
        Effect::Changed
    }

    fn set_accelerations(&mut self, words: &Words<'_>) -> Effect {
        let mut effect = Effect::Unchanged;
        let mut set = |letter, value: &mut f64| {
            if let Some(number) = words.get(letter).filter(|number| number.is_finite()) {
                *value = number.max(LEAST_ACCELERATION);
                effect = Effect::Changed;
            }
        };
        set('S', &mut self.print_acceleration_mm_per_s2);
        set('S', &mut self.travel_acceleration_mm_per_s2);
        set('P', &mut self.print_acceleration_mm_per_s2);
        set('T', &mut self.travel_acceleration_mm_per_s2);
        effect
    }

    fn set_jerk(&mut self, words: &Words<'_>) -> Effect {
        let effect = at_least(LEAST_JERK, &mut self.jerk_mm_per_s, |values| set_axes(words, values, 1.0 / 60.0));
        let Some(policy) = words.get('P') else { return effect };
        if effect == Effect::Refused {
            return effect;
        }
        self.jerk_policy = if policy == 0.0 { JerkPolicy::SameKind } else { JerkPolicy::Always };
        Effect::Changed
    }
}

/// Sets values of axes with `set`, each raised to at least `least`.
fn at_least(least: f64, values: &mut [f64; 4], set: impl FnOnce(&mut [f64; 4]) -> Effect) -> Effect {
    let effect = set(values);
    if effect == Effect::Changed {
        values.iter_mut().for_each(|value| *value = value.max(least));
    }
    effect
}
