//! A time law in, ordered step events out.
//!
//! The motor with most steps is the master: its step k of N is due at path position (k - 1/2) S/N, so that motors
//! run from one rounded position to the next without ever being a step away from the straight line. The other two
//! follow it by step Bresenham. The extruder has times of its own: it steps where e(t) = e0 + lambda s(t) passes a
//! half step, lambda = dE/S (Wu 2024, eqs. 10 and 11).

use crate::bresenham::{MAX_STEPS, StepBresenham};
use crate::extruder::rounded_steps;
use crate::inner_ends::{InnerEnd, InnerEnds};
use crate::kinematics::UNITS_PER_MM;
use crate::step_queue::{Notice, StepEntry, StepSink};
use crate::step_times::{FRACTION_BITS, StepTimes};
use crate::time_law::TimeLaw;
use crate::{EXTRUDER, PlannedBlock, TICKS_PER_SECOND};

/// Most entries a single [`Interpolator::advance`] or [`Interpolator::begin`] hands to its sink.
pub const MAX_ENTRIES: usize = 2;

/// Most steps in one stair. Its one interval is rounded to a tick, so its steps are at most half as many ticks off.
const LONGEST_STAIR: u32 = 64;

/// Turns one block at a time into step events.
#[derive(Clone, Copy, Debug)]
pub struct Interpolator {
    minimum_interval: u64,
    /// Motion clock at the start of the next (or present) block.
    clock: u64,
    /// Tick of the last event handed out or held.
    last_event: u64,
    /// First tick that belongs to the present move: an extruder step due at its very start stays behind the end of the
    /// move before.
    move_start: u64,
    /// The last event is held back while a later one may still join it.
    held: Option<Stair>,
    /// The direction signals as they stand.
    directions: u8,
    /// Extruder position at the start of the next (or present) block.
    extruder_256ths: i64,
    run: Option<Run>,
}

#[derive(Clone, Copy, Debug)]
struct Stair {
    interval: u32,
    count: u16,
    axes: u8,
    added: u8,
}

impl Stair {
    fn entry(self) -> Option<StepEntry> {
        StepEntry::stair(self.interval, self.count, self.axes, self.added)
    }
}

/// The block that is being executed.
#[derive(Clone, Copy, Debug)]
struct Run {
    end: u64,
    extruder_end_256ths: i64,
    master: StepTimes,
    master_bit: u8,
    followers: [Follower; 2],
    extruder: StepTimes,
    /// [`EXTRUDER`] when its step waits for the master's next one, which is near.
    joining: u8,
    line: Option<u32>,
    /// Where moves end inside, and what tells where the motors stand there; `None` in all but merged blocks.
    inside: Option<Inside>,
}

/// The moves that end inside the present block.
#[derive(Clone, Copy, Debug)]
struct Inside {
    law: TimeLaw,
    ends: InnerEnds,
    /// How many of them have been passed.
    passed: usize,
    /// Line of the block's last move.
    line: u32,
    length_10nm: u32,
    master_steps: u32,
    /// Travel of the extruder in the block, either way, 1/256 steps.
    extruder_256ths: u32,
    /// The travel up to its first step.
    extruder_first_256ths: u32,
}

impl Inside {
    fn next(&self) -> Option<InnerEnd> {
        self.ends.iter(self.line).nth(self.passed)
    }

    /// Steps of the master up to the next end, by the rule that its step k of N is due at (k - 1/2) S/N.
    fn master_steps(&self) -> u32 {
        let Some(end) = self.next() else { return u32::MAX };
        let (length, whole) = (u64::from(end.length_10nm), u64::from(self.length_10nm.max(1)));
        let steps = (2 * u64::from(self.master_steps) * length + whole) / (2 * whole);
        u32::try_from(steps).unwrap_or(u32::MAX)
    }

    /// Steps of the extruder up to the next end.
    fn extruder_steps(&self) -> u32 {
        let Some(end) = self.next() else { return u32::MAX };
        let travel = u64::from(self.extruder_256ths) * u64::from(end.length_10nm) / u64::from(self.length_10nm.max(1));
        match travel.checked_sub(u64::from(self.extruder_first_256ths)) {
            Some(beyond_first) => u32::try_from(beyond_first / 256 + 1).unwrap_or(u32::MAX),
            None => 0,
        }
    }
}

impl Run {
    /// The motors step up to the next end of a move inside the block.
    fn limit_to_next_end(&mut self) {
        if let Some(inside) = &self.inside {
            self.master.limit(inside.master_steps());
            self.extruder.limit(inside.extruder_steps());
        }
    }
}

/// A motor that steps with some of the master's steps.
#[derive(Clone, Copy, Debug)]
struct Follower {
    bit: u8,
    stairs: StepBresenham,
    /// Master steps up to and including the next common one.
    until: u32,
}

impl Follower {
    fn new(bit: u8, master_steps: u32, steps: u32) -> Self {
        let mut stairs = StepBresenham::new(master_steps, steps).unwrap_or(StepBresenham::level());
        let until = stairs.next().unwrap_or(u32::MAX);
        Self { bit, stairs, until }
    }

    /// Passes `count` master steps, at most `until`; the motor's bit if it steps with the last of them.
    fn pass(&mut self, count: u32) -> u8 {
        if self.until == u32::MAX {
            return 0;
        }
        self.until -= count;
        if self.until > 0 {
            return 0;
        }
        self.until = self.stairs.next().unwrap_or(u32::MAX);
        self.bit
    }
}

impl Interpolator {
    /// An interpolator at tick 0 of the motion clock, all motors forwards.
    pub fn new(minimum_event_interval_ticks: u32) -> Self {
        Self {
            minimum_interval: u64::from(minimum_event_interval_ticks),
            clock: 0,
            last_event: 0,
            move_start: 0,
            held: None,
            directions: 0,
            extruder_256ths: 0,
            run: None,
        }
    }

    /// Whether a block is being executed.
    pub fn is_busy(&self) -> bool {
        self.run.is_some()
    }

    /// Motion clock at the end of the last finished block.
    pub fn clock(&self) -> u64 {
        self.clock
    }

    /// Starts a block; the one before must be finished. Returns the block's duration in ticks.
    pub fn begin(&mut self, planned: &PlannedBlock, law: &TimeLaw, sink: &mut impl StepSink) -> u64 {
        let block = &planned.block;
        let magnitudes = block.steps.map(|steps| steps.unsigned_abs().min(MAX_STEPS));
        let master = match magnitudes {
            [x, y, z] if x >= y && x >= z => 0,
            [_, y, z] if y >= z => 1,
            _ => 2,
        };
        let count = magnitudes[master];
        let length_mm = block.length_mm();
        let spacing = length_mm / f64::from(count.max(1));
        let follower = |index: usize| Follower::new(1 << index, count, magnitudes[index]);

        let start_256ths = self.extruder_256ths;
        let end_256ths = start_256ths + i64::from(block.extruder_256ths);
        let extruder_steps = rounded_steps(end_256ths).abs_diff(rounded_steps(start_256ths)) as u32;
        let forward = block.extruder_256ths >= 0;
        let threshold = rounded_steps(start_256ths) * 256 + if forward { 128 } else { -128 };
        let mm_per_256th = length_mm / f64::from(block.extruder_256ths.unsigned_abs().max(1));
        let first_256ths = threshold.abs_diff(start_256ths) as u32;
        let first = f64::from(first_256ths) * mm_per_256th;

        let mut moving = 0;
        let mut backwards = 0;
        for (index, steps) in block.steps.iter().enumerate() {
            moving |= u8::from(*steps != 0) << index;
            backwards |= u8::from(*steps < 0) << index;
        }
        if extruder_steps > 0 {
            moving |= EXTRUDER;
            backwards |= if forward { 0 } else { EXTRUDER };
        }
        let directions = self.directions & !moving | backwards;
        if directions != self.directions {
            self.directions = directions;
            sink.entry(StepEntry::directions(directions));
        }

        let duration = (law.duration_s * f64::from(TICKS_PER_SECOND) + 0.5) as u64;
        self.move_start = self.notice_tick() + 1;
        let inside = (!block.inner_ends.is_empty()).then(|| Inside {
            law: *law,
            ends: block.inner_ends,
            passed: 0,
            line: block.line,
            length_10nm: block.length_10nm,
            master_steps: count,
            extruder_256ths: block.extruder_256ths.unsigned_abs(),
            extruder_first_256ths: first_256ths,
        });
        let mut run = Run {
            end: self.clock + duration,
            extruder_end_256ths: end_256ths,
            master: StepTimes::new(law, spacing * 0.5, spacing, count),
            master_bit: 1 << master,
            followers: [follower((master + 1) % 3), follower((master + 2) % 3)],
            extruder: StepTimes::new(law, first, 256.0 * mm_per_256th, extruder_steps),
            joining: 0,
            line: block.ends_move.then_some(block.line),
            inside,
        };
        run.limit_to_next_end();
        self.run = Some(run);
        duration
    }

    /// Works out the next event or stair, or ends the block. Does nothing without one.
    #[inline]
    pub fn advance(&mut self, sink: &mut impl StepSink) {
        let Some(run) = self.run.as_mut() else { return };
        let master = run.master.next_time();
        let extruder = run.extruder.next_time();
        let Some(due) = master.into_iter().chain(extruder).min() else {
            if run.inside.is_some_and(|inside| inside.next().is_some()) {
                self.end_inside(sink);
            } else {
                self.finish(sink);
            }
            return;
        };
        let tick = self.clock + rounded_tick(due);
        if tick.saturating_sub(self.last_event) > u64::from(u32::MAX) {
            self.hand_out(sink);
            sink.entry(StepEntry::wait(u32::MAX));
            self.last_event += u64::from(u32::MAX);
            return;
        }
        if master != Some(due) {
            run.extruder.take(1);
            if master.is_some_and(|master| rounded_tick(master - due) < self.minimum_interval) {
                // The extruder, the slower of the two, gives way: it steps with the master, which stays on time.
                run.joining = EXTRUDER;
            } else {
                self.place(tick, EXTRUDER, sink);
            }
            return;
        }
        if let Some(stair) =
            cruise_stair(run, due, extruder, self.clock, self.last_event, self.move_start, self.minimum_interval)
        {
            run.master.take(u32::from(stair.count));
            self.hand_out(sink);
            self.last_event += u64::from(stair.interval) * u64::from(stair.count);
            self.held = Some(stair);
            return;
        }
        run.master.take(1);
        let own = run.master_bit | core::mem::take(&mut run.joining);
        let axes = run.followers.iter_mut().fold(own, |axes, follower| axes | follower.pass(1));
        self.place(tick, axes, sink);
    }

    /// Adds an event: it joins the one before if that is too near, or waits until it is far enough.
    #[inline]
    fn place(&mut self, tick: u64, axes: u8, sink: &mut impl StepSink) {
        let earliest = self.last_event + self.minimum_interval;
        if tick < earliest
            && let Some(held) = self.held.as_mut()
            && (held.axes | held.added) & axes == 0
        {
            if held.count == 1 {
                held.axes |= axes;
            } else {
                held.added |= axes;
            }
            return;
        }
        let tick = tick.max(earliest).max(self.move_start);
        self.hand_out(sink);
        self.held = Some(Stair { interval: (tick - self.last_event) as u32, count: 1, axes, added: 0 });
        self.last_event = tick;
    }

    #[inline]
    fn hand_out(&mut self, sink: &mut impl StepSink) {
        if let Some(entry) = self.held.take().and_then(Stair::entry) {
            sink.entry(entry);
        }
    }

    /// Ends a move inside the block: all steps up to it have been made.
    fn end_inside(&mut self, sink: &mut impl StepSink) {
        self.hand_out(sink);
        let Some(run) = self.run.as_mut() else { return };
        let Some(inside) = run.inside.as_mut() else { return };
        let Some(end) = inside.next() else { return };
        let seconds = inside.law.time_at(f64::from(end.length_10nm) / UNITS_PER_MM as f64);
        let ticks = (seconds * f64::from(TICKS_PER_SECOND) + 0.5) as u64;
        inside.passed += 1;
        run.limit_to_next_end();
        // Not before an event that had to keep its distance, nor before the end that was told last.
        let tick = (self.clock + ticks).min(run.end).max(self.last_event).max(self.move_start - 1);
        self.move_start = tick + 1;
        sink.notice(Notice::MoveEnded { tick, line: end.line });
    }

    fn finish(&mut self, sink: &mut impl StepSink) {
        // Nothing of the next block joins the last event of this one: at a move's end the motors stand at its end.
        self.hand_out(sink);
        if let Some(run) = self.run.take() {
            self.clock = run.end;
            self.extruder_256ths = run.extruder_end_256ths;
            if let Some(line) = run.line {
                sink.notice(Notice::MoveEnded { tick: run.end.max(self.last_event), line });
            }
        }
    }

    /// Tick at which something without steps happens between the blocks.
    pub fn notice_tick(&self) -> u64 {
        self.clock.max(self.last_event)
    }

    /// Forgets the present block; the motors stood still at `clock`, and the extruder is here.
    pub fn abandon(&mut self, clock: u64, extruder_256ths: i64) {
        self.run = None;
        self.held = None;
        self.clock = clock;
        self.last_event = clock;
        self.extruder_256ths = extruder_256ths;
    }

    /// The direction signals as they will stand after the last entry.
    pub fn directions(&self) -> u8 {
        self.directions
    }

    /// Takes over the direction signals as they stand after an abandoned block.
    pub fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
    }
}

/// Nearest tick to a time in units of 2^-16 tick.
#[inline]
fn rounded_tick(time: u64) -> u64 {
    (time + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS
}

/// The stair that starts with the master's next step, if two steps or more fit into one: all in the cruise, no
/// follower before the last, no extruder step before the last, and the event before about one interval away.
#[inline]
fn cruise_stair(
    run: &mut Run,
    due: u64,
    extruder: Option<u64>,
    clock: u64,
    last_event: u64,
    move_start: u64,
    minimum_interval: u64,
) -> Option<Stair> {
    let (interval, left) = run.master.cruise()?;
    let mut count = left.min(LONGEST_STAIR).min(run.followers[0].until).min(run.followers[1].until);
    if count < 2 || run.joining != 0 {
        return None;
    }
    let tolerance = u64::from(LONGEST_STAIR / 2);
    let gap = (clock + rounded_tick(due)).checked_sub(last_event)?;
    if gap.abs_diff(rounded_tick(interval)) > tolerance {
        return None;
    }
    if let Some(extruder) = extruder
        && extruder < due + interval * u64::from(count - 1)
    {
        count = ((extruder - due) / interval.max(1)) as u32 + 1;
        if count < 2 {
            return None;
        }
    }
    let last = clock + rounded_tick(due + interval * u64::from(count - 1));
    let events = u64::from(count);
    let rounded = (last - last_event + events / 2) / events;
    // The rounded interval must not take the first step before a move's end.
    if rounded < minimum_interval || rounded > u64::from(u32::MAX) || last_event + rounded < move_start {
        return None;
    }
    let added = run.followers.iter_mut().fold(0, |added, follower| added | follower.pass(count));
    Some(Stair { interval: rounded as u32, count: count as u16, axes: run.master_bit, added })
}
