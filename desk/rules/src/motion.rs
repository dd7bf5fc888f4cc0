//! A move before and after planning.

use std::fmt;

/// An axis of a move; the filament is the fourth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Axis {
    /// X.
    X,
    /// Y.
    Y,
    /// Z.
    Z,
    /// The filament.
    E,
}

impl Axis {
    /// All axes, in the order of displacements and settings.
    pub const ALL: [Self; 4] = [Self::X, Self::Y, Self::Z, Self::E];

    /// The letter in G-code.
    pub const fn letter(self) -> char {
        match self {
            Self::X => 'X',
            Self::Y => 'Y',
            Self::Z => 'Z',
            Self::E => 'E',
        }
    }
}

/// Marlin's knowledge of the arc that a chord belongs to (`PlannerHints` in
/// `Marlin/src/module/planner.h`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcHint {
    /// Radius of the arc that the corner before the chord lies on, mm; 0 before the first chord.
    pub radius_mm: f64,
    /// Speed at which the rest of the arc can be left in time, mm/s: the chord's exit speed while
    /// it is the last of the queue.
    pub safe_exit_mm_per_s: f64,
}

/// A straight move as a firmware's planner receives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// The caller's name for the move, such as its line; [`PlannedMove::tag`] returns it.
    pub tag: u64,
    /// Displacement of X, Y, Z and the filament, mm.
    pub displacement_mm: [f64; 4],
    /// Speed asked for, mm/s: the F word with M220 applied.
    pub feed_mm_per_s: f64,
    /// Set on chords of an arc that Marlin cuts.
    pub arc: Option<ArcHint>,
}

impl Move {
    /// A straight move that is no chord.
    pub const fn straight(tag: u64, displacement_mm: [f64; 4], feed_mm_per_s: f64) -> Self {
        Self { tag, displacement_mm, feed_mm_per_s, arc: None }
    }

    /// Length of its path in X, Y and Z, mm.
    pub fn path_mm(&self) -> f64 {
        let [x, y, z, _] = self.displacement_mm;
        (x * x + y * y + z * z).sqrt()
    }

    /// Refuses what has no plan.
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

/// A move that no plan can be made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveError {
    /// The move's tag.
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

/// A limit that holds a speed down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Limit {
    /// The speed that the line asks for.
    AskedSpeed,
    /// The machine's largest speed along the path (Klipper's `max_velocity`).
    MachineSpeed,
    /// The largest speed of an axis.
    AxisSpeed(Axis),
    /// The acceleration along the path.
    Acceleration,
    /// The largest acceleration of an axis.
    AxisAcceleration(Axis),
    /// The corner's angle, with jerk, junction deviation or square corner velocity.
    Corner,
    /// The change of the filament's speed at the corner.
    FilamentCorner,
    /// The move's length: it accelerates and brakes.
    ShortMove,
    /// Klipper's minimum cruise ratio.
    CruiseRatio,
    /// Motion that begins or ends here, or a corner where the firmware always stops.
    Rest,
}

/// A move with the speeds that a firmware gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedMove {
    /// The move's tag.
    pub tag: u64,
    /// Length along which speeds count, mm: the path, or the filament where only that moves.
    pub length_mm: f64,
    /// Speed at its start, mm/s.
    pub start_mm_per_s: f64,
    /// Largest speed on the way, mm/s.
    pub cruise_mm_per_s: f64,
    /// Speed at its end, mm/s.
    pub end_mm_per_s: f64,
    /// Acceleration of both ramps, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    /// Time of the first ramp, s.
    pub accelerate_s: f64,
    /// Time at the largest speed, s.
    pub cruise_s: f64,
    /// Time of the last ramp, s.
    pub decelerate_s: f64,
    /// The limit of the speed at its start.
    pub start_limit: Limit,
    /// The limit of the largest speed.
    pub cruise_limit: Limit,
    /// The limit of the acceleration.
    pub acceleration_limit: Limit,
}

impl PlannedMove {
    /// Time of the whole move, s.
    pub fn duration_s(&self) -> f64 {
        self.accelerate_s + self.cruise_s + self.decelerate_s
    }

    /// Length of the three phases together, mm: that of the move.
    pub fn travelled_mm(&self) -> f64 {
        0.5 * (self.start_mm_per_s + self.cruise_mm_per_s) * self.accelerate_s
            + self.cruise_mm_per_s * self.cruise_s
            + 0.5 * (self.cruise_mm_per_s + self.end_mm_per_s) * self.decelerate_s
    }

    /// The limit that holds for most of the move's time.
    pub fn limit(&self) -> Limit {
        if self.cruise_s >= self.accelerate_s + self.decelerate_s { self.cruise_limit } else { self.acceleration_limit }
    }
}

/// The three phases of a move from squared speeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Phases {
    pub start: f64,
    pub cruise: f64,
    pub end: f64,
    pub accelerate_s: f64,
    pub cruise_s: f64,
    pub decelerate_s: f64,
}

/// Time of a ramp between two speeds over a distance, s.
fn ramp_s(distance_mm: f64, one: f64, other: f64) -> f64 {
    let sum = one + other;
    if sum > 0.0 { 2.0 * distance_mm / sum } else { 0.0 }
}

impl Phases {
    /// The phases between squared speeds, the squared cruise reached on the way.
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

    /// The fastest phases below a squared speed, and whether that is reached.
    ///
    /// Ends further apart than the acceleration allows over the length keep their speeds: the one
    /// ramp between them is steeper.
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
