//! s(t) of a run, and of each of its blocks.

use super::bounds::Bounds;
use super::cubic::Cubic;
use super::run::Run;
use crate::TICKS_PER_SECOND;
use crate::block::Speed;
use crate::kinematics::UNITS_PER_MM;
use crate::offered::SCurves;
use crate::real::Real;
use crate::time_law::{FRACTION_BITS, HALF_TICK, cruise_time};

/// Time units in a second.
const PER_SECOND: f64 = TICKS_PER_SECOND as f64 * (1u64 << FRACTION_BITS) as f64;

/// A ramp: two halves of opposite jerks, each told from the end where the acceleration is zero. There its times are exact
/// however slow it is.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    /// Duration of a half, time units.
    half_time: f64,
    /// Speed at the slow end times that, units of 10 nm.
    slow: f64,
    /// Speed at the fast end times that, units of 10 nm.
    fast: f64,
    /// Part of the path that the jerk makes, j t1^3 / 6 = (fast - slow) / 6.
    cubic: f64,
}

impl Ramp {
    fn new(bounds: &Bounds<f64>, one: Speed, other: Speed) -> Self {
        let (slow, fast) = (one.min(other).mm_per_s(), one.max(other).mm_per_s());
        let seconds = bounds.half_time(slow, fast);
        let per_speed = seconds * UNITS_PER_MM as f64;
        Self {
            half_time: seconds * PER_SECOND,
            slow: slow * per_speed,
            fast: fast * per_speed,
            cubic: (fast - slow) * per_speed * (1.0 / 6.0),
        }
    }

    fn length(&self) -> f64 {
        self.slow + self.fast
    }

    /// In a shorter time, over as much shorter a path.
    fn scaled(&self, scale: f64) -> Self {
        Self {
            half_time: self.half_time * scale,
            slow: self.slow * scale,
            fast: self.fast * scale,
            cubic: self.cubic * scale,
        }
    }

    fn slow_half(&self) -> Cubic<f64> {
        Cubic { linear: self.slow, cubic: self.cubic }
    }

    fn fast_half(&self) -> Cubic<f64> {
        Cubic { linear: self.fast, cubic: -self.cubic }
    }
}

/// A part of a run in which the jerk is constant. Lengths in units of 10 nm, times in time units, from the run's start.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Piece {
    /// At a constant speed from here on.
    Cruise { start: f64, start_time: f64 },
    /// Half of a ramp that begins with no acceleration.
    From { anchor: f64, anchor_time: f64, curve: Cubic<f64>, half_time: f64 },
    /// Half of a ramp that ends with no acceleration, told backwards from there: so far before the run's end.
    To { before_end: f64, anchor_time: f64, curve: Cubic<f64>, half_time: f64 },
}

/// The time law of a run (Li 2017, eqs. 1 to 4, and the limit of acceleration).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Curve {
    length: f64,
    /// Speed of the cruise, units of [`Speed`].
    peak: f64,
    up: Ramp,
    down: Ramp,
    /// When the cruise ends, and the run.
    down_start: f64,
    duration: f64,
}

/// A place in a run: path from its start, and to its end. Not one from the other: near a standstill, a hair of path takes
/// long.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) from_start: f64,
    pub(crate) to_end: f64,
}

impl Curve {
    /// Pieces of a run, some of them perhaps without length.
    pub(crate) const PIECES: u8 = 5;

    /// No run.
    pub(crate) const NONE: Self = {
        let none = Ramp { half_time: 0.0, slow: 0.0, fast: 0.0, cubic: 0.0 };
        Self { length: 0.0, peak: 1.0, up: none, down: none, down_start: 0.0, duration: 0.0 }
    };

    /// The law of a run. Where its speeds want a hair more path than it has, both ramps are as much shorter.
    pub(crate) fn new(run: &Run) -> Self {
        let bounds = Bounds { jerk: run.jerk.mm_per_s3(), acceleration: run.acceleration.mm_per_s2() };
        let peak = run.peak.max(run.entry).max(run.exit).max(Speed(1));
        let length = f64::from(run.length_10nm.max(1));
        let mut up = Ramp::new(&bounds, run.entry, peak);
        let mut down = Ramp::new(&bounds, run.exit, peak);
        let ramps = up.length() + down.length();
        if ramps > length {
            let scale = length / ramps;
            (up, down) = (up.scaled(scale), down.scaled(scale));
        }
        let peak = f64::from(peak.0);
        let cruise = length - up.length() - down.length();
        let cruise_time = if cruise > 0.0 { cruise_time(cruise, peak) } else { 0.0 };
        let down_start = up.half_time + up.half_time + cruise_time;
        let duration = down_start + down.half_time + down.half_time;
        Self { length, peak, up, down, down_start, duration }
    }

    /// Its pieces in their order; `None` behind the last.
    pub(crate) fn piece(&self, index: u8) -> Option<Piece> {
        let Self { up, down, .. } = self;
        Some(match index {
            0 => Piece::From { anchor: 0.0, anchor_time: 0.0, curve: up.slow_half(), half_time: up.half_time },
            1 => Piece::To {
                before_end: self.length - up.length(),
                anchor_time: up.half_time + up.half_time,
                curve: up.fast_half(),
                half_time: up.half_time,
            },
            2 => Piece::Cruise { start: up.length(), start_time: up.half_time + up.half_time },
            3 => Piece::From {
                anchor: self.length - down.length(),
                anchor_time: self.down_start,
                curve: down.fast_half(),
                half_time: down.half_time,
            },
            4 => Piece::To {
                before_end: 0.0,
                anchor_time: self.duration,
                curve: down.slow_half(),
                half_time: down.half_time,
            },
            _ => return None,
        })
    }

    /// Where a piece ends, from the run's start.
    pub(crate) fn end_of(&self, index: u8) -> f64 {
        let Self { up, down, length, .. } = self;
        match index {
            0 => up.slow + up.cubic,
            1 => up.length(),
            2 => length - down.length(),
            3 => length - down.slow - down.cubic,
            _ => *length,
        }
    }

    /// Time units for a length in the cruise.
    pub(crate) fn cruise_time(&self, length: f64) -> f64 {
        cruise_time(length, self.peak)
    }

    /// The piece that a place is in.
    fn piece_at(&self, place: &Place) -> Option<Piece> {
        let last = Self::PIECES - 1;
        let index = (0..last).find(|&index| place.from_start < self.end_of(index)).unwrap_or(last);
        self.piece(index)
    }

    /// When a place is reached, time units from the run's start.
    pub(crate) fn time_at(&self, place: &Place) -> f64 {
        if place.to_end <= 0.0 {
            return self.duration;
        }
        match self.piece_at(place) {
            Some(Piece::Cruise { start, start_time }) => start_time + self.cruise_time(place.from_start - start),
            Some(Piece::From { anchor, anchor_time, curve, half_time }) => {
                anchor_time + curve.solve(place.from_start - anchor) * half_time
            }
            Some(Piece::To { before_end, anchor_time, curve, half_time }) => {
                anchor_time - curve.solve(place.to_end - before_end) * half_time
            }
            None => self.duration,
        }
    }

    /// How fast a place is passed.
    pub(crate) fn speed_at(&self, place: &Place) -> Speed {
        // 10 nm a time unit are so many units of speed.
        let of = |curve: Cubic<f64>, x: f64, half_time: f64| {
            if half_time > 0.0 { curve.slope(x) / half_time * cruise_time(1.0, 1.0) } else { self.peak }
        };
        let speed = match self.piece_at(place) {
            Some(Piece::From { anchor, curve, half_time, .. }) => {
                of(curve, curve.solve(place.from_start - anchor), half_time)
            }
            Some(Piece::To { before_end, curve, half_time, .. }) => {
                of(curve, curve.solve(place.to_end - before_end), half_time)
            }
            _ => self.peak,
        };
        Speed(Real::to_u32(speed))
    }
}

/// The law of a run along one of its blocks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Along {
    pub(crate) curve: Curve,
    /// The block's start in the run, units of 10 nm.
    pub(crate) offset: f64,
    /// The block's length.
    pub(crate) length: f64,
    /// From the block's end to the run's.
    pub(crate) rest: f64,
    /// When it begins, a whole tick, in time units from the run's start.
    pub(crate) start: u64,
    duration_ticks: u64,
    _offered: SCurves,
}

impl Along {
    /// The block that begins so far behind the run's start. It begins at the nearest tick, as the one before ends there:
    /// however many blocks a run has, nothing adds up.
    pub(crate) fn new(offered: SCurves, curve: &Curve, offset_10nm: u32, length_10nm: u32) -> Self {
        let whole = curve.length;
        let offset = f64::from(offset_10nm);
        let length = f64::from(length_10nm.max(1));
        let rest = whole - offset - length;
        let tick = |place: &Place| (Real::to_u64(curve.time_at(place)) + HALF_TICK) >> FRACTION_BITS;
        let start = if offset_10nm == 0 { 0 } else { tick(&Place { from_start: offset, to_end: whole - offset }) };
        let end = tick(&Place { from_start: offset + length, to_end: rest });
        Self {
            curve: *curve,
            offset,
            length,
            rest,
            start: start << FRACTION_BITS,
            duration_ticks: end.saturating_sub(start),
            _offered: offered,
        }
    }

    /// Duration in whole ticks.
    pub(crate) fn duration_ticks(&self) -> u64 {
        self.duration_ticks
    }

    /// A time of the run from the block's start.
    pub(crate) fn since_start(&self, time: f64) -> u64 {
        Real::to_u64(time).saturating_sub(self.start)
    }

    /// When a path position of the block is reached, in time units from its start.
    pub(crate) fn time_at(&self, length_10nm: u32) -> u64 {
        let position = f64::from(length_10nm);
        let place = Place { from_start: self.offset + position, to_end: self.rest + (self.length - position) };
        self.since_start(self.curve.time_at(&place))
    }

    /// Speed at the block's end.
    pub(crate) fn exit(&self) -> Speed {
        self.curve.speed_at(&Place { from_start: self.offset + self.length, to_end: self.rest })
    }
}
