//! The stages connected: moves in, step entries out.

pub(crate) mod advance;
pub(crate) mod block_rules;
mod choice;
mod given_block;
mod held;
mod keeping_tolerance;
pub(crate) mod move_error;
mod passing_over;
mod position;
pub(crate) mod prepared;
pub(crate) mod recorder;
pub(crate) mod request;

use crate::block::Speed;
use crate::block_queue::BlockQueue;
use crate::extruder::FILAMENT_UNITS_PER_MM;
use crate::interpolator::Interpolator;
use crate::junction::CornerAcceleration;
use crate::kinematics::{Geometry, UNITS_PER_MM};
use crate::limits::Limits;
use crate::methods::{MotionMethods, Standard};
use crate::motion_choice::MotionChoice;
use crate::open_block::OpenBlock;
use crate::pace::Pace;
use crate::ring::{Marker, RingMemory};
use crate::s_curve::law::Curve;
use crate::shaping::{ShapedStepper, Shaping};

use block_rules::{BlockRules, Planned, Previous};
use held::Held;
use move_error::MoveError;
use position::{MotorPosition, Position, Target};

/// Sums over everything planned so far.
#[derive(Clone, Copy, Debug, Default)]
struct Tallies {
    motion_ticks: u64,
    nominal_ticks: u64,
    starvation_flushes: u64,
    merged_moves: u64,
    slowed_moves: u64,
}

/// Turns [requests](crate::Request) for motion into step entries.
#[derive(Debug)]
pub struct Planner<S, M: MotionMethods = Standard> {
    rules: BlockRules<M>,
    choice: MotionChoice,
    pace: Pace,
    /// Position at the end of the last move taken.
    position: Position,
    previous: Previous,
    /// The newest block, which the next move may continue. It enters the ring when that is known,
    /// never sooner than the ring has room, so that a full ring holds the same blocks however late
    /// the next move comes.
    open: OpenBlock,
    /// Moves that are taken and not planned, since filament may move on their way.
    held: Option<Held>,
    /// A flush waits until the open block has entered the ring.
    flushing: bool,
    queue: BlockQueue<S, M::Rule>,
    /// The law of the run whose blocks are leaving; under an S-curve only.
    curve: Curve,
    /// Another time law than trapezoid and S-curve.
    rule: Option<M::Rule>,
    interpolator: Interpolator<M>,
    /// Stepper used in place of the interpolator while axes are shaped.
    shaped: ShapedStepper,
    shaping: Shaping,
    /// The moves to come are not shaped: a sensor ends them.
    is_unshaped: bool,
    /// Blocks were passed over without being executed, and not the time that the motors take to
    /// rest after them.
    owes_rest: bool,
    /// Speed at the end of the last block that left look-ahead, and where the motors are there.
    exit: Speed,
    released: MotorPosition,
    tallies: Tallies,
}

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// A planner at machine position 0 with its look-ahead ring in the given memory.
    pub fn new(geometry: Geometry, limits: Limits, ring: S) -> Self {
        let choice = MotionChoice::DEFAULT;
        let rules = BlockRules::new(geometry, limits);
        let position = Position::new(&geometry);
        Self {
            rules,
            choice,
            pace: Pace::FULL,
            position,
            previous: Previous::NONE,
            open: OpenBlock::NONE,
            held: None,
            flushing: false,
            queue: BlockQueue::new(ring),
            curve: Curve::NONE,
            rule: None,
            interpolator: Interpolator::new(geometry.minimum_event_interval_ticks),
            shaped: ShapedStepper::new(geometry.minimum_event_interval_ticks, geometry.kinematics),
            shaping: Shaping::NONE,
            is_unshaped: false,
            owes_rest: false,
            exit: Speed::ZERO,
            released: position.motors(),
            tallies: Tallies::default(),
        }
    }

    /// The limits for moves to come.
    pub fn limits(&self) -> &Limits {
        &self.rules.limits
    }

    /// Sets the limits for moves to come; those taken keep theirs.
    pub fn set_limits(&mut self, limits: Limits) {
        self.rules.set_limits(limits);
    }

    /// Holds the blocks that leave look-ahead from now on to a share of their nominal speeds,
    /// within what acceleration allows. For a machine that cannot keep up; [`Pace::FULL`] at first,
    /// and then nothing is changed.
    pub fn set_pace(&mut self, pace: Pace) {
        self.pace = pace;
    }

    /// The share of their nominal speeds that blocks keep.
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// Motors and steps of the machine.
    pub fn geometry(&self) -> &Geometry {
        &self.rules.geometry
    }

    /// Machine position at the end of all moves taken, units of 10 nm.
    pub fn position_10nm(&self) -> [i64; 3] {
        self.position.coordinates_10nm.map(i64::from)
    }

    /// Sum of the durations of all blocks so far, in ticks.
    pub fn motion_ticks(&self) -> u64 {
        self.tallies.motion_ticks
    }

    /// Duration of all blocks begun so far at their nominal speeds, in ticks, without pace and
    /// ramps: the processor time that planning may take and still keep up at full speed.
    pub fn nominal_ticks(&self) -> u64 {
        self.tallies.nominal_ticks
    }

    /// Number of blocks that left the look-ahead ring early because steps ran out.
    pub fn starvation_flushes(&self) -> u64 {
        self.tallies.starvation_flushes
    }

    /// Number of moves joined to the previous one; two moves that became one block count as one.
    pub fn merged_moves(&self) -> u64 {
        self.tallies.merged_moves
    }

    /// Number of moves slowed down because the processor could not have kept up with them.
    pub fn slowed_moves(&self) -> u64 {
        self.tallies.slowed_moves
    }

    /// True if a move or fan change would be taken now. Conservative: after a `false` some
    /// are still taken. A move can also be refused after a `true`, if held moves have to
    /// enter the ring first.
    pub fn has_room(&self) -> bool {
        self.queue.has_room() && (!self.queue.is_switching || self.is_look_ahead_empty())
    }

    /// True if all moves taken have become step entries.
    pub fn is_idle(&self) -> bool {
        self.is_look_ahead_empty() && !self.interpolator.is_busy() && self.shaped.is_at_rest()
    }

    /// True if all moves have their speeds.
    pub fn is_look_ahead_empty(&self) -> bool {
        !self.open.is_some() && self.held.is_none() && self.queue.is_empty()
    }

    /// True if the last entry handed out leaves the motors running.
    pub fn is_in_motion(&self) -> bool {
        self.interpolator.is_busy() || !self.shaped.is_at_rest() || self.exit > Speed::ZERO
    }

    /// True if moves may share a block. Another pattern may decide from the start of a block, and
    /// another law count the steps of a whole one.
    #[inline]
    fn shares_blocks(&self) -> bool {
        self.rules.pattern.is_none() && self.rule.is_none()
    }

    /// Advances the position by a move; `whole_10nm`: the length of the travel that it is a part
    /// of, 0 if it is not part of one.
    #[inline(always)]
    fn advance_position(&mut self, target: &Target, planned: &Planned, whole_10nm: f32) {
        let Planned { path, corner_acceleration, line, ends_move, is_forgotten, .. } = *planned;
        let unended_line = (!ends_move).then_some(line);
        self.previous = Previous { path, acceleration: corner_acceleration, unended_line, whole_10nm, is_forgotten };
        self.position.advance(target);
    }

    /// Moves the held moves and the open block into the ring, then does a flush that waited for it;
    /// `false` without room.
    #[inline(never)]
    fn close_open_block(&mut self) -> bool {
        if !(self.plan_held() && self.push_open_block()) {
            return false;
        }
        if self.flushing {
            self.flushing = false;
            self.stop();
            self.queue.flush();
        }
        true
    }

    /// The open block enters the ring; `false` without room.
    #[inline(always)]
    fn push_open_block(&mut self) -> bool {
        if self.open.is_some() {
            if !self.queue.has_room() {
                return false;
            }
            self.keep_tolerance_before_any();
            let closing = self.open.hold_to(&self.rules.budget);
            self.tallies.slowed_moves += u64::from(closing.slowed_moves);
            self.queue.push(closing.block, &closing.start);
            self.open.clear();
        }
        true
    }

    /// Version of [`Self::close_open_block`] that calls `make_room` while the ring is full.
    #[inline(always)]
    fn close_making_room(&mut self, mut make_room: impl FnMut(&mut Self) -> bool) -> Result<(), MoveError> {
        while !self.close_open_block() {
            if !make_room(self) {
                return Err(MoveError::NoRoom);
            }
        }
        Ok(())
    }

    /// Changes a fan when the moves taken so far are done; `false` without room.
    pub fn add_fan_power(&mut self, fan: u8, power: u8) -> bool {
        self.close_open_block() && self.queue.push_marker(Marker::FanPower { fan, power })
    }

    /// Ends motion with the last move taken; everything in the look-ahead ring may leave.
    pub fn flush(&mut self) {
        self.flushing = true;
        // Now, not when there is room for it: the move before is not known any more then. What is
        // held is planned before any other move is.
        if self.held.is_none() {
            self.keep_tolerance_before_any();
            self.close_open_block();
            self.stop();
        } else {
            self.close_open_block();
        }
    }

    /// Ends motion with the last move planned.
    #[inline(always)]
    fn stop(&mut self) {
        // A stop stays one.
        self.previous.is_forgotten &= !self.previous.acceleration.is_some();
        self.previous.acceleration = CornerAcceleration::ZERO;
    }

    /// Releases the oldest block with its present speeds, because the step queue runs low and no
    /// input is at hand.
    pub fn release(&mut self) {
        if !self.is_look_ahead_empty() && !self.queue.can_leave() {
            self.close_open_block();
            self.queue.release();
            self.tallies.starvation_flushes += 1;
        }
    }

    /// Time for which the machine can continue at full speed whatever moves follow: the blocks in
    /// the ring whose speeds are final, and the rest of the block that is being interpolated. In
    /// ticks after `tick`, at which the entries handed out so far end.
    pub fn certain_ticks(&mut self, tick: u64) -> u64 {
        let rest = if self.shaped.is_busy() {
            self.shaped.end_tick().saturating_sub(tick)
        } else if self.interpolator.is_busy() {
            self.interpolator.end_tick().saturating_sub(tick)
        } else {
            0
        };
        // A tolerance may yet lower the acceleration of the open block.
        if self.rules.tolerance.is_none()
            && let Some(corner) = self.open.lasting_corner(&self.rules.budget)
            && let Some(block) = self.open.block()
        {
            self.queue.foresee(block, corner);
        }
        self.queue.final_ticks().saturating_add(rest)
    }

    /// Time for which the machine continues after [`Self::certain_ticks`] if no more moves come,
    /// without its braking, ticks: the first block whose speeds are not final, at its nominal
    /// speed. Those after it only brake, which takes no longer than from its speed to standstill.
    pub fn unsettled_ticks(&self) -> u64 {
        let block = self.queue.first_not_final().or(self.open.block());
        block.map_or(0, |block| block.nominal.ticks_for(block.length_10nm))
    }

    /// Releases from look-ahead the blocks whose speeds no later block can change; returns whether
    /// there are any. The plan does not depend on whether, and when, that is done.
    pub fn release_final(&mut self) -> bool {
        let is_final = self.queue.is_first_final();
        if is_final {
            self.queue.release_final();
        }
        is_final
    }

    /// Forgets all motion that has not happened: the motors are at these steps (X, Y, Z, extruder),
    /// at this tick of the motion clock, with these direction signals. The position becomes the
    /// nearest to theirs. Returns the filament that has been taken and not pushed, units of 0.1 nm.
    pub fn reset_to(&mut self, motor_steps: [i64; 4], tick: u64, directions: u8) -> i64 {
        // Every field is named: a new one has to say here what remains of it after a stop.
        let Self {
            rules,
            choice: _,
            pace: _,
            position,
            previous,
            open,
            held,
            flushing,
            queue,
            curve,
            rule: _,
            interpolator,
            shaped,
            shaping: _,
            is_unshaped: _,
            owes_rest,
            exit,
            released,
            tallies: _,
        } = self;
        let dropped_100pm = position.reset_to(motor_steps, &rules.geometry);
        *previous = Previous::NONE;
        *open = OpenBlock::NONE;
        *held = None;
        *flushing = false;
        queue.clear();
        *curve = Curve::NONE;
        *released = position.motors();
        interpolator.reset_to(tick, released.extruder_256ths, directions);
        shaped.clear();
        *owes_rest = false;
        *exit = Speed::ZERO;
        // A change that waited among the moves is dropped with them, and holds for those to come.
        self.shaped.set_advance(self.advance_law());
        dropped_100pm
    }

    /// Sets the machine's position, at standstill (homing). Returns the steps of its motors there.
    pub fn set_position(&mut self, position_10nm: [i64; 3]) -> [i32; 3] {
        self.position.set(position_10nm, &self.rules.geometry);
        self.released.steps = self.position.motor_steps;
        self.previous = Previous::NONE;
        self.position.motor_steps
    }
}

/// Filament in units of 0.1 nm for a length in units of 10 nm at a flow in percent:
/// the exact product.
pub const fn filament_100pm(length_10nm: i64, flow_percent: i64) -> i64 {
    // 10 nm are 100 units, a percent is a hundredth.
    const _: () = assert!(FILAMENT_UNITS_PER_MM == 100 * UNITS_PER_MM);
    length_10nm.saturating_mul(flow_percent)
}
