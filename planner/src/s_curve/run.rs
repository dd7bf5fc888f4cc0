//! Neighbouring blocks under one S-curve.

use super::bounds::Bounds;
use crate::block::{Acceleration, Block, Speed};
use crate::cubic::Cubic;
use crate::kinematics::UNITS_PER_MM;
use crate::real::Real;

/// A jerk along the path, mm/s^3, never zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Jerk(u32);

impl Jerk {
    /// No limit.
    pub(crate) const MAX: Self = Self(u32::MAX);

    /// The largest whole number of mm/s^3 not above this, but at least 1; `None` where it is not a
    /// finite number above zero.
    pub fn from_mm_per_s3(mm_per_s3: f64) -> Option<Self> {
        (mm_per_s3 > 0.0 && mm_per_s3.is_finite()).then(|| Self((mm_per_s3 as u32).max(1)))
    }

    /// The jerk, mm/s^3.
    pub fn mm_per_s3(self) -> f64 {
        f64::from(self.0)
    }
}

/// The largest jerks of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Jerks {
    /// Jerk along the path.
    pub path: Jerk,
    /// Jerk of moves that only push or pull filament: they shake no frame.
    pub filament: Jerk,
}

impl Jerks {
    /// Jerk of a block.
    pub(crate) fn of(&self, block: &Block) -> Jerk {
        if block.master_steps() == 0 && block.extruder_256ths != 0 { self.filament } else { self.path }
    }
}

/// One time law of a whole run of blocks: a ramp from `entry` to `peak`, a cruise, a ramp to
/// `exit`. The acceleration is zero at both ends of the run and nowhere asked to be in between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Length of all its blocks, units of 10 nm, at least 1.
    pub length_10nm: u32,
    /// Speed at its start.
    pub entry: Speed,
    /// Speed of the cruise, not below the others.
    pub peak: Speed,
    /// Speed at its end.
    pub exit: Speed,
    /// Largest acceleration.
    pub acceleration: Acceleration,
    /// Largest jerk.
    pub jerk: Jerk,
}

/// Share of jerk and acceleration that planning leaves unused: rounding in f32 is less.
const KEPT_BACK: f32 = 1.0 / 16_384.0;

/// Limits along a run, as look-ahead sees them: in f32, which the board's processor has in
/// hardware. They are a little lower than allowed, so that the law, which is computed in f64,
/// always finds room.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planning(Bounds<f32>);

/// Converts to mm/s.
fn speed(speed: Speed) -> f32 {
    speed.0 as f32 * (1.0 / 65_536.0)
}

/// Converts to mm.
fn length(length_10nm: u32) -> f32 {
    length_10nm as f32 * (1.0 / UNITS_PER_MM as f32)
}

impl Planning {
    /// Limits for this jerk and acceleration.
    pub(crate) fn new(jerk: Jerk, acceleration: Acceleration) -> Self {
        let kept = 1.0 - KEPT_BACK;
        Self(Bounds { jerk: jerk.0 as f32 * kept, acceleration: acceleration.quantised() as f32 * (kept / 256.0) })
    }

    /// Length of a ramp between two speeds, mm. Their difference is exact: f32 does not tell
    /// fast speeds apart.
    fn ramp(&self, one: Speed, other: Speed) -> f32 {
        let change = one.0.abs_diff(other.0) as f32 * (1.0 / 65_536.0);
        (speed(one) + speed(other)) * self.0.half_time_of(change)
    }

    /// True if a length is enough to go from one speed to another.
    pub(crate) fn fits(&self, entry: Speed, exit: Speed, length_10nm: u32) -> bool {
        self.ramp(entry, exit) <= length(length_10nm)
    }

    /// The fastest speed that a length allows beside `from`.
    pub(crate) fn reach(&self, from: Speed, length_10nm: u32) -> Speed {
        let reached = Speed::from_mm_per_s_f32(self.0.reach(speed(from), length(length_10nm)));
        lowered(reached, from, |faster| self.fits(from, faster, length_10nm))
    }

    /// The largest speed at most `wanted` to which one can go from `entry` over a length; where
    /// nothing slower than `entry` is near enough, the slowest that is.
    pub(crate) fn exit_within(&self, entry: Speed, wanted: Speed, length_10nm: u32) -> Speed {
        if wanted > entry {
            return self.reach(entry, length_10nm).min(wanted);
        }
        if self.fits(entry, wanted, length_10nm) {
            return wanted;
        }
        let exit = self.0.exit_within(speed(entry), speed(wanted), length(length_10nm));
        self.rounded(entry, Speed::from_mm_per_s_f32(exit), length_10nm)
    }

    /// A speed, or a few units faster where its own rounding made it too slow.
    fn rounded(&self, entry: Speed, exit: Speed, length_10nm: u32) -> Speed {
        // f32 tells 65 m/s from 65 m/s and 256 units.
        let coarse = Speed(exit.0.saturating_add(1 + (exit.0 >> 22)));
        if exit < entry && !self.fits(entry, exit, length_10nm) && self.fits(entry, coarse.min(entry), length_10nm) {
            coarse.min(entry)
        } else {
            exit
        }
    }

    /// The greatest speed at most `most` between these two.
    pub(crate) fn peak(&self, entry: Speed, exit: Speed, most: Speed, length_10nm: u32) -> Speed {
        let least = entry.max(exit);
        if most <= least {
            return least;
        }
        let peak = self.0.peak(speed(entry), speed(exit), speed(most), length(length_10nm));
        let whole = length(length_10nm);
        let fits = |peak: Speed| self.ramp(entry, peak) + self.ramp(peak, exit) <= whole;
        lowered(Speed::from_mm_per_s_f32(peak).clamp(least, most), least, fits)
    }

    /// Shortest duration of a length, s.
    pub(crate) fn duration(&self, entry: Speed, exit: Speed, most: Speed, length_10nm: u32) -> f32 {
        let peak = self.peak(entry, exit, most, length_10nm);
        self.0.duration(speed(entry), speed(peak), speed(exit), length(length_10nm))
    }

    /// The law between these speeds, which fit.
    pub(crate) fn hump(&self, entry: Speed, peak: Speed, exit: Speed, length_10nm: u32) -> Hump {
        Hump {
            up: HumpRamp::new(&self.0, entry, peak),
            down: HumpRamp::new(&self.0, exit, peak),
            length: length(length_10nm),
        }
    }
}

/// A ramp as look-ahead sees it, in mm and mm/s: the jerk's parts at both ends, and between them
/// the acceleration is held.
#[derive(Clone, Copy, Debug)]
struct HumpRamp {
    slow: f32,
    change: f32,
    half_time: f32,
    /// Duration of a part in which the jerk acts, and the change of speed in it.
    jerk_time: f32,
    jerk_change: f32,
}

impl HumpRamp {
    fn new(bounds: &Bounds<f32>, slow: Speed, fast: Speed) -> Self {
        let change = fast.0.abs_diff(slow.0) as f32 * (1.0 / 65_536.0);
        let (jerk_time, jerk_change) = bounds.jerk_part(change);
        Self { slow: speed(slow), change, half_time: bounds.half_time_of(change), jerk_time, jerk_change }
    }

    fn length(&self) -> f32 {
        (self.slow + self.slow + self.change) * self.half_time
    }

    /// Speed so far from its slow end; `inside` it.
    fn speed_at(&self, inside: f32) -> f32 {
        let Self { slow, change, jerk_time, jerk_change, .. } = *self;
        let bend = jerk_change * jerk_time * (1.0 / 3.0);
        let early = slow * jerk_time + bend;
        if inside < early {
            let x = Cubic { linear: slow * jerk_time, cubic: bend }.solve_f32(inside);
            return slow + jerk_change * x * x;
        }
        let fast = slow + change;
        let late = fast * jerk_time - bend;
        let rest = self.length() - inside;
        if rest < late {
            let x = Cubic { linear: fast * jerk_time, cubic: -bend }.solve_f32(rest);
            return fast - jerk_change * x * x;
        }
        // Twice the acceleration: the jerk's part ends with it and has half of it as its mean.
        let gain = 4.0 * jerk_change / jerk_time;
        let held = slow + jerk_change;
        (held * held + gain * (inside - early)).square_root()
    }
}

/// The law of a run as look-ahead sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hump {
    up: HumpRamp,
    down: HumpRamp,
    length: f32,
}

/// Factor by which a corner may seem to be passed too fast, so that rounding in f32 is not
/// taken for speed.
const TOLERANCE: f32 = 1.0 + 1e-5;

impl Hump {
    /// Start and end of its cruise, units of 10 nm, at the next whole ones inside.
    pub(crate) fn cruise_10nm(&self) -> [u32; 2] {
        let [start, end] =
            [self.up.length(), self.length - self.down.length()].map(|length| (length * UNITS_PER_MM as f32) as u32);
        [start.saturating_add(1), end]
    }

    /// True if a place is passed faster than this.
    pub(crate) fn is_faster_at(&self, length_10nm: u32, bound: Speed) -> bool {
        let place = length(length_10nm);
        let to_end = self.length - place;
        let passed = if place < self.up.length() {
            self.up.speed_at(place)
        } else if to_end < self.down.length() {
            self.down.speed_at(to_end)
        } else {
            self.up.slow + self.up.change
        };
        passed > speed(bound) * TOLERANCE
    }
}

/// Fastest speed for which `holds` is true: `fast`, or slower by less than f32 resolves; `least` if
/// it is true for none of these.
fn lowered(fast: Speed, least: Speed, holds: impl Fn(Speed) -> bool) -> Speed {
    let mut tried = fast;
    for _ in 0..4 {
        if tried <= least {
            break;
        }
        if holds(tried) {
            return tried;
        }
        tried = Speed(tried.0.saturating_sub(1 + (tried.0 >> 23)));
    }
    least
}
