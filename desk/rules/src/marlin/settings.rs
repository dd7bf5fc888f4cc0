//! Marlin's limits, and the commands that change them.

use crate::change::{Change, Effect, Words, set_axes};
use crate::setting::{SettingError, not_negative, positive, positive_axes, refused};

/// The rule of a corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Corner {
    /// Junction deviation, the default since Marlin 2.0.
    JunctionDeviation {
        /// `JUNCTION_DEVIATION_MM`, M205 J.
        deviation_mm: f64,
        /// `JD_HANDLE_SMALL_SEGMENTS`: chords shorter than 1 mm are taken for an arc.
        handles_small_segments: bool,
    },
    /// Classic jerk: how far the speed of each axis may jump.
    ClassicJerk {
        /// `DEFAULT_XJERK` ... `DEFAULT_EJERK`, M205 X Y Z E, mm/s.
        jerk_mm_per_s: [f64; 4],
        /// The rule's version.
        rule: JerkRule,
    },
}

/// A version of classic jerk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JerkRule {
    /// Marlin 1.1 to 2.1.2, Prusa's firmwares, PrusaSlicer: an axis that reverses counts with its
    /// larger speed, and a corner that stopping at once would pass faster is passed like that.
    SafeSpeed,
    /// Marlin's bugfix branch of 2026: the difference of the speeds, whichever way.
    Difference,
}

/// The speed below which Marlin does not plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SlowestSpeed {
    /// `MINIMUM_PLANNER_SPEED` of Marlin up to 2.1.2, mm/s.
    Fixed(f64),
    /// The speed of a first step from rest, as in the bugfix branch of 2026; 0 where the
    /// steps are unknown.
    FirstStep,
}

/// Marlin's limits. Axes are X, Y, Z, E, on CoreXY the motors A, B, Z, E.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarlinSettings {
    /// The rule of corners.
    pub corner: Corner,
    /// M203, mm/s.
    pub max_feed_mm_per_s: [f64; 4],
    /// M201, mm/s^2.
    pub max_acceleration_mm_per_s2: [f64; 4],
    /// M204 P: with filament, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    /// M204 T: without filament, mm/s^2.
    pub travel_acceleration_mm_per_s2: f64,
    /// M204 R: of filament alone, mm/s^2.
    pub retract_acceleration_mm_per_s2: f64,
    /// M205 S: smallest speed with filament, mm/s.
    pub min_feed_mm_per_s: f64,
    /// M205 T: smallest speed without filament, mm/s.
    pub min_travel_feed_mm_per_s: f64,
    /// The speed below which nothing is planned.
    pub slowest: SlowestSpeed,
    /// M92, where it is known.
    pub steps_per_mm: Option<[f64; 4]>,
    /// `MIN_STEPS_PER_SEGMENT`: a move of fewer steps joins the next one. Of effect where the
    /// steps are known.
    pub min_steps_per_segment: u16,
    /// `BLOCK_BUFFER_SIZE`.
    pub block_buffer_size: usize,
    /// True if motors A and B move X and Y together.
    pub is_core_xy: bool,
}

impl MarlinSettings {
    /// Marlin's example configuration, with a rule of corners.
    pub const fn example(corner: Corner) -> Self {
        Self {
            corner,
            max_feed_mm_per_s: [300.0, 300.0, 5.0, 25.0],
            max_acceleration_mm_per_s2: [3000.0, 3000.0, 100.0, 10_000.0],
            acceleration_mm_per_s2: 3000.0,
            travel_acceleration_mm_per_s2: 3000.0,
            retract_acceleration_mm_per_s2: 3000.0,
            min_feed_mm_per_s: 0.0,
            min_travel_feed_mm_per_s: 0.0,
            slowest: SlowestSpeed::Fixed(0.05),
            steps_per_mm: None,
            min_steps_per_segment: 6,
            block_buffer_size: 16,
            is_core_xy: false,
        }
    }

    /// Blocks that a move is planned with, itself included: one of the ring is always empty, and
    /// the place of the one that has just ended is not filled yet.
    pub(super) fn planned_blocks(&self) -> usize {
        self.block_buffer_size.saturating_sub(2).max(1)
    }

    /// The squared speed below which a move is not planned.
    pub(super) fn slowest(&self, acceleration: f64, steps_per_mm: Option<f64>) -> f64 {
        match (self.slowest, steps_per_mm) {
            (SlowestSpeed::Fixed(speed), _) => speed * speed,
            (SlowestSpeed::FirstStep, Some(steps_per_mm)) if steps_per_mm > 0.0 => 0.5 * acceleration / steps_per_mm,
            (SlowestSpeed::FirstStep, _) => 0.0,
        }
    }

    /// The squared speed at the end of the last move.
    pub(super) fn last_exit(&self) -> f64 {
        match self.slowest {
            SlowestSpeed::Fixed(speed) => speed * speed,
            SlowestSpeed::FirstStep => 0.0,
        }
    }

    /// Refuses what no plan can be made with.
    ///
    /// # Errors
    /// Names the first setting that is out of range.
    pub fn check(&self) -> Result<(), SettingError> {
        positive_axes("M203", self.max_feed_mm_per_s)?;
        positive_axes("M201", self.max_acceleration_mm_per_s2)?;
        positive("M204 P", self.acceleration_mm_per_s2)?;
        positive("M204 T", self.travel_acceleration_mm_per_s2)?;
        positive("M204 R", self.retract_acceleration_mm_per_s2)?;
        not_negative("M205 S", self.min_feed_mm_per_s)?;
        not_negative("M205 T", self.min_travel_feed_mm_per_s)?;
        if let Some(steps) = self.steps_per_mm {
            positive_axes("M92", steps)?;
        }
        if let SlowestSpeed::Fixed(speed) = self.slowest {
            not_negative("MINIMUM_PLANNER_SPEED", speed)?;
        }
        if !(4..=1 << 12).contains(&self.block_buffer_size) {
            return Err(refused("BLOCK_BUFFER_SIZE", self.block_buffer_size as f64, "4 to 4096"));
        }
        match self.corner {
            Corner::JunctionDeviation { deviation_mm, .. } => positive("JUNCTION_DEVIATION_MM", deviation_mm),
            Corner::ClassicJerk { jerk_mm_per_s, .. } => positive_axes("jerk", jerk_mm_per_s),
        }
    }

    /// Takes a command: M201, M203, M204 P R T (S for P and T), M205 S T, and X Y Z E with classic
    /// jerk, J with junction deviation.
    pub fn change(&mut self, change: &Change<'_>) -> Effect {
        match change {
            Change::M201(words) => set_axes(words, &mut self.max_acceleration_mm_per_s2, 1.0),
            Change::M203(words) => set_axes(words, &mut self.max_feed_mm_per_s, 1.0),
            Change::M204(words) => self.set_accelerations(words),
            Change::M205(words) => self.set_corner(words),
            Change::M566(_) | Change::VelocityLimit(_) => Effect::Unknown,
        }
    }

    fn set_accelerations(&mut self, words: &Words<'_>) -> Effect {
        if "SPRT".chars().any(|letter| words.get(letter).is_some() && words.positive(letter).is_none()) {
            return Effect::Refused;
        }
        let mut effect = Effect::Unchanged;
        let mut set = |letter, value: &mut f64| {
            if let Some(number) = words.get(letter) {
                *value = number;
                effect = Effect::Changed;
            }
        };
        set('S', &mut self.acceleration_mm_per_s2);
        set('S', &mut self.travel_acceleration_mm_per_s2);
        set('P', &mut self.acceleration_mm_per_s2);
        set('R', &mut self.retract_acceleration_mm_per_s2);
        set('T', &mut self.travel_acceleration_mm_per_s2);
        effect
    }

    fn set_corner(&mut self, words: &Words<'_>) -> Effect {
        let mut changed = *self;
        let mut effect = Effect::Unchanged;
        for (letter, value) in [('S', &mut changed.min_feed_mm_per_s), ('T', &mut changed.min_travel_feed_mm_per_s)] {
            if let Some(number) = words.get(letter) {
                *value = number;
                effect = Effect::Changed;
            }
        }
        match &mut changed.corner {
            Corner::JunctionDeviation { deviation_mm, .. } => {
                if let Some(deviation) = words.get('J') {
                    // Marlin refuses what lies outside these.
                    if !(0.01..=0.3).contains(&deviation) {
                        return Effect::Refused;
                    }
                    *deviation_mm = deviation;
                    effect = Effect::Changed;
                }
            }
            Corner::ClassicJerk { jerk_mm_per_s, .. } => match set_axes(words, jerk_mm_per_s, 1.0) {
                Effect::Refused => return Effect::Refused,
                Effect::Changed => effect = Effect::Changed,
                Effect::Unchanged | Effect::Unknown => {}
            },
        }
        if changed.check().is_err() {
            return Effect::Refused;
        }
        *self = changed;
        effect
    }
}
