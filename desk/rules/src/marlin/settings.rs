//! Marlin's limits, and the commands that change them.

use crate::change::{Change, Effect, Words, set_axes};
use crate::setting::{SettingError, not_negative, positive, positive_axes, refused};

/// Rule for the speed at corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Corner {
    /// Junction deviation, the default since Marlin 2.0.
    JunctionDeviation {
        /// `JUNCTION_DEVIATION_MM`, M205 J.
        deviation_mm: f64,
        /// `JD_HANDLE_SMALL_SEGMENTS`: chords shorter than 1 mm are treated as an arc.
        handles_small_segments: bool,
    },
    /// Classic jerk: the maximum jump of each axis's speed.
    ClassicJerk {
        /// `DEFAULT_XJERK` ... `DEFAULT_EJERK`, M205 X Y Z E, mm/s.
        jerk_mm_per_s: [f64; 4],
        /// Version of the rule.
        rule: JerkRule,
    },
}

/// Version of classic jerk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JerkRule {
    /// Marlin 1.1 to 2.1.2, Prusa's firmwares, PrusaSlicer: an axis that reverses counts with its
    /// larger speed, and a corner that would be faster by stopping at once is taken at that speed.
    SafeSpeed,
    /// Marlin's bugfix branch of 2026: the difference of the speeds, whether the axis reverses or
    /// not.
    Difference,
}

/// Minimum speed that Marlin plans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SlowestSpeed {
    /// `MINIMUM_PLANNER_SPEED` of Marlin up to 2.1.2, mm/s.
    Fixed(f64),
    /// Speed of a first step from rest, as in the bugfix branch of 2026; 0 if the steps/mm are
    /// unknown.
    FirstStep,
}

/// Marlin's limits. Axes are X, Y, Z, E; on CoreXY, the motors A, B, Z, E.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarlinSettings {
    /// Rule for corners.
    pub corner: Corner,
    /// Maximum speeds, M203, mm/s.
    pub max_feed_mm_per_s: [f64; 4],
    /// Maximum accelerations, M201, mm/s^2.
    pub max_acceleration_mm_per_s2: [f64; 4],
    /// Acceleration of moves with filament, M204 P, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    /// Acceleration of moves without filament, M204 T, mm/s^2.
    pub travel_acceleration_mm_per_s2: f64,
    /// Acceleration of filament alone, M204 R, mm/s^2.
    pub retract_acceleration_mm_per_s2: f64,
    /// Minimum speed with filament, M205 S, mm/s.
    pub min_feed_mm_per_s: f64,
    /// Minimum speed without filament, M205 T, mm/s.
    pub min_travel_feed_mm_per_s: f64,
    /// Speed below which nothing is planned.
    pub slowest: SlowestSpeed,
    /// Steps/mm, M92, if known.
    pub steps_per_mm: Option<[f64; 4]>,
    /// `MIN_STEPS_PER_SEGMENT`: a move of fewer steps joins the next one. Has no effect if the
    /// steps/mm are unknown.
    pub min_steps_per_segment: u16,
    /// `BLOCK_BUFFER_SIZE`.
    pub block_buffer_size: usize,
    /// True if motors A and B move X and Y together.
    pub is_core_xy: bool,
}

impl MarlinSettings {
    /// Returns Marlin's example configuration with a rule for corners.
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

    /// Returns the number of blocks with which a move is planned, including its own: one of the
    /// ring's places is always empty, and the place of the block that has just ended is not filled
    /// yet.
    pub(super) fn planned_blocks(&self) -> usize {
        self.block_buffer_size.saturating_sub(2).max(1)
    }

    /// Returns the squared speed below which a move is not planned, (mm/s)^2.
    pub(super) fn slowest(&self, acceleration: f64, steps_per_mm: Option<f64>) -> f64 {
        match (self.slowest, steps_per_mm) {
            (SlowestSpeed::Fixed(speed), _) => speed * speed,
            (SlowestSpeed::FirstStep, Some(steps_per_mm)) if steps_per_mm > 0.0 => 0.5 * acceleration / steps_per_mm,
            (SlowestSpeed::FirstStep, _) => 0.0,
        }
    }

    /// Returns the squared speed at the end of the last move, (mm/s)^2.
    pub(super) fn last_exit(&self) -> f64 {
        match self.slowest {
            SlowestSpeed::Fixed(speed) => speed * speed,
            SlowestSpeed::FirstStep => 0.0,
        }
    }

    /// Checks that a plan can be made with these settings.
    ///
    /// # Errors
    /// The first setting that is out of range.
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

    /// Applies a command: M201, M203, M204 P R T (S for P and T), M205 S T, and M205 X Y Z E with
    /// classic jerk or J with junction deviation.
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
                    // Marlin refuses values outside this range.
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
