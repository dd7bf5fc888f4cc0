//! Steps one after the other, with what changes kept in registers: what most instructions of a print are spent on.

use super::{FAR, Interpolator, MOVE_BEGINS, ONE_TICK};
use crate::EXTRUDER;
use crate::between::{Between, Look};
use crate::step_queue::StepEntry;
use crate::step_times::{Cruise, RampRun};
use crate::time_law::{FRACTION_BITS, HALF_TICK};

/// Most ticks that the first and the last step of a stair may be off: 0.4 us.
const STAIR_TOLERANCE: u32 = 32;

/// Time units from an event, a whole tick, to when the next one is due, half a tick included: in 32 bits, for all but slow
/// steps, or as many as it takes.
pub(super) trait Gap: Copy {
    /// Whether a step behind so many time units can be told by it, added to less than a tick.
    fn holds(units: u64) -> bool;

    /// Takes a step, so far behind the last event: how far the next one is behind it, and whether that is told.
    fn behind(self, run: &mut RampRun) -> (Self, bool);

    /// What the step taken last leaves over its tick; this is what [`Self::behind`] has given.
    fn left_over(self, run: &RampRun) -> u64;

    /// In time units.
    fn units(self) -> u64;

    /// As many ticks shorter.
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
    fn behind(self, run: &mut RampRun) -> (Self, bool) {
        let units = run.take();
        ((self & (ONE_TICK - 1)).wrapping_add(units), units <= u32::MAX - ONE_TICK)
    }

    #[inline(always)]
    fn left_over(self, run: &RampRun) -> u64 {
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
        // Faster ones go on in 32 bits.
        (u64::from(u32::MAX)..FAR - u64::from(ONE_TICK)).contains(&units)
    }

    #[inline(always)]
    fn behind(self, run: &mut RampRun) -> (Self, bool) {
        run.take();
        let units = run.units();
        ((self & u64::from(ONE_TICK - 1)).wrapping_add(units), Self::holds(units))
    }

    #[inline(always)]
    fn left_over(self, run: &RampRun) -> u64 {
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

impl Interpolator {
    /// The master's steps in a ramp, and the extruder's between them, as long as none is too near to another: at most
    /// `most` events, the master's first step `gap` time units behind the last event, half a tick included. How many
    /// events there are, and whether anything has happened.
    #[inline(never)]
    pub(super) fn run_ramp<G: Gap>(&mut self, mut gap: G, most: usize) -> (usize, bool) {
        let Some((mut run, steps)) = self.master.run() else { return (0, false) };
        let [first, second] = self.followers;
        // Up to the second follower's next step.
        let steps = steps.min(second.until().wrapping_sub(1)) as usize;
        let places = self.entries.room(most);
        let mut between =
            Between::new(&self.extruder, self.last, self.joining & EXTRUDER != 0, self.near, self.minimum_interval);
        let mut free = between.free;
        let [alone, common] = self.masters_events;
        let least = self.minimum_interval;
        let mut line = first.line();
        let mut events = 0;
        loop {
            // As many places as the master's steps will take, for nothing else is counted.
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
                    // There is a place: one of those for the master's steps.
                    if let Some(place) = places.get_mut(events) {
                        *place = StepEntry::event(ticks, EXTRUDER);
                    }
                    events += 1;
                }
                Look::TooNear => break,
            }
        }
        let steps = (events - between.steps) as u32;
        // No event has come behind a step whose successor is too far.
        let is_held = steps == 0 || G::holds(run.units());
        let behind = if is_held { gap.units() } else { gap.left_over(&run) };
        let due = between.last(free).wrapping_add(behind).wrapping_sub(HALF_TICK);
        self.master.end_run(&run, steps, due, is_held);
        let [first, second] = &mut self.followers;
        first.set_line(line);
        second.pass(steps);
        self.end_run(&between, free, events, steps > 0);
        (events, between.has_joined)
    }

    /// The same in the cruise, of which `left` steps are left, with stairs: of steps that no follower takes part in but
    /// perhaps the last, or of steps that the first one takes part in. How many entries there are, and whether anything
    /// has happened.
    ///
    /// Wu 2024; the second kind is the stairs' complement. All of a stair's steps are about where they are due, and no
    /// step of the extruder comes before the last.
    #[inline(never)]
    pub(super) fn run_cruise(&mut self, cruise: Cruise, mut left: u32, mut gap: u64, most: usize) -> (usize, bool) {
        let [mut first, mut second] = self.followers;
        let mut beyond = self.master.beyond();
        let mut between =
            Between::new(&self.extruder, self.last, self.joining & EXTRUDER != 0, self.near, self.minimum_interval);
        let mut begins = self.joining & MOVE_BEGINS != 0;
        let places = self.entries.room(most);
        let most = places.len();
        let mut places = places.iter_mut();
        let steps = left;
        while left > 0 && gap < FAR && !places.as_slice().is_empty() {
            let ticks = (gap >> FRACTION_BITS) as u32;
            let number = most - places.len();
            if ticks >= between.free {
                match between.look(&mut self.extruder, between.free, gap, number) {
                    Look::Free => {}
                    Look::Again => continue,
                    Look::Step(ticks) => {
                        let Some(place) = places.next() else { break };
                        *place = StepEntry::event(ticks, EXTRUDER);
                        gap = gap.wrapping_sub(u64::from(ticks) << FRACTION_BITS);
                        continue;
                    }
                    Look::TooNear => break,
                }
            }
            if ticks < between.least {
                break;
            }
            let Some(place) = places.next() else { break };
            let diagonal = first.diagonal();
            let width = if diagonal == 0 { first.until() } else { diagonal };
            let mut count = left.min(cruise.longest_stair).min(width).min(second.until());
            if count > 1 && cruise.ticks >= between.least && between.joint != number {
                // By how many ticks the stair's first step comes before it is due.
                let early = ticks.wrapping_sub(cruise.ticks) as i32;
                // And its last: whole ticks drift away from the interval.
                let drift = cruise.drift.wrapping_mul(count.wrapping_sub(1) as i32) >> FRACTION_BITS;
                if early.unsigned_abs() > STAIR_TOLERANCE
                    || early.wrapping_sub(drift).unsigned_abs() > STAIR_TOLERANCE
                    || begins && !is_after(between.last(between.free), cruise.ticks, self.move_start)
                {
                    count = 1;
                } else if gap.wrapping_add(cruise.interval.wrapping_mul(u64::from(count.wrapping_sub(1))))
                    >> FRACTION_BITS
                    >= u64::from(between.free)
                {
                    // Cut, so that none too many is counted, and one too few very rarely.
                    let distance = between.distance(&self.extruder).saturating_sub(gap) >> 12;
                    let interval = u32::try_from(cruise.interval >> 12).unwrap_or(u32::MAX).saturating_add(1);
                    let fitting = u32::try_from(distance).unwrap_or(u32::MAX) / interval;
                    count = fitting.saturating_add(1).min(count);
                }
            } else {
                count = 1;
            }
            let mut axes = self.master_bit;
            let mut added = second.pass(count);
            if diagonal == 0 {
                added |= first.pass(count);
            } else {
                axes |= first.bit();
                first.pass_diagonal(count);
            }
            beyond = beyond.wrapping_add(u32::from(cruise.beyond).wrapping_mul(count));
            gap = gap.wrapping_add(u64::from(beyond >> 16));
            beyond &= 0xffff;
            let passed = if count > 1 {
                // Not longer than the longest stair, which 16 bits hold.
                *place = StepEntry::of(cruise.ticks, count as u16, axes, added);
                gap = gap.wrapping_sub(i64::from(cruise.drift.wrapping_mul(count as i32)) as u64);
                u64::from(cruise.ticks) * u64::from(count)
            } else {
                *place = StepEntry::event(ticks, axes | added);
                gap = (gap & u64::from(ONE_TICK - 1)).wrapping_add(cruise.interval);
                u64::from(ticks)
            };
            between.pass(passed);
            left = left.wrapping_sub(count);
            begins = false;
        }
        let entries = most - places.len();
        let due = between.last(between.free).wrapping_add(gap).wrapping_sub(HALF_TICK);
        self.master.end_cruise(steps - left, due, beyond);
        self.followers = [first, second];
        self.end_run(&between, between.free, entries, steps > left);
        (entries, between.has_joined)
    }

    /// Takes over what a run has done besides the master's steps.
    #[inline(always)]
    fn end_run(&mut self, between: &Between, free: u32, entries: usize, has_stepped: bool) {
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

/// Whether an event so many ticks behind `last` is later than another time; any of them may be before the block's start.
fn is_after(last: u64, ticks: u32, other: u64) -> bool {
    last.wrapping_add(u64::from(ticks) << FRACTION_BITS).wrapping_sub(other) as i64 > 0
}
