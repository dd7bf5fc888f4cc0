//! Interpolation: turns a time law into ordered step events.
//!
//! The motor with most steps is the master: its step k of N is due at path position (k - 1/2) S/N,
//! so that motors run from one rounded position to the next without ever being a step away from the
//! straight line. The other two follow it by step Bresenham. The extruder has its own times: it
//! steps as e(t) = e0 + lambda s(t) passes a half step, lambda = dE/S (Wu 2024, eqs. 10 and 11).

mod hot_loop;
mod pattern_merge;

use crate::block::{Block, PlannedBlock};
use crate::bresenham::MAX_STEPS;
use crate::event_buffer::{EVENTS_AT_ONCE, EventBuffer};
use crate::extruder::rounded_steps;
use crate::follower::Follower;
use crate::methods::{MotionMethods, Standard};
use crate::shaping::Standing;
use crate::spacing::MotorSteps;
use crate::step_queue::{EXTRUDER, Notice, StepEntry, StepSink};
use crate::step_times::StepTimes;
use crate::stretches::{Stretch, Stretches};
use crate::time_law::TimeLaw;
use crate::time_units::{FRACTION_BITS, HALF_TICK};

pub use crate::event_buffer::MAX_ENTRIES;

/// The bits of a time without its fraction of a tick.
const WHOLE_TICKS: u64 = !(ONE_TICK as u64 - 1);

/// A tick, in time units.
const ONE_TICK: u32 = 1 << FRACTION_BITS;

/// Flag in [`Interpolator::joining`]: the master has made no event since the move began.
const MOVE_BEGINS: u8 = 1 << 7;

/// Gap of this many time units or more exceeds a 32-bit number of ticks.
const FAR: u64 = 1 << (32 + FRACTION_BITS);

/// The remaining stretches of a block in which several moves end.
#[derive(Clone, Copy, Debug)]
struct Rest<P> {
    law: TimeLaw<P>,
    stretches: Stretches,
    /// Path position at which the present stretch ends, units of 10 nm.
    end_10nm: u32,
}

/// Turns one block at a time into step events, move by move: each *stretch* of a block has its own
/// motor steps, and all follow the block's time law.
///
/// Within a block, times are in units of 2^-16 tick from its start. They wrap: what is before it is
/// just below 2^64.
#[derive(Clone, Copy, Debug)]
pub struct Interpolator<M: MotionMethods = Standard> {
    /// Minimum number of ticks between events.
    minimum_interval: u32,
    /// An extruder step closer than this to the master's next one waits for it.
    near: u64,
    /// Motion clock at the start of the next (or present) block, in ticks.
    clock: u64,
    /// Time of the last event handed out or held, a whole tick.
    last: u64,
    /// End of the previous move, a whole tick: an extruder step due at the very start of a
    /// move stays after it.
    move_start: u64,
    /// Entries on their way out. The last of them is held back while a later event
    /// may still join it.
    entries: EventBuffer<MAX_ENTRIES>,
    /// Direction signals after the last entry.
    directions: u8,
    /// Extruder position at the end of the present (or the last) stretch.
    extruder_256ths: i64,
    is_busy: bool,
    /// Duration of the present block.
    duration_ticks: u64,
    /// Line of the move that ends with the present stretch.
    line: Option<u32>,
    /// The remaining stretches.
    rest: Option<Rest<M::Pieces>>,
    master: StepTimes<M::Pieces>,
    master_bit: u8,
    followers: [Follower; 2],
    /// Event of the master without the followers, and of the master with the first follower.
    masters_events: [StepEntry; 2],
    extruder: StepTimes<M::Pieces>,
    /// Flags for the master's next event: [`EXTRUDER`] if an extruder step close to it waits for
    /// it, and [`MOVE_BEGINS`].
    joining: u8,
    /// A step pattern other than step Bresenham.
    pattern: Option<M::Pattern>,
    /// True if the present block is made by the pattern.
    follows_pattern: bool,
}

impl<M: MotionMethods> Interpolator<M> {
    /// Interpolator at tick 0 of the motion clock, all motors forwards. Events are at least
    /// `minimum_event_interval_ticks` apart, and at least a tick.
    pub fn new(minimum_event_interval_ticks: u32) -> Self {
        let minimum_interval = minimum_event_interval_ticks.max(1);
        Self {
            minimum_interval,
            // The distance in ticks is rounded before it is compared.
            near: (u64::from(minimum_interval) << FRACTION_BITS) - HALF_TICK,
            clock: 0,
            last: 0,
            move_start: 0,
            entries: EventBuffer::NONE,
            directions: 0,
            extruder_256ths: 0,
            is_busy: false,
            duration_ticks: 0,
            line: None,
            rest: None,
            master: StepTimes::NONE,
            master_bit: 0,
            followers: [Follower::NONE; 2],
            masters_events: [StepEntry::wait(0); 2],
            extruder: StepTimes::NONE,
            joining: 0,
            pattern: None,
            follows_pattern: false,
        }
    }

    /// Sets the step pattern for later blocks; `None` for step Bresenham, the initial pattern. The
    /// block in execution keeps its pattern.
    pub fn set_pattern(&mut self, pattern: Option<M::Pattern>) {
        self.pattern = pattern;
    }

    /// True while a block is being executed.
    #[inline]
    pub fn is_busy(&self) -> bool {
        self.is_busy
    }

    /// Motion clock at the end of the present block.
    pub fn end_tick(&self) -> u64 {
        self.clock + self.duration_ticks
    }

    /// Motion clock at the end of the last finished block.
    pub fn clock(&self) -> u64 {
        self.clock
    }

    /// Discards the present block: the interpolator is as new, with the motors at rest at this tick
    /// of the motion clock, and with this extruder position and these direction signals.
    pub fn reset_to(&mut self, clock: u64, extruder_256ths: i64, directions: u8) {
        // Overwritten in place: a new value would take stack.
        let Self {
            minimum_interval: _,
            near: _,
            clock: own_clock,
            last,
            move_start,
            entries,
            directions: own_directions,
            extruder_256ths: own_extruder_256ths,
            is_busy,
            duration_ticks,
            line,
            rest,
            master,
            master_bit,
            followers,
            masters_events,
            extruder,
            joining,
            pattern: _,
            follows_pattern,
        } = self;
        (*own_clock, *own_extruder_256ths, *own_directions) = (clock, extruder_256ths, directions);
        (*last, *move_start, *duration_ticks) = (0, 0, 0);
        entries.clear();
        (*is_busy, *follows_pattern, *line, *rest) = (false, false, None, None);
        (*master, *extruder) = (StepTimes::NONE, StepTimes::NONE);
        (*master_bit, *joining) = (0, 0);
        (*followers, *masters_events) = ([Follower::NONE; 2], [StepEntry::wait(0); 2]);
    }

    /// Continues from standstill where another stepper has left the motors.
    pub(crate) fn resume(&mut self, standing: &Standing) {
        let Standing { clock, last_event, extruder_256ths, directions, .. } = *standing;
        self.reset_to(clock, extruder_256ths, directions);
        self.last = last_event.wrapping_sub(clock) << FRACTION_BITS;
    }

    /// Position and output state after the last block, for these motor steps.
    pub(crate) fn standing(&self, steps: [i32; 3]) -> Standing {
        let Self { clock, extruder_256ths, directions, .. } = *self;
        Standing { clock, last_event: self.tick(self.last), steps, extruder_256ths, directions }
    }

    /// Starts a block; the previous one must be finished. Returns the block's duration in ticks.
    #[inline]
    pub fn begin(&mut self, planned: &PlannedBlock, law: &TimeLaw<M::Pieces>, sink: &mut impl StepSink) -> u64 {
        let before = self.directions;
        self.begin_block(&planned.block, law);
        if self.directions != before {
            sink.entry(StepEntry::directions(self.directions));
        }
        self.duration_ticks
    }

    /// Begins a block without a sink: compiled once for all sinks.
    #[inline(never)]
    fn begin_block(&mut self, block: &Block, law: &TimeLaw<M::Pieces>) {
        self.is_busy = true;
        self.duration_ticks = law.duration_ticks();
        self.move_start = if (self.last as i64) > 0 { self.last } else { 0 };
        self.rest = None;
        let first = if block.inner_ends.is_empty() { Stretch::whole(block) } else { self.divide(block, law) };
        self.begin_stretch(&first, law, HALF_TICK);
    }

    /// Divides a block in which several moves end; returns its first stretch.
    #[cold]
    #[inline(never)]
    fn divide(&mut self, block: &Block, law: &TimeLaw<M::Pieces>) -> Stretch {
        let mut stretches = Stretches::of(block);
        let first = stretches.next().unwrap_or(Stretch::whole(block));
        let end_10nm = first.before_10nm.saturating_add(first.length_10nm);
        self.rest = Some(Rest { law: *law, stretches, end_10nm });
        first
    }

    /// Begins the motors' steps along a stretch, none of them due before `earliest`.
    #[inline]
    fn begin_stretch(&mut self, stretch: &Stretch, law: &TimeLaw<M::Pieces>, earliest: u64) {
        let start_256ths = self.extruder_256ths;
        let end_256ths = start_256ths + i64::from(stretch.extruder_256ths);
        let (start_steps, end_steps) = (rounded_steps(start_256ths), rounded_steps(end_256ths));
        let forward = stretch.extruder_256ths >= 0;
        let threshold = start_steps * 256 + if forward { 128 } else { -128 };
        let count = end_steps.abs_diff(start_steps) as u32;
        let extruder = MotorSteps::Extruder {
            whole: stretch.extruder_256ths.unsigned_abs(),
            first: threshold.abs_diff(start_256ths) as u32,
            count,
        };
        self.set_directions_of(stretch, count > 0);
        self.extruder_256ths = end_256ths;
        self.line = stretch.ends_move.then_some(stretch.line);
        self.joining = MOVE_BEGINS;
        if self.start_pattern(stretch, law, &extruder) {
            return;
        }
        let count = self.start_motors(stretch);
        self.master.start(law, stretch, &MotorSteps::Even { count }, earliest);
        self.extruder.start(law, stretch, &extruder, earliest);
    }

    fn set_directions_of(&mut self, stretch: &Stretch, extruder_moves: bool) {
        let mut moving = 0;
        let mut backwards = 0;
        for (index, steps) in stretch.steps.iter().enumerate() {
            moving |= u8::from(*steps != 0) << index;
            backwards |= u8::from(*steps < 0) << index;
        }
        if extruder_moves {
            moving |= EXTRUDER;
            backwards |= if stretch.extruder_256ths < 0 { EXTRUDER } else { 0 };
        }
        self.directions = self.directions & !moving | backwards;
    }

    /// Chooses the master and the followers; returns the master's steps.
    #[inline]
    fn start_motors(&mut self, stretch: &Stretch) -> u32 {
        let magnitudes = stretch.steps.map(|steps| steps.unsigned_abs().min(MAX_STEPS));
        let [x, y, z] = magnitudes;
        // Z, which rarely steps with others, is the second follower.
        let (count, master_bit, followers) = if x >= y && x >= z {
            (x, 1, [(2, y), (4, z)])
        } else if y >= z {
            (y, 2, [(1, x), (4, z)])
        } else {
            (z, 4, [(1, x), (2, y)])
        };
        self.master_bit = master_bit;
        self.followers = followers.map(|(bit, steps)| Follower::new(bit, count, steps));
        let [(first_bit, _), _] = followers;
        self.masters_events = [master_bit, master_bit | first_bit].map(|bits| StepEntry::event(0, bits));
        count
    }

    /// Makes the next events, or ends the block. Does nothing without a block.
    #[inline]
    pub fn advance(&mut self, sink: &mut impl StepSink) {
        if !self.is_busy {
            return;
        }
        let work = if self.pattern.is_some() && self.follows_pattern { self.work_pattern() } else { self.work() };
        match work {
            Work::Events => {
                sink.entries(self.entries.all_but_last());
                self.entries.keep_last();
            }
            Work::Waited => {
                sink.entries(self.entries.all());
                self.entries.clear();
            }
            Work::StretchEnded(notice) => {
                sink.entries(self.entries.all());
                self.entries.clear();
                if let Some(notice) = notice {
                    sink.notice(notice);
                }
                self.begin_next_stretch();
            }
        }
    }

    /// Continues with the next stretch of the block, if any.
    #[inline]
    fn begin_next_stretch(&mut self) {
        if self.rest.is_some() {
            self.begin_inner_stretch();
        }
    }

    #[cold]
    #[inline(never)]
    fn begin_inner_stretch(&mut self) {
        let Some(rest) = &mut self.rest else { return };
        let Some(stretch) = rest.stretches.next() else {
            self.rest = None;
            return;
        };
        rest.end_10nm = stretch.before_10nm.saturating_add(stretch.length_10nm);
        let (law, before) = (rest.law, self.directions);
        self.begin_stretch(&stretch, &law, self.move_start.wrapping_add(HALF_TICK));
        if self.directions != before {
            self.entries.push(StepEntry::directions(self.directions));
        }
    }

    /// Makes the next events, into [`Self::entries`]: the part without a sink, compiled once.
    #[inline(never)]
    fn work(&mut self) -> Work {
        let mut room = EVENTS_AT_ONCE;
        while room > 0 {
            let (master, extruder) = (self.master.next(), self.extruder.next());
            // Time from the last event to the master's step; wraps if the step was due before it.
            let behind = master.map(|due| due.wrapping_add(HALF_TICK).wrapping_sub(self.last));
            if let Some(behind) = behind.filter(|&behind| behind < FAR) {
                let (entries, has_joined) = match self.master.cruise() {
                    Some((cruise, steps)) => self.make_cruise(cruise, steps, behind, room),
                    None => match u32::try_from(behind) {
                        Ok(gap) => self.make_ramp(gap, room),
                        Err(_) => self.make_ramp(behind, room),
                    },
                };
                room -= entries;
                if entries > 0 || has_joined {
                    continue;
                }
            }
            let (due, to_master) = match (master, extruder) {
                (None, None) => return self.end_stretch(),
                (Some(master), Some(extruder)) if extruder < master => (extruder, Some(master - extruder)),
                (Some(master), _) => (master, None),
                (None, Some(extruder)) => (extruder, Some(u64::MAX)),
            };
            // Time from the last event to the nearest tick; wraps if that is earlier.
            let gap = due.wrapping_add(HALF_TICK).wrapping_sub(self.last);
            if gap >= FAR && self.has_waited(gap) {
                return Work::Waited;
            }
            room -= 1;
            let interval = (gap >> FRACTION_BITS) as u32;
            let event = if let Some(to_master) = to_master {
                self.extruder.take(1);
                if to_master < self.near {
                    // The extruder, the slower of the two, yields: it steps with the master, which
                    // stays on time.
                    self.joining |= EXTRUDER;
                    continue;
                }
                StepEntry::event(interval, EXTRUDER)
            } else {
                self.master.take(1);
                let [first, second] = &mut self.followers;
                let axes = self.master_bit | self.joining & EXTRUDER | first.pass(1) | second.pass(1);
                self.joining = 0;
                StepEntry::event(interval, axes)
            };
            if gap >= FAR || event.interval_ticks() < self.minimum_interval {
                self.place_near(event.axes());
                continue;
            }
            self.entries.push(event);
            self.last = due.wrapping_add(HALF_TICK) & WHOLE_TICKS;
        }
        Work::Events
    }

    /// Handles a gap that exceeds a 32-bit number of ticks: lets time pass, unless the gap wrapped.
    #[cold]
    #[inline(never)]
    fn has_waited(&mut self, gap: u64) -> bool {
        // The step was due before the last event.
        if gap.cast_signed() < 0 {
            return false;
        }
        self.entries.push(StepEntry::wait(u32::MAX));
        self.last = self.last.wrapping_add(u64::from(u32::MAX) << FRACTION_BITS);
        true
    }

    /// Adds an event that is too close to the previous one, or earlier: it joins that event, or
    /// waits until it is far enough.
    #[cold]
    #[inline(never)]
    fn place_near(&mut self, axes: u8) {
        if let Some(joint) = self.entries.last().and_then(|held| held.joined(axes)) {
            if let Some(held) = self.entries.last() {
                *held = joint;
            }
            return;
        }
        self.entries.push(StepEntry::event(self.minimum_interval, axes));
        self.last = self.last.wrapping_add(u64::from(self.minimum_interval) << FRACTION_BITS);
    }

    /// Ends the present stretch, all of whose steps have been made.
    #[inline(never)]
    fn end_stretch(&mut self) -> Work {
        let block_end = self.duration_ticks << FRACTION_BITS;
        let inner_end = self.rest.as_ref().filter(|rest| !rest.stretches.is_over()).map(|rest| {
            let time = rest.law.time_at(rest.end_10nm);
            time.min(block_end).saturating_add(HALF_TICK) & WHOLE_TICKS
        });
        let end = inner_end.unwrap_or(block_end);
        let gap = end.wrapping_sub(self.last);
        if gap >= FAR && self.has_waited(gap) {
            return Work::Waited;
        }
        // No step of the next move joins the last event of this one: when a move ends, its motors
        // are at its end. The end is no earlier than an event that had to keep its distance, or
        // than the end of the previous stretch.
        self.move_start = later(later(end, self.last), self.move_start);
        let tick = self.tick(self.move_start);
        let notice = self.line.map(|line| Notice::MoveEnded { tick, line });
        if inner_end.is_none() {
            self.rest = None;
            self.is_busy = false;
            self.clock += self.duration_ticks;
            self.last = self.last.wrapping_sub(block_end);
        }
        Work::StretchEnded(notice)
    }

    /// Tick of the motion clock at a time of the block, a whole tick; wraps.
    fn tick(&self, time: u64) -> u64 {
        self.clock.wrapping_add_signed(time as i64 >> FRACTION_BITS)
    }

    /// Tick of an occurrence without steps between blocks.
    pub fn notice_tick(&self) -> u64 {
        self.tick(later(self.last, 0))
    }

    /// Direction signals after the last entry.
    pub fn directions(&self) -> u8 {
        self.directions
    }
}

/// Result of [`Interpolator::work`].
enum Work {
    /// Events; another may still join the last of them.
    Events,
    /// Time passes; nothing joins the previous event.
    Waited,
    /// End of a stretch whose steps are all made: no later event joins the last. Holds the move
    /// that ends with it.
    StretchEnded(Option<Notice>),
}

/// The later of two times of a block, either of which may be before its start.
fn later(a: u64, b: u64) -> u64 {
    if (a.wrapping_sub(b) as i64) < 0 { b } else { a }
}
