//! A plan by Klipper's documented rules, written from them, to compare with.
//!
//! Sources: Klipper's documents *Kinematics* (square corner velocity, look-ahead, smoothed
//! look-ahead, pressure advance) and *Config reference* (the defaults below). In short: corners are
//! taken as by a junction deviation of `v^2 (sqrt(2) - 1) / a`; a second look-ahead with the
//! acceleration times one minus the minimum cruise ratio caps the cruise, so that short moves do
//! not accelerate and brake all the time; the extruder's speed may jump at corners by the
//! instantaneous corner velocity.

use crate::plan::{ExtruderFilter, Filters, MoveShape, MoveSpeeds};
use crate::shapers::Shaper;
use ferrostep_oracle::reference::{Job, Limits};
use std::fmt;

/// Klipper's settings with their defaults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KlipperSettings {
    /// `square_corner_velocity`, mm/s.
    pub square_corner_velocity_mm_per_s: f64,
    /// `minimum_cruise_ratio`.
    pub minimum_cruise_ratio: f64,
    /// `instantaneous_corner_velocity` of the extruder, mm/s.
    pub instantaneous_corner_velocity_mm_per_s: f64,
    /// `pressure_advance`, s.
    pub pressure_advance_s: f64,
    /// `pressure_advance_smooth_time`, s.
    pub smooth_time_s: f64,
}

impl Default for KlipperSettings {
    fn default() -> Self {
        Self {
            square_corner_velocity_mm_per_s: 5.0,
            minimum_cruise_ratio: 0.5,
            instantaneous_corner_velocity_mm_per_s: 1.0,
            pressure_advance_s: 0.0,
            smooth_time_s: 0.04,
        }
    }
}

/// A setting is out of range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingError {
    name: &'static str,
    value: f64,
    expected: &'static str,
}

impl fmt::Display for SettingError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "the compared plan's {} is {}, expected {}", self.name, self.value, self.expected)
    }
}

impl std::error::Error for SettingError {}

impl KlipperSettings {
    /// Refuses what no plan can be made with.
    ///
    /// # Errors
    /// Names the first setting that is out of range.
    pub fn check(&self) -> Result<(), SettingError> {
        let speed = "more than 0 mm/s and at most 1000 mm/s";
        let rows: [(&str, f64, bool, &str); 5] = [
            ("square corner velocity", self.square_corner_velocity_mm_per_s, true, speed),
            ("instantaneous corner velocity", self.instantaneous_corner_velocity_mm_per_s, true, speed),
            ("minimum cruise ratio", self.minimum_cruise_ratio, false, "0 to less than 1"),
            ("pressure advance", self.pressure_advance_s, false, "0 to less than 1 s"),
            ("smooth time", self.smooth_time_s, false, "0 to less than 1 s"),
        ];
        for (name, value, is_speed, expected) in rows {
            let is_right = if is_speed { value > 0.0 && value <= 1000.0 } else { (0.0..1.0).contains(&value) };
            if !is_right {
                return Err(SettingError { name, value, expected });
            }
        }
        Ok(())
    }

    /// Returns the filters between plan and motors, with shapers for X and Y.
    pub fn filters(&self, shapers: [Shaper; 2]) -> Filters {
        Filters { shapers, extruder: ExtruderFilter::klipper(self.pressure_advance_s, self.smooth_time_s) }
    }
}

/// A move while its speeds are looked for; speeds are squared, (mm/s)^2.
struct Candidate {
    shape: MoveShape,
    acceleration_mm_per_s2: f64,
    /// Acceleration before an axis lowers it, mm/s^2.
    machine_acceleration_mm_per_s2: f64,
    max_cruise: f64,
    /// Gained over the whole move.
    gain: f64,
    /// Gained with the acceleration of the smoothed look-ahead.
    smoothed_gain: f64,
    max_start: f64,
    max_smoothed_start: f64,
    stop_before: bool,
}

impl Candidate {
    fn new(shape: MoveShape, feed_mm_per_s: f64, limits: &Limits, settings: &KlipperSettings) -> Self {
        let [x_feed, y_feed, z_feed, e_feed] = limits.max_feed_mm_per_s;
        let [.., z_acceleration, _] = limits.max_acceleration_mm_per_s2;
        let by_kind = limits.acceleration_mm_per_s2;
        let [x, y, z] = shape.axes_mm;
        let length_mm = shape.length_mm;
        let mut acceleration = if shape.is_filament_only {
            by_kind.retract
        } else if shape.filament_mm == 0.0 {
            by_kind.travel
        } else {
            by_kind.print
        };
        let machine_acceleration_mm_per_s2 = acceleration;
        let smoothed_acceleration = acceleration * (1.0 - settings.minimum_cruise_ratio);
        let mut cruise = feed_mm_per_s;
        if shape.is_filament_only {
            cruise = cruise.min(e_feed);
        } else {
            cruise = cruise.min(x_feed.min(y_feed));
            if z != 0.0 {
                let ratio = length_mm / z.abs();
                cruise = cruise.min(z_feed * ratio);
                acceleration = acceleration.min(z_acceleration * ratio);
            }
            // A move that retracts, or one of Z with filament, keeps to the limits
            // of filament alone.
            if shape.filament_mm != 0.0 && ((x == 0.0 && y == 0.0) || shape.filament_mm < 0.0) {
                let ratio = length_mm / shape.filament_mm.abs();
                cruise = cruise.min(e_feed * ratio);
                acceleration = acceleration.min(by_kind.retract * ratio);
            }
        }
        let gain = 2.0 * length_mm * acceleration;
        Self {
            shape,
            acceleration_mm_per_s2: acceleration,
            machine_acceleration_mm_per_s2,
            max_cruise: cruise * cruise,
            gain,
            smoothed_gain: gain.min(2.0 * length_mm * smoothed_acceleration),
            max_start: 0.0,
            max_smoothed_start: 0.0,
            stop_before: false,
        }
    }

    /// Filament for a unit of path.
    fn filament_share(&self) -> f64 {
        self.shape.filament_mm / self.shape.length_mm
    }

    /// Sets how fast it may begin after another.
    fn join(&mut self, before: &Self, settings: &KlipperSettings) {
        if self.stop_before || self.shape.is_filament_only || before.shape.is_filament_only {
            return;
        }
        let dot: f64 = self.shape.axes_mm.iter().zip(before.shape.axes_mm).map(|(one, other)| one * other).sum();
        let cosine = dot / (self.shape.length_mm * before.shape.length_mm);
        let mut start = self.max_cruise.min(before.max_cruise).min(before.max_start + before.gain);
        let filament_jump = (self.filament_share() - before.filament_share()).abs();
        if filament_jump > 0.0 {
            start = start.min((settings.instantaneous_corner_velocity_mm_per_s / filament_jump).powi(2));
        }
        // Half of the angle between the one direction and the reverse of the other: 90
        // degrees is straight on.
        let sine = (0.5 * (1.0 + cosine)).max(0.0).sqrt();
        let half_cosine = (0.5 * (1.0 - cosine)).max(0.0).sqrt();
        if sine < 1.0 && half_cosine > 0.0 {
            let radius_per_deviation = sine / (1.0 - sine);
            let deviation_times_acceleration = settings.square_corner_velocity_mm_per_s.powi(2) * (2f64.sqrt() - 1.0);
            // The deviation comes from the machine's acceleration, which a move's own may be below.
            for one in [&*self, before] {
                let part = one.acceleration_mm_per_s2 / one.machine_acceleration_mm_per_s2;
                start = start.min(radius_per_deviation * deviation_times_acceleration * part);
                // An arc that touches the move at most in its middle.
                start = start.min(0.25 * one.gain * sine / half_cosine);
            }
        }
        self.max_start = start;
        self.max_smoothed_start = start.min(before.max_smoothed_start + before.smoothed_gain);
    }
}

/// Speeds of all moves, with everything known in advance.
pub fn plan(job: &Job, settings: &KlipperSettings) -> Vec<MoveSpeeds> {
    let mut candidates: Vec<Candidate> = Vec::with_capacity(job.moves.len());
    for one in &job.moves {
        let Some(limits) = job.limits.get(one.limits).or(job.limits.last()) else { break };
        let mut candidate = Candidate::new(MoveShape::of(one), one.feed_mm_per_s, limits, settings);
        candidate.stop_before = one.stop_before;
        if let Some(before) = candidates.last() {
            candidate.join(before, settings);
        }
        candidates.push(candidate);
    }
    let backward = backwards(&candidates);
    let mut speeds = Vec::with_capacity(candidates.len());
    let mut cruise_before = 0.0f64;
    for (candidate, known) in candidates.iter().zip(backward) {
        // A move that only brakes begins no faster than the one before cruises.
        let cruise = known.cruise.unwrap_or_else(|| cruise_before.min(known.start));
        cruise_before = cruise;
        speeds.push(MoveSpeeds {
            entry_mm_per_s: known.start.min(cruise).sqrt(),
            cruise_mm_per_s: cruise.sqrt(),
            exit_mm_per_s: known.end.min(cruise).sqrt(),
            acceleration_mm_per_s2: candidate.acceleration_mm_per_s2,
        });
    }
    speeds
}

/// Squared speeds of a move that the look-ahead knows.
#[derive(Clone, Copy, Debug)]
struct Known {
    start: f64,
    end: f64,
    /// Unknown for a move that only brakes in the smoothed look-ahead.
    cruise: Option<f64>,
}

fn backwards(candidates: &[Candidate]) -> Vec<Known> {
    let mut known = Vec::with_capacity(candidates.len());
    let (mut next_start, mut next_smoothed, mut peak) = (0.0f64, 0.0f64, 0.0f64);
    let mut only_brake = 0;
    for candidate in candidates.iter().rev() {
        let reachable = next_start + candidate.gain;
        let start = candidate.max_start.min(reachable);
        let smoothed_reachable = next_smoothed + candidate.smoothed_gain;
        let smoothed = candidate.max_smoothed_start.min(smoothed_reachable);
        let mut cruise = None;
        if smoothed < smoothed_reachable {
            // The move can accelerate. If it can also brake, or those after it only brake, the
            // smoothed peak is here.
            if smoothed + candidate.smoothed_gain > next_smoothed || only_brake > 0 {
                peak = 0.5 * (smoothed + smoothed_reachable);
            }
            cruise = Some((0.5 * (start + reachable)).min(candidate.max_cruise).min(peak));
            only_brake = 0;
        } else {
            only_brake += 1;
        }
        known.push(Known { start, end: next_start, cruise });
        next_start = start;
        next_smoothed = smoothed;
    }
    known.reverse();
    known
}
