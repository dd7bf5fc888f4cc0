//! s(t) of a run, and of each of its blocks.

use super::bounds::Bounds;
use super::run::Run;
use crate::block::Speed;
use crate::cubic::Cubic;
use crate::kinematics::UNITS_PER_MM;
use crate::piece::{Motion, Piece, PieceEnd, Place, above_zero, piece_at, time_at};
use crate::real::Real;
use crate::time_units::{FRACTION_BITS, HALF_TICK, UNITS, UNITS_PER_SECOND, cruise_time};

/// Units of [`Speed`] in 1 mm/s.
const SPEED_UNITS: f64 = 65_536.0;

/// A ramp: the jerk's parts at both ends, each described from the end where the acceleration is
/// zero, and between them a part at the greatest acceleration, described from its slow end. There
/// their times are exact however slow they are.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    /// Length of the path, units of 10 nm, and duration, time units.
    length: f64,
    duration: f64,
    /// Path of the jerk's parts at a share of their duration, and that, time units.
    slow_part: Cubic<f64>,
    fast_part: Cubic<f64>,
    jerk_time: f64,
    /// Speed at which the part between begins, units of [`Speed`]; twice its
    /// acceleration; and its length.
    held_speed: f64,
    gain: f64,
    held: f64,
}

impl Ramp {
    const NONE: Self = {
        let part = Cubic { linear: 0.0, cubic: 0.0 };
        let (slow_part, fast_part) = (part, part);
        Self { length: 0.0, duration: 0.0, slow_part, fast_part, jerk_time: 0.0, held_speed: 0.0, gain: 0.0, held: 0.0 }
    };

    fn new(bounds: &Bounds<f64>, one: Speed, other: Speed) -> Self {
        const UNIT: f64 = UNITS_PER_MM as f64;
        let (slow, fast) = (one.min(other).mm_per_s(), one.max(other).mm_per_s());
        let half_s = bounds.half_time(slow, fast);
        let (jerk_s, jerk_change) = bounds.jerk_part(fast - slow);
        let bend = jerk_change * jerk_s * (UNIT / 3.0);
        let slow_part = Cubic { linear: slow * jerk_s * UNIT, cubic: bend };
        let fast_part = Cubic { linear: fast * jerk_s * UNIT, cubic: -bend };
        let length = (slow + fast) * half_s * UNIT;
        let is_held = half_s > jerk_s;
        let held = if is_held { above_zero(length - slow_part.at(1.0) - fast_part.at(1.0)) } else { 0.0 };
        Self {
            length,
            duration: 2.0 * half_s * UNITS_PER_SECOND,
            slow_part,
            fast_part,
            jerk_time: jerk_s * UNITS_PER_SECOND,
            held_speed: (slow + jerk_change) * SPEED_UNITS,
            gain: bounds.acceleration * (2.0 * SPEED_UNITS * SPEED_UNITS / UNIT),
            held,
        }
    }

    /// The same ramp in a shorter time, over a path shorter in proportion.
    fn scaled(&self, scale: f64) -> Self {
        Self {
            length: self.length * scale,
            duration: self.duration * scale,
            slow_part: self.slow_part.scaled(scale),
            fast_part: self.fast_part.scaled(scale),
            jerk_time: self.jerk_time * scale,
            held_speed: self.held_speed,
            gain: self.gain / scale,
            held: self.held * scale,
        }
    }
}

/// The time law of a run (Li 2017, eqs. 1 to 4, and the acceleration held where it reaches its
/// limit): seven pieces.
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    length: f64,
    /// Speed of the cruise, units of [`Speed`].
    peak: f64,
    up: Ramp,
    down: Ramp,
    /// Ends of the cruise and of the run.
    down_start: f64,
    duration: f64,
}

impl Curve {
    /// No run.
    pub(crate) const NONE: Self =
        Self { length: 0.0, peak: 1.0, up: Ramp::NONE, down: Ramp::NONE, down_start: 0.0, duration: 0.0 };

    /// The law of a run. Where its speeds want a hair more path than it has, both ramps are
    /// as much shorter.
    pub(crate) fn new(run: &Run) -> Self {
        let bounds = Bounds { jerk: run.jerk.mm_per_s3(), acceleration: run.acceleration.mm_per_s2() };
        let peak = run.peak.max(run.entry).max(run.exit).max(Speed(1));
        let length = f64::from(run.length_10nm.max(1));
        let mut up = Ramp::new(&bounds, run.entry, peak);
        let mut down = Ramp::new(&bounds, run.exit, peak);
        let ramps = up.length + down.length;
        if ramps > length {
            let scale = length / ramps;
            (up, down) = (up.scaled(scale), down.scaled(scale));
        }
        let peak = f64::from(peak.0);
        let cruise = length - up.length - down.length;
        let cruise_time = if cruise > 0.0 { cruise_time(cruise, peak) } else { 0.0 };
        let down_start = up.duration + cruise_time;
        let duration = down_start + down.duration;
        Self { length, peak, up, down, down_start, duration }
    }

    /// The pieces of the run itself.
    fn pieces(&self) -> CurvePieces {
        CurvePieces { curve: *self, offset: 0.0, rest: 0.0, next: 0 }
    }

    /// Time at a place, time units from the run's start.
    fn time_at(&self, place: &Place<f64>) -> f64 {
        if place.to_end <= 0.0 { self.duration } else { time_at(self.pieces(), place) }
    }

    /// Speed at a place.
    fn speed_at(&self, place: &Place<f64>) -> Speed {
        let speed = match piece_at(self.pieces(), place) {
            Some(piece) => match piece.motion {
                // 10 nm a time unit are this many units of speed.
                Motion::Jerk { curve, duration } if duration > 0.0 => {
                    curve.slope(curve.solve(piece.distance(place))) / duration * cruise_time(1.0, 1.0)
                }
                Motion::Accelerated { speed, gain } => (speed * speed + gain * piece.distance(place)).square_root(),
                Motion::Jerk { .. } | Motion::Constant { .. } => self.peak,
            },
            None => self.peak,
        };
        Speed(Real::to_u32(speed))
    }
}

/// The pieces of a run as one of its blocks sees them: places from the block's ends, times from the
/// run's start. Some pieces may have no length.
#[derive(Clone, Copy, Debug)]
pub struct CurvePieces {
    curve: Curve,
    /// Path from the run's start to the block's, 10 nm.
    offset: f64,
    rest: f64,
    next: u8,
}

impl Iterator for CurvePieces {
    type Item = Piece<f64>;

    fn next(&mut self) -> Option<Piece<f64>> {
        let Self { curve: Curve { length, peak, up, down, down_start, duration }, offset, rest, next } = *self;
        let leaving = |position: f64, time, motion, end| Piece::leaving(position - offset, time, motion, end);
        let arriving = |to_end: f64, time, motion, end| Piece::arriving(to_end - rest, time, motion, end);
        let from_start = |place: f64| PieceEnd::FromStart(place - offset);
        let to_end = |place: f64| PieceEnd::ToEnd(place - rest);
        let slow_part = |ramp: &Ramp| Motion::Jerk { curve: ramp.slow_part, duration: ramp.jerk_time };
        let fast_part = |ramp: &Ramp| Motion::Jerk { curve: ramp.fast_part, duration: ramp.jerk_time };
        let held_part = |ramp: &Ramp| Motion::Accelerated { speed: ramp.held_speed, gain: ramp.gain };
        self.next = next + 1;
        Some(match next {
            0 => leaving(0.0, 0.0, slow_part(&up), from_start(up.slow_part.at(1.0))),
            1 => {
                let start = up.slow_part.at(1.0);
                leaving(start, up.jerk_time, held_part(&up), from_start(start + up.held))
            }
            2 => arriving(length - up.length, up.duration, fast_part(&up), from_start(up.length)),
            3 => {
                let cruise = Motion::Constant { path: peak, time: UNITS };
                leaving(up.length, up.duration, cruise, from_start(length - down.length))
            }
            4 => {
                let end = down.slow_part.at(1.0) + down.held;
                leaving(length - down.length, down_start, fast_part(&down), to_end(end))
            }
            5 => {
                let end = down.slow_part.at(1.0);
                arriving(end, duration - down.jerk_time, held_part(&down), to_end(end))
            }
            6 => arriving(0.0, duration, slow_part(&down), PieceEnd::Last),
            _ => {
                self.next = next;
                return None;
            }
        })
    }
}

/// The law of a run along one of its blocks.
#[derive(Clone, Copy, Debug)]
pub struct Along {
    curve: Curve,
    /// The block's start in the run, units of 10 nm.
    offset: f64,
    /// The block's length.
    pub(crate) length: f64,
    /// Path from the block's end to the run's, 10 nm.
    rest: f64,
    /// Start, a whole tick, in time units from the run's start.
    pub(crate) start: u64,
    duration_ticks: u64,
}

impl Along {
    /// The block that begins this far after the run's start. It begins at the nearest tick, as the
    /// one before ends there: however many blocks a run has, nothing adds up.
    pub(crate) fn new(curve: &Curve, offset_10nm: u32, length_10nm: u32) -> Self {
        let whole = curve.length;
        let offset = f64::from(offset_10nm);
        let length = f64::from(length_10nm.max(1));
        let rest = whole - offset - length;
        let tick = |place: &Place<f64>| (Real::to_u64(curve.time_at(place)) + HALF_TICK) >> FRACTION_BITS;
        let start = if offset_10nm == 0 { 0 } else { tick(&Place { from_start: offset, to_end: whole - offset }) };
        let end = tick(&Place { from_start: offset + length, to_end: rest });
        let duration_ticks = end.saturating_sub(start);
        Self { curve: *curve, offset, length, rest, start: start << FRACTION_BITS, duration_ticks }
    }

    /// Pieces of the block. Their times count from the run's start, [`Self::start`]
    /// before the block's.
    pub(crate) fn pieces(&self) -> CurvePieces {
        CurvePieces { curve: self.curve, offset: self.offset, rest: self.rest, next: 0 }
    }

    /// Duration in whole ticks.
    pub(crate) fn duration_ticks(&self) -> u64 {
        self.duration_ticks
    }

    /// Time at a path position of the block, in time units from its start.
    pub(crate) fn time_at(&self, length_10nm: u32) -> u64 {
        let position = f64::from(length_10nm);
        let place = Place { from_start: self.offset + position, to_end: self.rest + (self.length - position) };
        Real::to_u64(self.curve.time_at(&place)).saturating_sub(self.start)
    }

    /// Speed at the block's end.
    pub(crate) fn exit(&self) -> Speed {
        self.curve.speed_at(&Place { from_start: self.offset + self.length, to_end: self.rest })
    }
}
