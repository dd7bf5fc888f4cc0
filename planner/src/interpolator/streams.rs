//! The papers' other methods: streams of steps with times of their own, merged.
//!
//! The plane has one stream of pulses, two under dual-rate; Z and the extruder have their own. All of them follow the
//! block's time law. The plane's pulses are on time: as with the default, an extruder or Z step that would come less than
//! the minimum event interval before one of them waits for it, one that would come so little behind the last event joins
//! it. Two of the plane's own join where they are as near, the later stepping early. Nothing joins across a change of
//! direction, so a motor that turns round does it no sooner than the interval behind the event before, and the signals
//! change right behind that: the profile has seen to it that pulse and set-up time fit into the interval.
//!
//! At a block's end all motors stand at its end, as every stream has made all its steps. Moves do not share blocks under
//! these methods, so that is every move's end too; a block that has several is made by the default.

use super::{FAR, Interpolator, MAX_ENTRIES, WHOLE_TICKS, Work};
use crate::EXTRUDER;
use crate::inner_ends::Stretch;
use crate::method::Method;
use crate::motion_choice::Interpolation;
use crate::spacing::MotorSteps;
use crate::step_queue::StepEntry;
use crate::step_times::StepTimes;
use crate::time_law::TimeLaw;
use crate::time_units::{FRACTION_BITS, HALF_TICK};

use super::pulses::{Due, Pulses};

/// Most entries that an event takes: the directions, and itself.
const MOST_ENTRIES_AN_EVENT: usize = 2;

/// Z's bit.
const Z: u8 = 1 << 2;

/// The streams of a block, but the extruder's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Streams {
    /// The present block is made of them.
    pub are_on: bool,
    /// X and Y: the second under dual-rate only. The first one's times are the interpolator's master's.
    plane: [Pulses; 2],
    second: StepTimes,
    z: StepTimes,
    /// Z and extruder steps that wait for the plane's next event, being near.
    waiting: u8,
}

impl Streams {
    /// None.
    pub const NONE: Self =
        Self { are_on: false, plane: [Pulses::NONE; 2], second: StepTimes::NONE, z: StepTimes::NONE, waiting: 0 };

    /// Those of a block.
    fn start(&mut self, times: &mut StepTimes, method: &Method, stretch: &Stretch, law: &TimeLaw) {
        let [x, y, z] = stretch.steps;
        let [first, second] = &mut self.plane;
        *second = Pulses::NONE;
        self.z = StepTimes::NONE;
        self.waiting = 0;
        if method.interpolation() == Interpolation::Bresenham {
            first.start_bresenham(times, law, stretch);
            return;
        }
        if method.has_two_rates(stretch.steps) {
            first.start_alone(times, law, stretch, 1, x);
            second.start_alone(&mut self.second, law, stretch, 2, y);
        } else {
            first.start_plane(times, law, stretch, method);
        }
        self.z.start(law, stretch, &MotorSteps::Even { count: z.unsigned_abs() }, HALF_TICK);
    }

    /// The plane's next event, and which of its streams has it.
    #[inline]
    fn next_of_plane(&self) -> Option<(Due, usize)> {
        match [self.plane[0].next(), self.plane[1].next()] {
            [Some(first), Some(second)] if second.time < first.time => Some((second, 1)),
            [Some(first), _] => Some((first, 0)),
            [None, second] => second.map(|due| (due, 1)),
        }
    }

    /// When Z and the extruder step next, whichever is first, and which it is.
    #[inline]
    fn next_beside(&self, extruder: &StepTimes) -> Option<(u64, u8)> {
        match (self.z.next(), extruder.next()) {
            (Some(z), Some(extruder)) if extruder < z => Some((extruder, EXTRUDER)),
            (Some(z), _) => Some((z, Z)),
            (None, extruder) => extruder.map(|due| (due, EXTRUDER)),
        }
    }
}

impl Interpolator {
    /// Begins a block that is made of streams.
    #[inline(never)]
    pub(super) fn start_streams(&mut self, stretch: &Stretch, law: &TimeLaw, extruder: &MotorSteps) {
        self.joining = 0;
        self.streams.start(&mut self.master, &self.method, stretch, law);
        self.extruder.start(law, stretch, extruder, HALF_TICK);
    }

    /// As [`Interpolator::work`], by streams.
    #[inline(never)]
    pub(super) fn work_streams(&mut self) -> Work {
        while self.entries.all().len() + MOST_ENTRIES_AN_EVENT <= MAX_ENTRIES {
            let plane = self.streams.next_of_plane();
            let beside = self.streams.next_beside(&self.extruder);
            let due = match (plane, beside) {
                (None, None) => return self.end_stretch(),
                (Some((plane, _)), Some((beside, _))) => plane.time.min(beside),
                (Some((plane, _)), None) => plane.time,
                (None, Some((beside, _))) => beside,
            };
            // From the last event to the nearest tick; wraps where that should have come before it.
            let gap = due.wrapping_add(HALF_TICK).wrapping_sub(self.last);
            if gap >= FAR && self.has_waited(gap) {
                return Work::Waited;
            }
            let (plane, stream) = match (plane, beside) {
                (Some(next), beside) if beside.is_none_or(|(beside, _)| beside >= next.0.time) => next,
                (plane, Some((_, bit))) => {
                    let times = if bit == Z { &mut self.streams.z } else { &mut self.extruder };
                    times.take(1);
                    let is_near = plane.is_some_and(|(plane, _)| plane.time - due < self.near);
                    if is_near && self.streams.waiting & bit == 0 {
                        self.streams.waiting |= bit;
                    } else {
                        self.place(due, gap, bit);
                    }
                    continue;
                }
                (_, None) => return self.end_stretch(),
            };
            let [first, second] = &mut self.streams.plane;
            if stream == 0 {
                first.advance(&mut self.master);
            } else {
                second.advance(&mut self.streams.second);
            }
            let axes = plane.axes | core::mem::take(&mut self.streams.waiting);
            let directions = self.directions & !plane.axes | plane.backwards;
            if directions != self.directions {
                self.directions = directions;
                self.entries.push(StepEntry::directions(directions));
            }
            self.place(due, gap, axes);
        }
        Work::Events
    }

    /// Adds an event, at its time or as near as another allows.
    #[inline]
    fn place(&mut self, due: u64, gap: u64, axes: u8) {
        let interval = (gap >> FRACTION_BITS) as u32;
        if gap >= FAR || interval < self.minimum_interval {
            self.place_near(axes);
            return;
        }
        self.entries.push(StepEntry::event(interval, axes));
        self.last = due.wrapping_add(HALF_TICK) & WHOLE_TICKS;
    }
}
