//! Moves before and after planning.

use std::fmt;

/// Axis of a move; the filament is the fourth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Axis {
    /// X.
    X,
    /// Y.
    Y,
    /// Z.
    Z,
    /// The filament, E.
    E,
}

impl Axis {
    /// All axes, in the order of displacements and settings.
    pub const ALL: [Self; 4] = [Self::X, Self::Y, Self::Z, Self::E];

    /// Returns the axis's letter in G-code.
    pub const fn letter(self) -> char {
        match self {
            Self::X => 'X',
            Self::Y => 'Y',
            Self::Z => 'Z',
            Self::E => 'E',
        }
    }
}

/// Marlin's hint about the arc that a chord belongs to (`PlannerHints` in
/// `Marlin/src/module/planner.h`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcHint {
    /// Radius of the arc on which the corner before the chord lies, mm; 0 before the first chord.
    pub radius_mm: f64,
    /// Speed from which motion can stop within the rest of the arc, mm/s: the chord's exit speed
    /// while it is the last in the queue.
    pub safe_exit_mm_per_s: f64,
}

/// Straight move as a firmware's planner receives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Identifier that the caller gives the move, such as its line; returned in
    /// [`PlannedMove::tag`].
    pub tag: u64,
    /// Displacement of X, Y, Z and the filament, mm.
    pub displacement_mm: [f64; 4],
    /// Requested speed, mm/s: the F word with M220 applied.
    pub feed_mm_per_s: f64,
    /// Hint on chords of an arc that Marlin cuts.
    pub arc: Option<ArcHint>,
}

impl Move {
    /// Creates a straight move that is not a chord.
    pub const fn straight(tag: u64, displacement_mm: [f64; 4], feed_mm_per_s: f64) -> Self {
        Self { tag, displacement_mm, feed_mm_per_s, arc: None }
    }

    /// Returns the length of the path in X, Y and Z, mm.
    pub fn path_mm(&self) -> f64 {
        let [x, y, z, _] = self.displacement_mm;
        (x * x + y * y + z * z).sqrt()
    }

    /// Checks that the move can be planned.
    pub(crate) fn check(&self) -> Result<(), MoveError> {
        if !self.displacement_mm.iter().all(|part| part.is_finite()) {
            return Err(MoveError { tag: self.tag, fault: Fault::Displacement });
        }
        if !self.feed_mm_per_s.is_finite() || self.feed_mm_per_s <= 0.0 {
            return Err(MoveError { tag: self.tag, fault: Fault::Feed(self.feed_mm_per_s) });
        }
        Ok(())
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Displacement,
    Feed(f64),
}

/// Error for a move that cannot be planned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveError {
    /// Tag of the move.
    pub tag: u64,
    fault: Fault,
}

impl fmt::Display for MoveError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.fault {
            Fault::Displacement => write!(out, "a displacement of the move is not finite"),
            Fault::Feed(feed) => write!(out, "the move's speed is {feed} mm/s, expected more than 0 mm/s"),
        }
    }
}

impl std::error::Error for MoveError {}

/// Limit of a speed or an acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Limit {
    /// Speed that the line asks for.
    AskedSpeed,
    /// Machine's maximum speed along the path (Klipper's `max_velocity`).
    MachineSpeed,
    /// Maximum speed of an axis.
    AxisSpeed(Axis),
    /// Acceleration along the path.
    Acceleration,
    /// Maximum acceleration of an axis.
    AxisAcceleration(Axis),
    /// Corner's angle, by jerk, junction deviation or square corner velocity.
    Corner,
    /// Change of the filament's speed at the corner.
    FilamentCorner,
    /// Length of the move, which only accelerates and brakes.
    ShortMove,
    /// Klipper's minimum cruise ratio.
    CruiseRatio,
    /// Start or end of the motion, or a corner where the firmware always stops.
    Rest,
}

/// Move with the speeds that a firmware gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedMove {
    /// Tag of the move.
    pub tag: u64,
    /// Length along which speeds are measured, mm: the path, or the filament if only that moves.
    pub length_mm: f64,
    /// Speed at the start, mm/s.
    pub start_mm_per_s: f64,
    /// Maximum speed within the move, mm/s.
    pub cruise_mm_per_s: f64,
    /// Speed at the end, mm/s.
    pub end_mm_per_s: f64,
    /// Magnitude of the acceleration of both ramps, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    /// Time of the first ramp, s.
    pub accelerate_s: f64,
    /// Time at the maximum speed, s.
    pub cruise_s: f64,
    /// Time of the last ramp, s.
    pub decelerate_s: f64,
    /// Limit of the speed at the start.
    pub start_limit: Limit,
    /// Limit of the maximum speed.
    pub cruise_limit: Limit,
    /// Limit of the acceleration.
    pub acceleration_limit: Limit,
}

impl PlannedMove {
    /// Returns the duration of the whole move, s.
    pub fn duration_s(&self) -> f64 {
        self.accelerate_s + self.cruise_s + self.decelerate_s
    }

    /// Returns the length of the three phases together, mm, which is that of the move.
    pub fn travelled_mm(&self) -> f64 {
        0.5 * (self.start_mm_per_s + self.cruise_mm_per_s) * self.accelerate_s
            + self.cruise_mm_per_s * self.cruise_s
            + 0.5 * (self.cruise_mm_per_s + self.end_mm_per_s) * self.decelerate_s
    }

    /// Returns the limit that applies for most of the move's time.
    pub fn limit(&self) -> Limit {
        if self.cruise_s >= self.accelerate_s + self.decelerate_s { self.cruise_limit } else { self.acceleration_limit }
    }
}

/// Three phases of a move, computed from squared speeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Phases {
    pub start: f64,
    pub cruise: f64,
    pub end: f64,
    pub accelerate_s: f64,
    pub cruise_s: f64,
    pub decelerate_s: f64,
}

/// Returns the time of a ramp between two speeds over a distance, s.
fn ramp_s(distance_mm: f64, one: f64, other: f64) -> f64 {
    let sum = one + other;
    if sum > 0.0 { 2.0 * distance_mm / sum } else { 0.0 }
}

impl Phases {
    /// Computes the phases between squared speeds when the squared cruise speed is reached.
    pub fn of(length_mm: f64, acceleration: f64, start2: f64, cruise2: f64, end2: f64) -> Self {
        let accelerate_mm = (cruise2 - start2) / (2.0 * acceleration);
        let decelerate_mm = (cruise2 - end2) / (2.0 * acceleration);
        let cruise_mm = length_mm - accelerate_mm - decelerate_mm;
        let [start, cruise, end] = [start2, cruise2, end2].map(f64::sqrt);
        Self {
            start,
            cruise,
            end,
            accelerate_s: ramp_s(accelerate_mm, start, cruise),
            cruise_s: if cruise > 0.0 { (cruise_mm / cruise).max(0.0) } else { 0.0 },
            decelerate_s: ramp_s(decelerate_mm, cruise, end),
        }
    }

    /// Computes the fastest phases below a squared speed; the flag is true if that speed is
    /// reached.
    ///
    /// If the speeds at the ends differ by more than the acceleration allows over the length, they
    /// are kept, and a single steeper ramp joins them.
    pub fn fastest(length_mm: f64, acceleration: f64, start2: f64, nominal2: f64, end2: f64) -> (Self, bool) {
        let peak2 = acceleration * length_mm + 0.5 * (start2 + end2);
        if peak2 >= nominal2 {
            return (Self::of(length_mm, acceleration, start2, nominal2, end2), true);
        }
        let larger = start2.max(end2);
        if peak2 >= larger {
            return (Self::of(length_mm, acceleration, start2, peak2, end2), false);
        }
        let [start, cruise, end] = [start2, larger, end2].map(f64::sqrt);
        let only_s = ramp_s(length_mm, start, end);
        let (accelerate_s, decelerate_s) = if end2 > start2 { (only_s, 0.0) } else { (0.0, only_s) };
        (Self { start, cruise, end, accelerate_s, cruise_s: 0.0, decelerate_s }, false)
    }
}
