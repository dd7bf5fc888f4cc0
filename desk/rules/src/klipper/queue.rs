//! Klipper's queue of moves and the look-ahead over it. Speeds are squared, (mm/s)^2.

use super::KlipperSettings;
use crate::motion::{Axis, Limit, Move, Phases, PlannedMove};
use std::collections::VecDeque;

/// Path below which a move counts as one of filament alone, mm.
const NO_PATH_MM: f64 = 1e-9;
/// Acceleration of a move of filament alone, before the extruder's own limit, mm/s^2.
const FILAMENT_ACCELERATION: f64 = 99_999_999.9;

/// Move whose speeds are still being computed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    tag: u64,
    /// Displacements of X, Y, Z and the filament per unit of length.
    shares: [f64; 4],
    length_mm: f64,
    has_path: bool,
    acceleration: f64,
    junction_deviation_mm: f64,
    max_cruise: f64,
    least_s: f64,
    /// Maximum gain of squared speed over the length.
    gain: f64,
    /// Maximum gain of squared speed with the acceleration of the second look-ahead.
    slow_gain: f64,
    max_start: f64,
    max_slow_start: f64,
    speed_limit: Limit,
    acceleration_limit: Limit,
    start_limit: Limit,
}

impl Candidate {
    /// Creates a candidate by the limits in force; `None` for a move without length.
    pub fn new(one: &Move, settings: &KlipperSettings) -> Option<Self> {
        let [x, y, z, e] = one.displacement_mm;
        let path_mm = (x * x + y * y + z * z).sqrt();
        let has_path = path_mm >= NO_PATH_MM;
        let slow = settings.max_accel_mm_per_s2 * (1.0 - settings.minimum_cruise_ratio);
        let (length_mm, acceleration, speed, parts) = if has_path {
            let speed = one.feed_mm_per_s.min(settings.max_velocity_mm_per_s);
            (path_mm, settings.max_accel_mm_per_s2, speed, one.displacement_mm)
        } else {
            (e.abs(), FILAMENT_ACCELERATION, one.feed_mm_per_s, [0.0, 0.0, 0.0, e])
        };
        if length_mm == 0.0 {
            return None;
        }
        let per_length = 1.0 / length_mm;
        let gain = 2.0 * length_mm * acceleration;
        let is_asked = one.feed_mm_per_s <= settings.max_velocity_mm_per_s || !has_path;
        let mut candidate = Self {
            tag: one.tag,
            shares: parts.map(|part| part * per_length),
            length_mm,
            has_path,
            acceleration,
            junction_deviation_mm: settings.square_corner_velocity_mm_per_s.powi(2) * (2f64.sqrt() - 1.0)
                / settings.max_accel_mm_per_s2,
            max_cruise: speed * speed,
            least_s: length_mm / speed,
            gain,
            slow_gain: 2.0 * length_mm * slow,
            max_start: 0.0,
            max_slow_start: 0.0,
            speed_limit: if is_asked { Limit::AskedSpeed } else { Limit::MachineSpeed },
            acceleration_limit: Limit::Acceleration,
            start_limit: Limit::Rest,
        };
        let [x, y, z, e] = parts;
        if z != 0.0 {
            let ratio = length_mm / z.abs();
            candidate.lower(Axis::Z, settings.max_z_velocity_mm_per_s * ratio, settings.max_z_accel_mm_per_s2 * ratio);
        }
        // Retractions, and moves of filament without X and Y, also keep to the extruder's own
        // limits.
        if e != 0.0 && ((x == 0.0 && y == 0.0) || e < 0.0) {
            let ratio = 1.0 / candidate.shares[3].abs();
            let (speed, acceleration) =
                (settings.max_extrude_only_velocity_mm_per_s, settings.max_extrude_only_accel_mm_per_s2);
            candidate.lower(Axis::E, speed * ratio, acceleration * ratio);
        }
        Some(candidate)
    }

    /// Returns the time of the move at its full speed, s.
    pub fn least_s(&self) -> f64 {
        self.least_s
    }

    /// Lowers speed and acceleration to those that an axis allows along the path.
    fn lower(&mut self, axis: Axis, speed: f64, acceleration: f64) {
        if speed * speed < self.max_cruise {
            self.max_cruise = speed * speed;
            self.least_s = self.length_mm / speed;
            self.speed_limit = Limit::AxisSpeed(axis);
        }
        if acceleration < self.acceleration {
            self.acceleration = acceleration;
            self.acceleration_limit = Limit::AxisAcceleration(axis);
        }
        self.gain = 2.0 * self.length_mm * self.acceleration;
        self.slow_gain = self.slow_gain.min(self.gain);
    }

    /// Sets the maximum start speed after another move, by the corner, by both moves' limits, and
    /// by the speed that the other move can reach.
    fn join(&mut self, before: &Self, filament_jump_mm_per_s: f64) {
        if !self.has_path || !before.has_path {
            return;
        }
        let mut start = self.max_cruise;
        let mut limit = self.speed_limit;
        let mut lower = |speed: f64, by: Limit| {
            if speed < start {
                start = speed;
                limit = by;
            }
        };
        lower(before.max_cruise, before.speed_limit);
        lower(before.max_start + before.gain, before.acceleration_limit);
        let filament_change = (self.shares[3] - before.shares[3]).abs();
        if filament_change > 0.0 {
            lower((filament_jump_mm_per_s / filament_change).powi(2), Limit::FilamentCorner);
        }
        let [x, y, z, _] = self.shares;
        let [x_before, y_before, z_before, _] = before.shares;
        let cosine = -(x * x_before + y * y_before + z * z_before);
        // Half the angle between the reversed previous direction and the new one: 90 degrees when
        // going straight on.
        let half_sine = (0.5 * (1.0 - cosine)).max(0.0).sqrt();
        let half_cosine = (0.5 * (1.0 + cosine)).max(0.0).sqrt();
        let rest_of_sine = 1.0 - half_sine;
        if rest_of_sine > 0.0 && half_cosine > 0.0 {
            let radius_per_deviation = half_sine / rest_of_sine;
            let quarter_tangent = 0.25 * half_sine / half_cosine;
            for one in [&*self, before] {
                lower(radius_per_deviation * one.junction_deviation_mm * one.acceleration, Limit::Corner);
                lower(one.gain * quarter_tangent, Limit::Corner);
            }
        }
        self.max_start = start;
        self.start_limit = limit;
        self.max_slow_start = start.min(before.max_slow_start + before.slow_gain);
    }
}

/// Result of the look-ahead for a move.
#[derive(Clone, Copy, Debug)]
struct Found {
    start: f64,
    /// `None` for a move that only brakes in the second look-ahead.
    cruise: Option<(f64, Limit)>,
    end: f64,
    /// True if later moves limit the start speed, so that the move can brake for them.
    brakes: bool,
}

/// Queue of waiting moves.
#[derive(Clone, Debug, Default)]
pub(super) struct Queue {
    moves: VecDeque<Candidate>,
    /// Results of the look-ahead, last move first; kept between look-aheads to reuse the
    /// allocation.
    found: Vec<Found>,
}

impl Queue {
    /// Returns the number of waiting moves.
    pub fn len(&self) -> usize {
        self.moves.len()
    }

    /// Appends a move; returns true if another one waits before it.
    pub fn push(&mut self, mut candidate: Candidate, filament_jump_mm_per_s: f64) -> bool {
        let before = self.moves.back();
        if let Some(before) = before {
            candidate.join(before, filament_jump_mm_per_s);
        }
        let is_later = before.is_some();
        self.moves.push_back(candidate);
        is_later
    }

    /// Looks ahead as if motion ended after the last move, and releases moves: all of them, or, if
    /// `lazily` is true, only those whose plan no later move can change. These end before the last
    /// but one peak of the second look-ahead.
    pub fn release(&mut self, lazily: bool, released: &mut Vec<PlannedMove>) {
        let mut count = self.moves.len();
        let mut is_looking = lazily;
        self.found.clear();
        let (mut next_start, mut next_slow, mut peak) = (0.0, 0.0, 0.0);
        let mut without_cruise = 0;
        for (index, one) in self.moves.iter().enumerate().rev() {
            let reachable = next_start + one.gain;
            let start = one.max_start.min(reachable);
            let slow_reachable = next_slow + one.slow_gain;
            let slow = one.max_slow_start.min(slow_reachable);
            let mut cruise = None;
            without_cruise += 1;
            if slow < slow_reachable {
                if slow + one.slow_gain > next_slow || without_cruise > 1 {
                    if is_looking && peak != 0.0 {
                        count = index + without_cruise;
                        is_looking = false;
                    }
                    peak = 0.5 * (slow + slow_reachable);
                }
                let own_peak = 0.5 * (start + reachable);
                let (mut speed, mut limit) = (own_peak, Limit::ShortMove);
                if one.max_cruise < speed {
                    (speed, limit) = (one.max_cruise, one.speed_limit);
                }
                if peak < speed {
                    (speed, limit) = (peak, Limit::CruiseRatio);
                }
                cruise = Some((speed, limit));
                without_cruise = 0;
            }
            self.found.push(Found { start, cruise, end: next_start, brakes: reachable < one.max_start });
            next_start = start;
            next_slow = slow;
        }
        if is_looking {
            return;
        }
        let mut cruise_before: (f64, Limit) = (0.0, Limit::Rest);
        for (one, found) in self.moves.drain(..count).zip(self.found.iter().rev()) {
            let braking = (cruise_before.0.min(found.start), one.acceleration_limit);
            let (cruise, cruise_limit) = found.cruise.unwrap_or(braking);
            let start = found.start.min(cruise);
            let phases = Phases::of(one.length_mm, one.acceleration, start, cruise, found.end.min(cruise));
            let start_limit = if found.start > cruise {
                cruise_limit
            } else if found.brakes {
                one.acceleration_limit
            } else {
                one.start_limit
            };
            released.push(one.planned(&phases, start_limit, cruise_limit));
            cruise_before = (cruise, cruise_limit);
        }
    }
}

impl Candidate {
    fn planned(&self, phases: &Phases, start_limit: Limit, cruise_limit: Limit) -> PlannedMove {
        PlannedMove {
            tag: self.tag,
            length_mm: self.length_mm,
            start_mm_per_s: phases.start,
            cruise_mm_per_s: phases.cruise,
            end_mm_per_s: phases.end,
            acceleration_mm_per_s2: self.acceleration,
            accelerate_s: phases.accelerate_s,
            cruise_s: phases.cruise_s,
            decelerate_s: phases.decelerate_s,
            start_limit,
            cruise_limit,
            acceleration_limit: self.acceleration_limit,
        }
    }
}
