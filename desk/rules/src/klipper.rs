//! Klipper's rules.
//!
//! Sources: Klipper's documents *Kinematics* (look-ahead, square corner velocity, minimum cruise
//! ratio), *Config reference* and *G-Codes*; read against `klippy/toolhead.py`,
//! `klippy/kinematics/extruder.py` and `klippy/kinematics/corexy.py`.
//!
//! In short: all moves of X, Y and Z have one acceleration. Corners are taken as by a junction
//! deviation of `v^2 (sqrt(2) - 1) / a`, where `v` is the square corner velocity, and no faster
//! than an arc that touches both moves within their halves. The filament's speed may jump by the
//! instantaneous corner velocity. A second look-ahead, with the acceleration times one minus the
//! minimum cruise ratio, lowers the cruise speed of short moves. A move of filament alone begins
//! and ends at rest.
//!
//! Klipper also ends its look-ahead when its buffer runs low, which depends on the computer; here
//! the buffer never runs low.

mod queue;

use crate::change::{Change, Effect, VelocityLimit};
use crate::motion::{Move, MoveError, PlannedMove};
use crate::setting::{SettingError, not_negative, positive, refused};
use queue::{Candidate, Queue};

/// Durations of moves that Klipper gathers before it looks ahead (`LOOKAHEAD_FLUSH_TIME`,
/// `BUFFER_TIME_HIGH`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlushTimes {
    /// Duration of moves gathered from one look-ahead to the next, s.
    pub usual_s: f64,
    /// Duration of moves gathered before the first look-ahead after a stop, s.
    pub after_stop_s: f64,
}

impl FlushTimes {
    /// Times of Klipper 0.14.
    pub const KLIPPER_0_14: Self = Self { usual_s: 0.150, after_stop_s: 1.0 };
    /// Times of Klipper up to 0.13, and of Kalico.
    pub const KLIPPER_0_13: Self = Self { usual_s: 0.250, after_stop_s: 2.0 };
    /// Infinite times: moves are planned only by [`Klipper::flush`], with all of them known.
    pub const NEVER: Self = Self { usual_s: f64::INFINITY, after_stop_s: f64::INFINITY };
}

/// Klipper's limits, with the names of its configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KlipperSettings {
    /// `max_velocity`, mm/s.
    pub max_velocity_mm_per_s: f64,
    /// `max_accel`, mm/s^2.
    pub max_accel_mm_per_s2: f64,
    /// `max_z_velocity`, mm/s.
    pub max_z_velocity_mm_per_s: f64,
    /// `max_z_accel`, mm/s^2.
    pub max_z_accel_mm_per_s2: f64,
    /// `square_corner_velocity`, mm/s.
    pub square_corner_velocity_mm_per_s: f64,
    /// `minimum_cruise_ratio`, from 0 to less than 1.
    pub minimum_cruise_ratio: f64,
    /// `max_extrude_only_velocity`, mm/s.
    pub max_extrude_only_velocity_mm_per_s: f64,
    /// `max_extrude_only_accel`, mm/s^2.
    pub max_extrude_only_accel_mm_per_s2: f64,
    /// `instantaneous_corner_velocity`, mm/s.
    pub instantaneous_corner_velocity_mm_per_s: f64,
    /// Times after which moves are planned.
    pub flush_times: FlushTimes,
}

impl KlipperSettings {
    /// Returns the limits of a machine that sets only its velocity, acceleration, and nozzle and
    /// filament diameters; the others are Klipper's defaults.
    pub fn with_defaults(
        max_velocity_mm_per_s: f64,
        max_accel_mm_per_s2: f64,
        nozzle_mm: f64,
        filament_mm: f64,
    ) -> Self {
        // Cross-section of a bead, four times the squared nozzle diameter, over that of the
        // filament.
        let ratio = 4.0 * nozzle_mm * nozzle_mm / (std::f64::consts::PI * (0.5 * filament_mm).powi(2));
        Self {
            max_velocity_mm_per_s,
            max_accel_mm_per_s2,
            max_z_velocity_mm_per_s: max_velocity_mm_per_s,
            max_z_accel_mm_per_s2: max_accel_mm_per_s2,
            square_corner_velocity_mm_per_s: 5.0,
            minimum_cruise_ratio: 0.5,
            max_extrude_only_velocity_mm_per_s: max_velocity_mm_per_s * ratio,
            max_extrude_only_accel_mm_per_s2: max_accel_mm_per_s2 * ratio,
            instantaneous_corner_velocity_mm_per_s: 1.0,
            flush_times: FlushTimes::KLIPPER_0_14,
        }
    }

    /// Checks that a plan can be made with these settings.
    ///
    /// # Errors
    /// The first setting that is out of range.
    pub fn check(&self) -> Result<(), SettingError> {
        positive("max_velocity", self.max_velocity_mm_per_s)?;
        positive("max_accel", self.max_accel_mm_per_s2)?;
        positive("max_z_velocity", self.max_z_velocity_mm_per_s)?;
        positive("max_z_accel", self.max_z_accel_mm_per_s2)?;
        not_negative("square_corner_velocity", self.square_corner_velocity_mm_per_s)?;
        if !(0.0..1.0).contains(&self.minimum_cruise_ratio) {
            return Err(refused("minimum_cruise_ratio", self.minimum_cruise_ratio, "0 to less than 1"));
        }
        positive("max_extrude_only_velocity", self.max_extrude_only_velocity_mm_per_s)?;
        positive("max_extrude_only_accel", self.max_extrude_only_accel_mm_per_s2)?;
        not_negative("instantaneous_corner_velocity", self.instantaneous_corner_velocity_mm_per_s)?;
        positive("flush_times.usual_s", self.flush_times.usual_s)?;
        positive("flush_times.after_stop_s", self.flush_times.after_stop_s)
    }

    /// Applies a command: M204 S, or the smaller of P and T if both are given, and
    /// SET_VELOCITY_LIMIT.
    ///
    /// Source: *G-Codes*, M204 and SET_VELOCITY_LIMIT. Klipper does not know M201, M203, M205 and
    /// M566.
    pub fn change(&mut self, change: &Change<'_>) -> Effect {
        let limit = match change {
            Change::M204(words) => {
                let number = |letter| words.get(letter).map(|_| words.positive(letter));
                let accel = match (number('S'), number('P'), number('T')) {
                    (Some(s), _, _) => s,
                    (None, Some(p), Some(t)) => p.zip(t).map(|(p, t)| p.min(t)),
                    _ => None,
                };
                let Some(accel) = accel else { return Effect::Refused };
                VelocityLimit { accel: Some(accel), ..VelocityLimit::default() }
            }
            Change::VelocityLimit(limit) => *limit,
            _ => return Effect::Unknown,
        };
        if limit == VelocityLimit::default() {
            return Effect::Unchanged;
        }
        let max_accel_mm_per_s2 = limit.accel.unwrap_or(self.max_accel_mm_per_s2);
        let ratio = match (limit.minimum_cruise_ratio, limit.accel_to_decel) {
            (None, Some(to_decel)) if to_decel > 0.0 => 1.0 - (to_decel / max_accel_mm_per_s2).min(1.0),
            (None, Some(_)) => return Effect::Refused,
            (ratio, _) => ratio.unwrap_or(self.minimum_cruise_ratio),
        };
        let changed = Self {
            max_velocity_mm_per_s: limit.velocity.unwrap_or(self.max_velocity_mm_per_s),
            max_accel_mm_per_s2,
            square_corner_velocity_mm_per_s: limit
                .square_corner_velocity
                .unwrap_or(self.square_corner_velocity_mm_per_s),
            minimum_cruise_ratio: ratio,
            ..*self
        };
        if changed.check().is_err() {
            return Effect::Refused;
        }
        *self = changed;
        Effect::Changed
    }
}

/// Klipper's planner.
#[derive(Clone, Debug)]
pub struct Klipper {
    settings: KlipperSettings,
    queue: Queue,
    /// Duration of moves still to gather before the next look-ahead, s.
    until_flush_s: f64,
    forced_flushes: u64,
}

/// Maximum number of moves in the queue. Klipper has no such limit; a print reaches it only with
/// moves of less than a hundredth of a millimetre on a machine that needs metres to reach its
/// speed.
pub const MAX_QUEUED_MOVES: usize = 1 << 17;

impl Klipper {
    /// Creates a planner at rest.
    ///
    /// # Errors
    /// A setting with which no plan can be made.
    pub fn new(settings: KlipperSettings) -> Result<Self, SettingError> {
        settings.check()?;
        Ok(Self {
            settings,
            queue: Queue::default(),
            until_flush_s: settings.flush_times.after_stop_s,
            forced_flushes: 0,
        })
    }

    /// Returns the limits in force.
    pub const fn settings(&self) -> &KlipperSettings {
        &self.settings
    }

    /// Sets the limits of later moves.
    ///
    /// # Errors
    /// A setting with which no plan can be made; the limits stay as they were.
    pub fn set(&mut self, settings: KlipperSettings) -> Result<(), SettingError> {
        settings.check()?;
        self.settings = settings;
        Ok(())
    }

    /// Applies a command that changes limits.
    pub fn change(&mut self, change: &Change<'_>) -> Effect {
        self.settings.change(change)
    }

    /// Adds a move, and appends the moves that are now planned to `released`. A move without length
    /// is skipped.
    ///
    /// # Errors
    /// A displacement is not finite, or the speed is not above 0; the queue stays as it was.
    pub fn push(&mut self, one: &Move, released: &mut Vec<PlannedMove>) -> Result<(), MoveError> {
        one.check()?;
        let Some(candidate) = Candidate::new(one, &self.settings) else { return Ok(()) };
        if self.queue.len() >= MAX_QUEUED_MOVES && self.settings.flush_times.usual_s.is_finite() {
            self.forced_flushes += 1;
            self.flush(released);
        }
        let least_s = candidate.least_s();
        if self.queue.push(candidate, self.settings.instantaneous_corner_velocity_mm_per_s) {
            self.until_flush_s -= least_s;
            if self.until_flush_s <= 0.0 {
                self.until_flush_s = self.settings.flush_times.usual_s;
                self.queue.release(true, released);
            }
        }
        Ok(())
    }

    /// Plans all waiting moves so that motion ends at rest: for a dwell, a wait, homing, or the end
    /// of the print.
    pub fn flush(&mut self, released: &mut Vec<PlannedMove>) {
        self.queue.release(false, released);
        self.until_flush_s = self.settings.flush_times.after_stop_s;
    }

    /// Returns the number of waiting moves.
    pub fn queued(&self) -> usize {
        self.queue.len()
    }

    /// Returns how often the queue reached [`MAX_QUEUED_MOVES`] and motion came to rest where
    /// Klipper's would not.
    pub const fn forced_flushes(&self) -> u64 {
        self.forced_flushes
    }
}
