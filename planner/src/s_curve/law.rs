//! s(t) of a run, and of each of its blocks.

use super::bounds::Bounds;
use super::run::Run;
use crate::block::Speed;
use crate::cubic::Cubic;
use crate::kinematics::UNITS_PER_MM;
use crate::piece::{Anchor, Motion, Piece, PieceEnd, Place, piece_at, time_at};
use crate::real::Real;
use crate::time_units::{FRACTION_BITS, HALF_TICK, UNITS, UNITS_PER_SECOND, cruise_time};

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
            half_time: seconds * UNITS_PER_SECOND,
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

/// The time law of a run (Li 2017, eqs. 1 to 4, and the limit of acceleration).
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    length: f64,
    /// Speed of the cruise, units of [`Speed`].
    peak: f64,
    up: Ramp,
    down: Ramp,
    /// When the cruise ends, and the run.
    down_start: f64,
    duration: f64,
}

impl Curve {
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

    /// The pieces of the run itself.
    fn pieces(&self) -> CurvePieces {
        CurvePieces { curve: *self, offset: 0.0, rest: 0.0, next: 0 }
    }

    /// When a place is passed, time units from the run's start.
    fn time_at(&self, place: &Place<f64>) -> f64 {
        if place.to_end <= 0.0 { self.duration } else { time_at(self.pieces(), place) }
    }

    /// How fast a place is passed.
    fn speed_at(&self, place: &Place<f64>) -> Speed {
        let speed = match piece_at(self.pieces(), place) {
            Some(piece) => match piece.motion {
                // 10 nm a time unit are this many units of speed.
                Motion::Jerk { curve, duration } if duration > 0.0 => {
                    curve.slope(curve.solve(piece.distance(place))) / duration * cruise_time(1.0, 1.0)
                }
                _ => self.peak,
            },
            None => self.peak,
        };
        Speed(Real::to_u32(speed))
    }
}

/// The pieces of a run as one of its blocks sees them: places from the block's ends, times from the run's start. Some
/// pieces may have no length.
#[derive(Clone, Copy, Debug)]
pub struct CurvePieces {
    curve: Curve,
    /// From the run's start to the block's, and from the block's end to the run's, 10 nm.
    offset: f64,
    rest: f64,
    next: u8,
}

impl Iterator for CurvePieces {
    type Item = Piece<f64>;

    fn next(&mut self) -> Option<Piece<f64>> {
        let Self { curve: Curve { length, peak, up, down, down_start, duration }, offset, rest, next } = *self;
        let [up_time, down_time] = [up, down].map(|ramp| ramp.half_time);
        let leaving = |position: f64, time: f64, curve, duration, end: f64| Piece {
            anchor: Anchor::Start,
            time,
            position: position - offset,
            motion: Motion::Jerk { curve, duration },
            end: PieceEnd::FromStart(end - offset),
        };
        let arriving = |to_end: f64, time: f64, curve, duration, end| Piece {
            anchor: Anchor::End,
            time,
            position: to_end - rest,
            motion: Motion::Jerk { curve, duration },
            end,
        };
        self.next = next + 1;
        Some(match next {
            0 => leaving(0.0, 0.0, up.slow_half(), up_time, up.slow + up.cubic),
            1 => {
                let end = PieceEnd::FromStart(up.length() - offset);
                arriving(length - up.length(), up_time + up_time, up.fast_half(), up_time, end)
            }
            2 => Piece {
                anchor: Anchor::Start,
                time: up_time + up_time,
                position: up.length() - offset,
                motion: Motion::Constant { path: peak, time: UNITS },
                end: PieceEnd::FromStart(length - down.length() - offset),
            },
            3 => {
                let start = length - down.length();
                leaving(start, down_start, down.fast_half(), down_time, length - down.slow - down.cubic)
            }
            4 => arriving(0.0, duration, down.slow_half(), down_time, PieceEnd::Last),
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
    /// From the block's end to the run's.
    rest: f64,
    /// When it begins, a whole tick, in time units from the run's start.
    pub(crate) start: u64,
    duration_ticks: u64,
}

impl Along {
    /// The block that begins this far after the run's start. It begins at the nearest tick, as the one before ends there:
    /// however many blocks a run has, nothing adds up.
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

    /// Its pieces. Their times count from the run's start, [`Self::start`] before the block's.
    pub(crate) fn pieces(&self) -> CurvePieces {
        CurvePieces { curve: self.curve, offset: self.offset, rest: self.rest, next: 0 }
    }

    /// Duration in whole ticks.
    pub(crate) fn duration_ticks(&self) -> u64 {
        self.duration_ticks
    }

    /// When a path position of the block is reached, in time units from its start.
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
