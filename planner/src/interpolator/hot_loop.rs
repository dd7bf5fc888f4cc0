//! Steps one by one, with changing state kept in registers: most instructions of a print are spent
//! here. This whole file follows R1, R2 and R6 of the performance rules (docs/src/performance.md).

use super::{FAR, Interpolator, MOVE_BEGINS, ONE_TICK};
use crate::extruder_gap::{ExtruderGap, Look};
use crate::methods::MotionMethods;
use crate::step_queue::{EXTRUDER, StepEntry};
use crate::step_times::{EvenSteps, HotRamp};
use crate::time_units::{FRACTION_BITS, HALF_TICK};

/// Maximum deviation of a stair's first and last step, ticks: 0.4 us.
const STAIR_TOLERANCE: u32 = 32;

/// Limit, in ticks, of a stair's last step being due after its actual time.
const FARTHEST: u32 = STAIR_TOLERANCE + 1;

/// Bits of a cruise's interval beyond its time units.
const BITS_BEYOND: u32 = 16;

/// Time units from an event, a whole tick, to the due time of the next one, half a tick included:
/// in 32 bits for all but slow steps, otherwise in as many as needed.
pub(super) trait Gap: Copy {
    /// True if the type can hold a step after this many time units plus less than a tick.
    fn holds(units: u64) -> bool;

    /// Takes a step this far after the last event. Returns the distance of the next one after it,
    /// and true if the type holds that distance.
    fn behind(self, run: &mut HotRamp) -> (Self, bool);

    /// Fraction of a tick left over by the last step taken; `self` is the value that
    /// [`Self::behind`] returned.
    fn left_over(self, run: &HotRamp) -> u64;

    /// The gap in time units.
    fn units(self) -> u64;

    /// Shortens the gap by this many ticks.
    fn less(self, ticks: u32) -> Self;

    /// Whole ticks.
    #[inline(always)]
    fn ticks(self) -> u32 {
        (self.units() >> FRACTION_BITS) as u32
    }
}

impl Gap for u32 {
    #[inline(always)]
    fn holds(units: u64) -> bool {
        units <= u64::from(u32::MAX - ONE_TICK)
    }

    #[inline(always)]
    fn behind(self, run: &mut HotRamp) -> (Self, bool) {
        let units = run.take();
        ((self & (ONE_TICK - 1)).wrapping_add(units), units <= u32::MAX - ONE_TICK)
    }

    #[inline(always)]
    fn left_over(self, run: &HotRamp) -> u64 {
        u64::from(self.wrapping_sub(run.short_units()))
    }

    #[inline(always)]
    fn units(self) -> u64 {
        u64::from(self)
    }

    #[inline(always)]
    fn less(self, ticks: u32) -> Self {
        self.wrapping_sub(ticks << FRACTION_BITS)
    }
}

impl Gap for u64 {
    #[inline(always)]
    fn holds(units: u64) -> bool {
        // Faster steps continue in 32 bits.
        (u64::from(u32::MAX)..FAR - u64::from(ONE_TICK)).contains(&units)
    }

    #[inline(always)]
    fn behind(self, run: &mut HotRamp) -> (Self, bool) {
        run.take();
        let units = run.units();
        ((self & u64::from(ONE_TICK - 1)).wrapping_add(units), Self::holds(units))
    }

    #[inline(always)]
    fn left_over(self, run: &HotRamp) -> u64 {
        self.wrapping_sub(run.units())
    }

    #[inline(always)]
    fn units(self) -> u64 {
        self
    }

    #[inline(always)]
    fn less(self, ticks: u32) -> Self {
        self.wrapping_sub(u64::from(ticks) << FRACTION_BITS)
    }
}

impl<M: MotionMethods> Interpolator<M> {
    /// Makes the master's steps in a ramp, and the extruder's between them, as long as none is too
    /// close to another: at most `most` events, the master's first step `gap` time units after the
    /// last event, half a tick included. Returns the number of events, and true if anything has
    /// happened.
    #[inline(never)]
    pub(super) fn make_ramp<G: Gap>(&mut self, mut gap: G, most: usize) -> (usize, bool) {
        let Some((mut run, steps)) = self.master.hot_ramp() else { return (0, false) };
        let [first, second] = self.followers;
        // Steps before the second follower's next step.
        let steps = steps.min(second.until().wrapping_sub(1)) as usize;
        let places = self.entries.room(most);
        let mut between =
            ExtruderGap::new(&self.extruder, self.last, self.joining & EXTRUDER != 0, self.near, self.minimum_interval);
        let mut free = between.free;
        let [alone, common] = self.masters_events;
        let least = self.minimum_interval;
        let mut line = first.line();
        let mut events = 0;
        loop {
            // Only as many places as the master's steps will take: no other events
            // are counted here.
            let steps_left = steps.saturating_sub(events - between.steps);
            let rest = places.get_mut(events..).unwrap_or_default();
            let here = rest.len().min(steps_left);
            let mut left = rest.get_mut(..here).unwrap_or_default().iter_mut();
            while gap.ticks() < free && gap.ticks() >= least {
                let Some(place) = left.next() else { break };
                *place = if line.pass(1) { common } else { alone }.at(gap.ticks());
                free = free.wrapping_sub(gap.ticks());
                let is_held;
                (gap, is_held) = gap.behind(&mut run);
                if !is_held {
                    break;
                }
            }
            let left = left.len();
            events += here - left;
            if left == 0 || gap.ticks() < free || events > between.steps && !G::holds(run.units()) {
                break;
            }
            let look = between.look(&mut self.extruder, free, gap.units(), events);
            free = between.free;
            match look {
                Look::Free | Look::Again => {}
                Look::Step(ticks) => {
                    gap = gap.less(ticks);
                    // This place exists: it is one of those for the master's steps.
                    if let Some(place) = places.get_mut(events) {
                        *place = StepEntry::event(ticks, EXTRUDER);
                    }
                    events += 1;
                }
                Look::TooNear => break,
            }
        }
        let steps = (events - between.steps) as u32;
        // No event has come after a step whose successor is too far away.
        let is_held = steps == 0 || G::holds(run.units());
        let behind = if is_held { gap.units() } else { gap.left_over(&run) };
        let due = between.last(free).wrapping_add(behind).wrapping_sub(HALF_TICK);
        self.master.end_hot_ramp(&run, steps, due, is_held);
        let [first, second] = &mut self.followers;
        first.set_line(line);
        second.pass(steps);
        self.end_run(&between, free, events, steps > 0);
        (events, between.has_joined)
    }

    /// Makes the steps of a cruise, of which `left` are left, as stairs: runs of steps in which no
    /// follower takes part, except perhaps in the last, or in which the first follower takes part.
    /// Returns the number of entries, and true if anything has happened.
    ///
    /// Wu 2024; the second kind is the stairs' complement. All of a stair's steps are close to
    /// their due times, and no extruder step comes before the last.
    #[inline(never)]
    pub(super) fn make_cruise(&mut self, cruise: EvenSteps, mut left: u32, gap: u64, most: usize) -> (usize, bool) {
        if cruise.interval >= FAR {
            return (0, false);
        }
        let [first, mut second] = self.followers;
        let mut line = first.line();
        let mut to_second = second.until();
        let waits = self.joining & EXTRUDER != 0;
        let mut between = ExtruderGap::new(&self.extruder, self.last, waits, self.near, self.minimum_interval);
        let mut free = between.free;
        let least = self.minimum_interval;
        // In 2^-32 tick, so that whole ticks are a word: time from the last event to the master's
        // next step, interval between steps, and its excess over whole ticks.
        let mut gap = gap << BITS_BEYOND | u64::from(self.master.beyond());
        let interval = cruise.interval << BITS_BEYOND | u64::from(cruise.beyond);
        let surplus = interval as i32;
        let longest = if cruise.ticks >= least { cruise.longest_stair } else { 1 };
        // The next event is not a stair if an extruder step waits for it, or if the previous move
        // would end in it.
        let mut begins = self.joining & MOVE_BEGINS != 0;
        let mut is_single = waits;
        let [alone, common] = self.masters_events;
        let ending = alone.with_added(first.bit());
        let places = self.entries.room(most);
        let steps = left;
        let mut events = 0;
        while left > 0 {
            is_single |= begins && !is_after(between.last(free), cruise.ticks, self.move_start);
            let mut longest_now = if is_single { 1 } else { longest };
            let until = left.min(to_second);
            let mut to_go = until;
            let rest = places.get_mut(events..).unwrap_or_default();
            let here = rest.len();
            let mut rest = rest.iter_mut();
            while to_go > 0 && gap_ticks(gap) < free && gap_ticks(gap) >= least {
                let Some(place) = rest.next() else { break };
                let ticks = gap_ticks(gap);
                let diagonal = line.diagonal();
                let width = if diagonal == 0 { line.width() } else { diagonal };
                let mut count = width.min(to_go).min(longest_now);
                longest_now = longest;
                // Ticks by which the stair's first step comes early.
                let early = ticks.wrapping_sub(cruise.ticks);
                if count > 1 {
                    // Likewise for its last step: whole ticks drift away from the interval.
                    let others = count.wrapping_sub(1);
                    let drift = cruise.drift.wrapping_mul(others as i32) >> FRACTION_BITS;
                    if !is_tolerable(early) || !is_tolerable(early.wrapping_sub(drift as u32)) {
                        count = 1;
                    } else if free.wrapping_sub(ticks) <= cruise.ticks.wrapping_mul(others).wrapping_add(FARTHEST) {
                        let units = [gap >> BITS_BEYOND, cruise.interval];
                        count = between.fitting(&self.extruder, free, units, count);
                        if count > 1 {
                            free = between.free_for(cruise.ticks.wrapping_mul(count));
                        }
                    }
                }
                if count > 1 {
                    let event = if diagonal > 0 {
                        line.pass_diagonal(count);
                        common
                    } else if line.pass(count) {
                        ending
                    } else {
                        alone
                    };
                    *place = event.at(cruise.ticks).times(count);
                    gap = gap.wrapping_add((i64::from(surplus) * i64::from(count as i32)) as u64);
                    free = free.wrapping_sub(cruise.ticks.wrapping_mul(count));
                } else {
                    *place = if line.pass(1) { common } else { alone }.at(ticks);
                    gap = u64::from(gap as u32).wrapping_add(interval);
                    free = free.wrapping_sub(ticks);
                }
                to_go = to_go.wrapping_sub(count);
            }
            let places_left = rest.len();
            events += here - places_left;
            let passed = until.wrapping_sub(to_go);
            left = left.wrapping_sub(passed);
            if passed > 0 {
                (is_single, begins) = (false, false);
                to_second = to_second.wrapping_sub(passed);
                let axes = second.pass(passed);
                if axes != 0 {
                    // The step joins the last of these events.
                    to_second = second.until();
                    if let Some(place) = events.checked_sub(1).and_then(|last| places.get_mut(last)) {
                        *place = place.joined(axes).unwrap_or(*place);
                    }
                }
            }
            if left == 0 || places_left == 0 {
                break;
            }
            if to_go == 0 {
                continue;
            }
            if gap_ticks(gap) < free {
                break;
            }
            let look = between.look(&mut self.extruder, free, gap >> BITS_BEYOND, events);
            free = between.free;
            match look {
                Look::Free => {}
                Look::Again => is_single = true,
                Look::Step(ticks) => {
                    gap = gap.wrapping_sub(u64::from(ticks) << 32);
                    if let Some(place) = places.get_mut(events) {
                        *place = StepEntry::event(ticks, EXTRUDER);
                        events += 1;
                    }
                }
                Look::TooNear => break,
            }
        }
        let due = between.last(free).wrapping_add(gap >> BITS_BEYOND).wrapping_sub(HALF_TICK);
        self.master.end_cruise(steps.wrapping_sub(left), due, gap as u32 & 0xffff);
        let mut first = first;
        first.set_line(line);
        self.followers = [first, second];
        self.end_run(&between, free, events, steps > left);
        (events, between.has_joined)
    }

    /// Takes over the results of a run besides the master's steps.
    #[inline(always)]
    fn end_run(&mut self, between: &ExtruderGap, free: u32, entries: usize, has_stepped: bool) {
        self.last = between.last(free);
        self.entries.filled(entries);
        if has_stepped {
            self.joining = 0;
        }
        if between.joint < entries {
            self.entries.join(entries - between.joint, EXTRUDER);
        } else if between.joint < usize::MAX {
            self.joining |= EXTRUDER;
        }
    }
}

/// Whole ticks of a gap in the cruise.
#[inline(always)]
fn gap_ticks(gap: u64) -> u32 {
    (gap >> 32) as u32
}

/// True if a step of a stair may be this many ticks off; wraps if it is too early.
#[inline(always)]
fn is_tolerable(ticks: u32) -> bool {
    ticks.wrapping_add(STAIR_TOLERANCE) <= 2 * STAIR_TOLERANCE
}

/// True if an event this many ticks after `last` is later than another time; any of them may be
/// before the block's start.
fn is_after(last: u64, ticks: u32, other: u64) -> bool {
    last.wrapping_add(u64::from(ticks) << FRACTION_BITS).wrapping_sub(other) as i64 > 0
}
