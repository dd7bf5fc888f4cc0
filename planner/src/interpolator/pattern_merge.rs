//! Blocks made by another step pattern: merges its events with the steps of Z and the extruder.
//!
//! All of them follow the block's time law. The pattern's events are on time: an extruder or Z step
//! due less than the minimum event interval before one of them waits for it; one due that close
//! after the last event joins it. Two events of the pattern that are that close join, the later one
//! stepping early. Nothing joins across a change of direction, so a motor reverses no sooner than
//! the interval after the previous event, and the signals change right after that event: the
//! profile's check ensures that pulse and set-up time fit into the interval.
//!
//! At a block's end all motors have arrived, because each has made all its steps. Moves do not
//! share blocks under another pattern, so that is the end of every move; a block of several moves
//! is made by step Bresenham.

use super::{FAR, Interpolator, MAX_ENTRIES, WHOLE_TICKS, Work};
use crate::methods::{DueEvent, MotionMethods, StepPattern};
use crate::spacing::MotorSteps;
use crate::step_queue::{EXTRUDER, StepEntry};
use crate::stretches::Stretch;
use crate::time_law::TimeLaw;
use crate::time_units::{FRACTION_BITS, HALF_TICK};

/// Maximum number of entries per event: the directions, and the event itself.
const MAX_ENTRIES_AN_EVENT: usize = 2;

/// Z's bit.
const Z: u8 = 1 << 2;

impl<M: MotionMethods> Interpolator<M> {
    /// Begins a block made by the other pattern; `false` without one, or if several moves end in
    /// the block.
    #[inline]
    pub(super) fn start_pattern(&mut self, stretch: &Stretch, law: &TimeLaw<M::Pieces>, extruder: &MotorSteps) -> bool {
        self.follows_pattern = false;
        let Some(pattern) = &mut self.pattern else { return false };
        if self.rest.is_some() {
            return false;
        }
        self.follows_pattern = true;
        self.joining = 0;
        pattern.start(stretch, law);
        self.extruder.start(law, stretch, extruder, HALF_TICK);
        true
    }

    /// Time and axis of the earlier of the next steps of Z and the extruder.
    #[inline]
    fn next_beside(&self, z: Option<u64>) -> Option<(u64, u8)> {
        match (z, self.extruder.next()) {
            (Some(z), Some(extruder)) if extruder < z => Some((extruder, EXTRUDER)),
            (Some(z), _) => Some((z, Z)),
            (None, extruder) => extruder.map(|due| (due, EXTRUDER)),
        }
    }

    /// Version of [`Interpolator::work`] for the other pattern.
    #[inline(never)]
    pub(super) fn work_pattern(&mut self) -> Work {
        while self.entries.all().len() + MAX_ENTRIES_AN_EVENT <= MAX_ENTRIES {
            let Some(pattern) = &self.pattern else { return self.end_stretch() };
            let (ordered, z) = (pattern.next(), pattern.z().next());
            let beside = self.next_beside(z);
            let due = match (ordered, beside) {
                (None, None) => return self.end_stretch(),
                (Some(ordered), Some((beside, _))) => ordered.time.min(beside),
                (Some(ordered), None) => ordered.time,
                (None, Some((beside, _))) => beside,
            };
            // Time from the last event to the nearest tick; wraps if the step was due before it.
            let gap = due.wrapping_add(HALF_TICK).wrapping_sub(self.last);
            if gap >= FAR && self.has_waited(gap) {
                return Work::Waited;
            }
            match (ordered, beside) {
                (Some(event), beside) if beside.is_none_or(|(time, _)| time >= event.time) => {
                    self.place_ordered(&event, gap);
                }
                (ordered, Some((_, bit))) => {
                    if bit == EXTRUDER {
                        self.extruder.take(1);
                    } else if let Some(pattern) = &mut self.pattern {
                        pattern.z_mut().take(1);
                    }
                    let is_near = ordered.is_some_and(|event| event.time - due < self.near);
                    if is_near && self.joining & bit == 0 {
                        self.joining |= bit;
                    } else {
                        self.place(due, gap, bit);
                    }
                }
                (_, None) => return self.end_stretch(),
            }
        }
        Work::Events
    }

    /// Adds the pattern's next event, with the steps that wait for it.
    fn place_ordered(&mut self, event: &DueEvent, gap: u64) {
        if let Some(pattern) = &mut self.pattern {
            pattern.advance();
        }
        let axes = event.axes | core::mem::take(&mut self.joining);
        let directions = self.directions & !event.axes | event.backwards;
        if directions != self.directions {
            self.directions = directions;
            self.entries.push(StepEntry::directions(directions));
        }
        self.place(event.time, gap, axes);
    }

    /// Adds an event at its time, or as close to it as another event allows.
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
