//! Stepping of filtered positions: turns them into ordered step events, every motor
//! in its own time.
//!
//! Time advances in windows, within which every motor follows one polynomial and none turns. A
//! window's ends are worked out afresh from the plan, so nothing drifts; within it each motor's
//! steps are solved for, and the four streams merge. Steps that are nearer than the least interval
//! to an event join it.

use super::fixed;
use super::machine_filters::Shaping;
use super::motor_states::MotorStates;
use super::motor_steps::{MotorSteps, NEVER, WindowMotion};
use super::plan::Plan;
use super::taps::Taps;
use crate::block::PlannedBlock;
use crate::event_buffer::EventBuffer;
use crate::extruder::rounded_steps;
use crate::kinematics::Kinematics;
use crate::pieces::Pieces;
use crate::pressure_advance::AdvanceLaw;
use crate::step_queue::{Notice, StepEntry, StepSink};
use crate::time_law::TimeLaw;

/// Events worked out in one call of [`ShapedStepper::advance`]. Few, since they take memory.
const EVENTS_AT_ONCE: usize = 16;

/// The longest window, ticks: single precision holds its times to a quarter of a tick.
const LONGEST_WINDOW_TICKS: u64 = 1 << 22;

/// Motor positions and state of the output: one stepper hands it to the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Standing {
    /// Motion clock, ticks.
    pub clock: u64,
    /// Tick of the last event.
    pub last_event: u64,
    /// X, Y and Z (A, B, Z).
    pub steps: [i32; 3],
    /// The extruder, 1/256 steps.
    pub extruder_256ths: i64,
    /// The direction signals.
    pub directions: u8,
}

/// Makes the steps of filtered motion, from standstill to standstill.
#[derive(Clone, Debug)]
pub(crate) struct ShapedStepper {
    taps: Taps,
    plan: Plan,
    /// Minimum number of ticks between events.
    minimum_interval: u32,
    /// The motors have not come to rest at the end of the plan.
    is_in_motion: bool,
    /// A block, or the rest at the end, is being executed.
    is_busy: bool,
    /// The present window, ticks.
    window: [u64; 2],
    /// Positions at the end of the window, 2^-32 step.
    positions: [i64; 4],
    /// The extruder's counts from [`Self::extruder_zero`].
    motors: [MotorSteps; 4],
    /// Extruder position at the window's start, steps.
    extruder_zero: i64,
    /// Number of the first piece that has not ended.
    ending: u32,
    entries: EventBuffer<{ EVENTS_AT_ONCE + 1 }>,
    /// Tick of the last event handed out or held.
    last: u64,
    directions: u8,
}

impl ShapedStepper {
    /// New stepper, at standstill.
    pub fn new(minimum_event_interval_ticks: u32, kinematics: Kinematics) -> Self {
        Self {
            taps: Taps::new(kinematics),
            plan: Plan::new(),
            minimum_interval: minimum_event_interval_ticks.max(1),
            is_in_motion: false,
            is_busy: false,
            window: [0; 2],
            positions: [0; 4],
            motors: [MotorSteps::standing(0); 4],
            extruder_zero: 0,
            ending: 0,
            entries: EventBuffer::NONE,
            last: 0,
            directions: 0,
        }
    }

    /// Sets the filters, at standstill.
    pub fn set_shaping(&mut self, shaping: &Shaping) {
        self.taps.set(shaping);
    }

    /// Sets how the extruder advances in the blocks to come.
    pub fn set_advance(&mut self, advance: AdvanceLaw) {
        self.plan.advance = advance;
    }

    /// The longest delay, ticks: so long after the end of the plan the motors rest.
    pub fn length_ticks(&self) -> u32 {
        self.taps.length_ticks()
    }

    /// True while the motors have not come to rest.
    pub fn is_in_motion(&self) -> bool {
        self.is_in_motion
    }

    /// True if the motors rest, to the last step.
    pub fn is_at_rest(&self) -> bool {
        !self.is_in_motion && !self.is_busy
    }

    /// True while a block, or the rest at the end, is being executed.
    pub fn is_busy(&self) -> bool {
        self.is_busy
    }

    /// The end of the plan so far, a tick of the motion clock.
    pub fn end_tick(&self) -> u64 {
        self.plan.end
    }

    /// Forgets all motion.
    pub fn clear(&mut self) {
        self.is_in_motion = false;
        self.is_busy = false;
        self.entries.clear();
    }

    /// Takes over from standstill.
    pub fn start(&mut self, standing: &Standing) {
        let Standing { clock, last_event, steps, extruder_256ths, directions } = *standing;
        self.plan.start(clock, steps, extruder_256ths);
        self.taps.rewind();
        self.ending = 0;
        self.is_in_motion = true;
        self.window = [clock; 2];
        let [x, y, z] = steps.map(i64::from);
        self.motors = [x, y, z, 0].map(MotorSteps::standing);
        self.extruder_zero = rounded_steps(extruder_256ths);
        let rest_256ths = extruder_256ths.wrapping_sub(self.extruder_zero.wrapping_mul(256));
        let [x, y, z] = [x, y, z].map(fixed::of_steps);
        self.positions = [x, y, z, fixed::of_256ths(rest_256ths as i32)];
        self.entries.clear();
        self.last = last_event;
        self.directions = directions;
    }

    /// Tick at which something without steps happens between the blocks.
    pub fn notice_tick(&self) -> u64 {
        let [_, now] = self.window;
        now.max(self.last)
    }

    /// Position and output state at rest.
    pub fn standing(&self) -> Standing {
        Standing {
            clock: self.plan.end,
            last_event: self.last,
            steps: self.plan.steps,
            extruder_256ths: self.plan.extruder_256ths,
            directions: self.directions,
        }
    }

    /// Adds a block to the plan. Returns its duration in ticks.
    pub fn begin<P: Pieces>(&mut self, planned: &PlannedBlock, law: &TimeLaw<P>) -> u64 {
        self.is_busy = true;
        self.plan.add(planned, law)
    }

    /// Continues after the end of the plan until the motors rest. Returns how many
    /// ticks that takes.
    pub fn begin_rest(&mut self) -> u64 {
        let length = self.taps.length_ticks();
        self.plan.rest(length);
        self.is_busy = true;
        self.is_in_motion = false;
        u64::from(length)
    }

    /// Works out the next events, or ends the block.
    pub fn advance(&mut self, sink: &mut impl StepSink) {
        match self.work() {
            Work::Events => {
                sink.entries(self.entries.all_but_last());
                self.entries.keep_last();
            }
            Work::Waited => {
                sink.entries(self.entries.all());
                self.entries.clear();
            }
            Work::MoveEnded(notice) => {
                sink.entries(self.entries.all());
                self.entries.clear();
                sink.notice(notice);
            }
            Work::BlockEnded => {
                sink.entries(self.entries.all());
                self.entries.clear();
                self.is_busy = false;
            }
        }
    }

    /// The part without a sink, compiled once.
    #[inline(never)]
    fn work(&mut self) -> Work {
        let mut room = EVENTS_AT_ONCE;
        // An event may need a change of directions before it.
        while room > 1 {
            let (motor, due) = self.earliest();
            if due == NEVER {
                if let Some(notice) = self.next_notice() {
                    return Work::MoveEnded(notice);
                }
                let [_, end] = self.window;
                if end >= self.plan.end {
                    return Work::BlockEnded;
                }
                self.begin_window();
                continue;
            }
            let [start, _] = self.window;
            let tick = start.wrapping_add(u64::from(due));
            let after_last = tick.wrapping_sub(self.last).cast_signed();
            if after_last > i64::from(u32::MAX) {
                self.entries.push(StepEntry::wait(u32::MAX));
                self.last = self.last.wrapping_add(u64::from(u32::MAX));
                return Work::Waited;
            }
            room = room.saturating_sub(self.add_event(motor, due, after_last));
        }
        Work::Events
    }

    /// The motor that steps next, and when, ticks from the window's start.
    #[inline]
    fn earliest(&self) -> (usize, u32) {
        let earlier = |one: (usize, u32), other: (usize, u32)| if other.1 < one.1 { other } else { one };
        let [x, y, z, extruder] = &self.motors;
        earlier(earlier((0, x.due), (1, y.due)), earlier((2, z.due), (3, extruder.due)))
    }

    /// Adds the step of a motor, and those that join it; returns for how many entries.
    #[inline]
    fn add_event(&mut self, motor: usize, due: u32, after_last: i64) -> usize {
        let mut axes = 0;
        let mut directions = self.directions;
        let least = i64::from(self.minimum_interval);
        let is_near = after_last < least;
        // Steps that are practically due join it; a near event takes only the one that is due.
        let (streams, mut bit) = if is_near {
            let one = self.motors.get_mut(motor..).and_then(|streams| streams.get_mut(..1));
            (one.unwrap_or_default(), 1_u8.wrapping_shl(motor as u32))
        } else {
            (self.motors.as_mut_slice(), 1)
        };
        for stream in streams {
            if stream.due.wrapping_sub(due) < self.minimum_interval {
                axes |= bit;
                directions = if stream.is_backwards { directions | bit } else { directions & !bit };
                stream.take();
            }
            bit = bit.wrapping_shl(1);
        }
        let turns = directions != self.directions;
        if is_near
            && !turns
            && let Some(joint) = self.entries.last().and_then(|held| held.joined(axes))
        {
            if let Some(held) = self.entries.last() {
                *held = joint;
            }
            return 0;
        }
        if turns {
            self.entries.push(StepEntry::directions(directions));
            self.directions = directions;
        }
        let interval = if is_near { least } else { after_last };
        self.entries.push(StepEntry::event(interval as u32, axes));
        self.last = self.last.wrapping_add_signed(interval);
        1 + usize::from(turns)
    }

    /// The next move that has ended by the end of the window.
    fn next_notice(&mut self) -> Option<Notice> {
        let [_, now] = self.window;
        loop {
            let piece = self.plan.ring.get(self.ending)?;
            let end = match self.plan.ring.get(self.ending.wrapping_add(1)) {
                Some(next) => next.start,
                None => self.plan.end,
            };
            if end > now {
                return None;
            }
            let (line, ends_move) = (piece.source_line, piece.ends_move);
            self.ending = self.ending.wrapping_add(1);
            if ends_move {
                return Some(Notice::MoveEnded { tick: end.max(self.last), line });
            }
        }
    }

    /// Begins the next window: up to where a filter sees another piece of the plan,
    /// or a motor turns.
    #[inline(never)]
    fn begin_window(&mut self) {
        let [_, start] = self.window;
        let [.., extruder] = &mut self.motors;
        let moved = core::mem::take(&mut extruder.steps);
        self.extruder_zero = self.extruder_zero.wrapping_add(moved);
        let [.., extruder] = &mut self.positions;
        *extruder = extruder.wrapping_sub(fixed::of_steps(moved));
        let [x, y, z, _] = self.motors.each_ref().map(|motor| motor.steps);
        let near = [x, y, z, self.extruder_zero];
        self.taps.move_to(start, &self.plan.ring, &near);
        let most = self.plan.end.min(start.saturating_add(LONGEST_WINDOW_TICKS));
        let end = self.taps.next_change(start, &self.plan.ring, most);
        // At most the longest window, so 32 bits suffice.
        let ticks = end.wrapping_sub(start) as u32;
        let (states, at_end) = if self.taps.is_smooth() {
            let third = ticks / 3;
            let at = |after: u32| self.taps.positions(start.wrapping_add(u64::from(after)), &self.plan.ring, &near);
            let at_end = at(ticks);
            (MotorStates::through(&[self.positions, at(third), at(2 * third), at_end], third, ticks), Some(at_end))
        } else {
            (self.taps.states(start, &self.plan.ring), None)
        };
        let until = states.first_turn(ticks as f32);
        let (end, at_end) = if until < ticks as f32 {
            (start.wrapping_add(u64::from((until + 0.5) as u32)), None)
        } else {
            (end, at_end)
        };
        let ticks = end.wrapping_sub(start) as u32 as f32;
        let positions = at_end.unwrap_or_else(|| self.taps.positions(end, &self.plan.ring, &near));
        let before = core::mem::replace(&mut self.positions, positions);
        for (index, motor) in self.motors.iter_mut().enumerate() {
            let value = |values: &[f32; 4]| values.get(index).copied().unwrap_or_default();
            let place = |values: &[i64; 4]| values.get(index).copied().unwrap_or_default();
            motor.begin(&WindowMotion {
                ends: [place(&before), place(&positions)],
                acceleration: value(&states.acceleration),
                jerk: value(&states.jerk),
                ticks,
            });
        }
        self.window = [start, end];
    }
}

/// Result of [`ShapedStepper::work`].
enum Work {
    /// Events; another may still join the last of them.
    Events,
    /// Time passes; nothing joins the event before.
    Waited,
    /// A move has ended.
    MoveEnded(Notice),
    /// The block has ended.
    BlockEnded,
}

#[cfg(test)]
mod tests;
