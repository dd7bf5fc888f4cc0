//! Li's S-curve segment by segment: ramp, cruise and ramp make five segments of constant jerk, and
//! the acceleration is zero at both ends of every block.
//!
//! The planner's own S-curve keeps its acceleration from block to block under one law; this module
//! is the reference that shows how much that gains.

pub(crate) mod bounds;

use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::methods::{OtherLaw, SpeedRule};
use ferrostep_planner::piece::{Motion, Piece, PieceEnd};
use ferrostep_planner::real::Real;
use ferrostep_planner::time_units::{FRACTION_BITS, HALF_TICK, UNITS_PER_SECOND};
use ferrostep_planner::{Block, Cubic, PlannedBlock, Speed};

use bounds::RampBounds;

/// Length units of [`Block`] per mm.
const UNIT: f64 = UNITS_PER_MM as f64;

/// Li's five segments as a law for the machine (Li 2017, section 1.1): block by block, at this
/// jerk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiveSegments {
    jerk_mm_per_s3: f64,
}

impl FiveSegments {
    /// Creates the law with this jerk, mm/s^3; `None` unless the jerk is finite and above zero.
    pub fn new(jerk_mm_per_s3: f64) -> Option<Self> {
        (jerk_mm_per_s3 > 0.0 && jerk_mm_per_s3.is_finite()).then_some(Self { jerk_mm_per_s3 })
    }

    fn bounds(&self, block: &Block) -> RampBounds {
        RampBounds { jerk: self.jerk_mm_per_s3, acceleration: block.acceleration.mm_per_s2() }
    }
}

fn length_mm(block: &Block) -> f64 {
    f64::from(block.length_10nm.max(1)) / UNIT
}

impl SpeedRule for FiveSegments {
    type Pieces = SegmentPieces;

    fn nominal(&self, block: &Block) -> Speed {
        block.nominal
    }

    fn reach(&self, block: &Block, speed: Speed) -> Speed {
        let reached = self.bounds(block).reach_from_up_to(speed.mm_per_s(), length_mm(block));
        // Rounded down, since from_mm_per_s may round to the nearest.
        Speed(Real::to_u32(reached * SPEED_UNITS)).max(speed)
    }

    fn slowest(&self, block: &Block, speed: Speed, wanted: Speed) -> Speed {
        if wanted >= speed {
            return wanted;
        }
        let slowest = self.bounds(block).slowest(speed.mm_per_s(), wanted.mm_per_s(), length_mm(block));
        Speed(Real::to_u32(slowest * SPEED_UNITS).saturating_add(1)).clamp(wanted, speed)
    }

    fn law(&self, planned: &PlannedBlock) -> OtherLaw<SegmentPieces> {
        let block = &planned.block;
        let bounds = self.bounds(block);
        let [entry, exit] = [planned.entry, planned.exit].map(Speed::mm_per_s);
        let most = block.nominal.mm_per_s().max(1.0 / SPEED_UNITS);
        let length = length_mm(block) * UNIT;
        let peak = bounds.peak(entry, exit, most, length / UNIT).max(1.0 / SPEED_UNITS);
        let (mut up, mut down) = (Ramp::new(&bounds, entry, peak), Ramp::new(&bounds, exit, peak));
        let ramps = up.length() + down.length();
        if ramps > length {
            // Speeds are rounded to their units, so a tiny part of the path is missing.
            (up, down) = (up.scaled(length / ramps), down.scaled(length / ramps));
        }
        let cruise = length - up.length() - down.length();
        let cruise_time = if cruise > 0.0 { cruise / (peak * UNIT) * UNITS_PER_SECOND } else { 0.0 };
        let down_start = up.half_time + up.half_time + cruise_time;
        let duration = down_start + down.half_time + down.half_time;
        let pieces = SegmentPieces { length, peak: peak * UNIT, up, down, down_start, duration, next: 0 };
        let duration_ticks = Real::to_u64(duration).saturating_add(HALF_TICK) >> FRACTION_BITS;
        OtherLaw { pieces, length, duration_ticks }
    }
}

/// Units of [`Speed`] per mm/s.
const SPEED_UNITS: f64 = 65_536.0;

/// A ramp: two halves of opposite jerk, each described from the end at which the acceleration is
/// zero.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    /// Duration of a half, time units.
    half_time: f64,
    /// Speed at the slow end times the duration of a half, units of 10 nm; the same for the fast
    /// end follows.
    slow: f64,
    fast: f64,
}

impl Ramp {
    fn new(bounds: &RampBounds, slow: f64, fast: f64) -> Self {
        let half_s = bounds.half_time(slow, fast);
        Self { half_time: half_s * UNITS_PER_SECOND, slow: slow * half_s * UNIT, fast: fast * half_s * UNIT }
    }

    fn length(&self) -> f64 {
        self.slow + self.fast
    }

    /// Compresses the ramp to a shorter time, over a proportionally shorter path.
    fn scaled(&self, scale: f64) -> Self {
        Self { half_time: self.half_time * scale, slow: self.slow * scale, fast: self.fast * scale }
    }

    /// Path contributed by the jerk in a half, j t1^3/6.
    fn bend(&self) -> f64 {
        (self.fast - self.slow) / 6.0
    }

    fn slow_half(&self) -> Motion<f64> {
        Motion::Jerk { curve: Cubic { linear: self.slow, cubic: self.bend() }, duration: self.half_time }
    }

    fn fast_half(&self) -> Motion<f64> {
        Motion::Jerk { curve: Cubic { linear: self.fast, cubic: -self.bend() }, duration: self.half_time }
    }
}

/// The five segments of a block, in order.
#[derive(Clone, Copy, Debug)]
pub struct SegmentPieces {
    length: f64,
    /// Cruise speed, 10 nm/s.
    peak: f64,
    up: Ramp,
    down: Ramp,
    /// Start of the deceleration, time units.
    down_start: f64,
    duration: f64,
    next: u8,
}

impl Iterator for SegmentPieces {
    type Item = Piece<f64>;

    fn next(&mut self) -> Option<Piece<f64>> {
        let Self { length, peak, up, down, down_start, duration, next } = *self;
        let leaving = |position, time, motion, end| Piece::leaving(position, time, motion, PieceEnd::FromStart(end));
        self.next = next + 1;
        Some(match next {
            0 => leaving(0.0, 0.0, up.slow_half(), up.slow + up.bend()),
            1 => {
                let time = up.half_time + up.half_time;
                Piece::arriving(length - up.length(), time, up.fast_half(), PieceEnd::FromStart(up.length()))
            }
            2 => {
                let cruise = Motion::Constant { path: peak, time: UNITS_PER_SECOND };
                leaving(up.length(), up.half_time + up.half_time, cruise, length - down.length())
            }
            3 => leaving(length - down.length(), down_start, down.fast_half(), length - down.slow - down.bend()),
            4 => Piece::arriving(0.0, duration, down.slow_half(), PieceEnd::Last),
            _ => {
                self.next = next;
                return None;
            }
        })
    }
}
