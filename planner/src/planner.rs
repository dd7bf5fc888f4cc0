//! The stages connected: moves in, step entries out.

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

use crate::block::{PlannedBlock, Speed};
use crate::block_queue::BlockQueue;
use crate::extruder::FILAMENT_UNITS_PER_MM;
use crate::interpolator::Interpolator;
use crate::junction::CornerAcceleration;
use crate::kinematics::{Geometry, UNITS_PER_MM};
use crate::limits::Limits;
use crate::methods::{MotionMethods, SpeedRule, Standard};
use crate::motion_choice::MotionChoice;
use crate::open_block::OpenBlock;
use crate::pace::Pace;
use crate::pressure_advance::AdvanceLaw;
use crate::ring::{Marker, RingMemory};
use crate::s_curve::law::Curve;
use crate::shaping::{ShapedStepper, Shaping};
use crate::speed_plan::{Part, Released};
use crate::step_queue::{Notice, StepSink};
use crate::time_law::TimeLaw;

use block_rules::{BlockRules, Planned, Previous};
use held::Held;
use move_error::MoveError;
use position::{MotorPosition, Position, Target};

/// What [`Planner::advance`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Something; call again.
    Worked,
    /// Nothing: no block may leave the look-ahead ring now.
    Waiting,
}

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
    /// At the end of the last move taken.
    position: Position,
    previous: Previous,
    /// The newest block, which the next move may continue. It enters the ring when that is known, never sooner than the
    /// ring has room, so that a full ring holds the same blocks however late the next move comes.
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
    /// In its place while axes are shaped.
    shaped: ShapedStepper,
    shaping: Shaping,
    /// The moves to come are not shaped: a sensor ends them.
    is_unshaped: bool,
    /// Blocks were passed over without being executed, and not the time that the motors take to rest after them.
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

    /// Holds the blocks that leave look-ahead from now on to a share of their nominal speeds, within what acceleration
    /// allows. For a machine that cannot keep up; [`Pace::FULL`] at first, and then nothing is changed.
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

    /// How long all blocks begun so far would have lasted at their nominal speeds, in ticks: neither the pace nor ramps
    /// make them longer. What planning may take of the processor's time to keep up at full speed.
    pub fn nominal_ticks(&self) -> u64 {
        self.tallies.nominal_ticks
    }

    /// How often a block left the look-ahead ring early because steps ran out.
    pub fn starvation_flushes(&self) -> u64 {
        self.tallies.starvation_flushes
    }

    /// How many moves were joined to the one before, two moves that became one block counting as one.
    pub fn merged_moves(&self) -> u64 {
        self.tallies.merged_moves
    }

    /// How many moves became slower because the processor could not have kept up with them.
    pub fn slowed_moves(&self) -> u64 {
        self.tallies.slowed_moves
    }

    /// Whether a move or fan change would be taken now; some are even if this says no, and one is not for which moves that were held
    /// back have to enter the ring first.
    pub fn has_room(&self) -> bool {
        self.queue.has_room() && (!self.queue.is_switching || self.is_look_ahead_empty())
    }

    /// Whether all moves taken have become step entries.
    pub fn is_idle(&self) -> bool {
        self.is_look_ahead_empty() && !self.interpolator.is_busy() && self.shaped.is_at_rest()
    }

    /// Whether all moves have their speeds.
    pub fn is_look_ahead_empty(&self) -> bool {
        !self.open.is_some() && self.held.is_none() && self.queue.is_empty()
    }

    /// Whether the last entry handed out leaves the motors running.
    pub fn is_in_motion(&self) -> bool {
        self.interpolator.is_busy() || !self.shaped.is_at_rest() || self.exit > Speed::ZERO
    }

    /// Whether moves may share a block. Another pattern may decide from the start of a block, and another law count the
    /// steps of a whole one.
    #[inline]
    fn shares_blocks(&self) -> bool {
        self.rules.pattern.is_none() && self.rule.is_none()
    }

    /// A move has been taken; `whole_10nm`: the length of the travel of which it is a part, 0 if it is none.
    #[inline(always)]
    fn advance_position(&mut self, target: &Target, planned: &Planned, whole_10nm: f32) {
        let Planned { path, corner_acceleration, line, ends_move, is_forgotten, .. } = *planned;
        let unended_line = (!ends_move).then_some(line);
        self.previous = Previous { path, acceleration: corner_acceleration, unended_line, whole_10nm, is_forgotten };
        self.position.advance(target);
    }

    /// What is held and the open block enter the ring; `false` without room. A flush that waited for it follows.
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

    /// As [`Self::close_open_block`]; calls `make_room` where the ring is full.
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

    /// Motion ends with the last move taken; everything in the look-ahead ring may leave.
    pub fn flush(&mut self) {
        self.flushing = true;
        // Now, not when there is room for it: the move before is not known any more then. What is held is planned before any other move is.
        if self.held.is_none() {
            self.keep_tolerance_before_any();
            self.close_open_block();
            self.stop();
        } else {
            self.close_open_block();
        }
    }

    /// Motion ends with the last move planned.
    #[inline(always)]
    fn stop(&mut self) {
        // A stop stays one.
        self.previous.is_forgotten &= !self.previous.acceleration.is_some();
        self.previous.acceleration = CornerAcceleration::ZERO;
    }

    /// The step queue runs low and no input is at hand: the oldest block leaves with the speeds it has.
    pub fn release(&mut self) {
        if !self.is_look_ahead_empty() && !self.queue.can_leave() {
            self.close_open_block();
            self.queue.release();
            self.tallies.starvation_flushes += 1;
        }
    }

    /// How long the machine can go on at full speed whatever comes next, or does not come: the blocks in the ring whose speeds
    /// are final, and the rest of the one that is being interpolated. In ticks after `tick`, at which the entries handed out
    /// so far end.
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

    /// How long the machine goes on beyond [`Self::certain_ticks`] if nothing more comes, but for its braking, ticks: the first block
    /// whose speeds are not final, at its nominal speed. Those after it only brake, which takes no longer than from its speed to
    /// standstill.
    pub fn unsettled_ticks(&self) -> u64 {
        let block = self.queue.first_not_final().or(self.open.block());
        block.map_or(0, |block| block.nominal.ticks_for(block.length_10nm))
    }

    /// Lets the blocks leave look-ahead whose speeds no later block can change; returns whether there are any. The plan does
    /// not depend on whether, and when, that is done.
    pub fn release_final(&mut self) -> bool {
        let is_final = self.queue.is_first_final();
        if is_final {
            self.queue.release_final();
        }
        is_final
    }

    /// Does a little work; hands at most [`crate::interpolator::MAX_ENTRIES`] entries and two notices to `sink`.
    #[inline]
    pub fn advance(&mut self, sink: &mut impl StepSink) -> Progress {
        if self.interpolator.is_busy() {
            self.interpolator.advance(sink);
            if !self.interpolator.is_busy() {
                let motor_steps = self.released.motor_steps();
                sink.notice(Notice::BlockEnded { tick: self.interpolator.notice_tick(), motor_steps });
            }
            return Progress::Worked;
        }
        if self.shaped.is_busy() {
            self.advance_shaped(sink);
            return Progress::Worked;
        }
        match self.release_next() {
            Some(Released::Block(planned)) => {
                let law = self.law(&planned);
                self.begin(&planned, &law, sink);
            }
            Some(Released::Part(part)) => {
                let (planned, law) = self.along(&part);
                self.begin(&planned, &law, sink);
            }
            Some(Released::Marker(marker)) => {
                self.pass_marker(&marker, sink);
            }
            None if self.must_rest() => self.tallies.motion_ticks += self.shaped.begin_rest(),
            None => return Progress::Waiting,
        }
        Progress::Worked
    }

    /// What stands between the blocks takes effect.
    #[cold]
    fn pass_marker(&mut self, marker: &Marker, sink: &mut impl StepSink) {
        match *marker {
            Marker::FanPower { fan, power } => {
                let is_shaped = !self.shaped.is_at_rest();
                let tick = if is_shaped { self.shaped.notice_tick() } else { self.interpolator.notice_tick() };
                sink.notice(Notice::FanPower { tick, fan, power });
            }
            Marker::PressureAdvance(advance) => {
                let [.., steps_per_mm] = self.rules.geometry.steps_per_mm;
                self.shaped.set_advance(AdvanceLaw::new(&advance, steps_per_mm.to_f64()));
            }
        }
    }

    /// The plan has come to standstill, and the motors have not: what the filters hold is to be executed.
    fn must_rest(&self) -> bool {
        self.shaped.is_in_motion() && self.exit == Speed::ZERO && self.is_look_ahead_empty()
    }

    /// Events of shaped motion.
    #[inline(never)]
    fn advance_shaped(&mut self, sink: &mut impl StepSink) {
        self.shaped.advance(sink);
        if self.shaped.is_at_rest() {
            self.interpolator.resume(&self.shaped.standing());
            let motor_steps = self.released.motor_steps();
            sink.notice(Notice::BlockEnded { tick: self.interpolator.notice_tick(), motor_steps });
        }
    }

    /// Whether the blocks to come are shaped.
    fn is_shaping(&self) -> bool {
        self.shaping.is_active() && !self.is_unshaped
    }

    /// Begins a block whose motors follow it through their filters.
    #[inline(never)]
    fn begin_shaped(&mut self, planned: &PlannedBlock, law: &TimeLaw<M::Pieces>) -> u64 {
        if !self.shaped.is_in_motion() {
            let ([x, y, z], [dx, dy, dz]) = (self.released.steps, planned.block.steps);
            let steps = [x.wrapping_sub(dx), y.wrapping_sub(dy), z.wrapping_sub(dz)];
            self.shaped.start(&self.interpolator.standing(steps));
        }
        self.shaped.begin(planned, law)
    }

    /// The law of a block that has one by itself.
    #[inline]
    fn law(&self, planned: &PlannedBlock) -> TimeLaw<M::Pieces> {
        match &self.rule {
            None => TimeLaw::trapezoid(planned),
            Some(rule) => TimeLaw::Other(rule.law(planned)),
        }
    }

    #[inline]
    fn begin(&mut self, planned: &PlannedBlock, law: &TimeLaw<M::Pieces>, sink: &mut impl StepSink) {
        self.exit = planned.exit;
        let nominal_ticks = self.queue.last_nominal().ticks_for(planned.block.length_10nm);
        self.tallies.nominal_ticks = self.tallies.nominal_ticks.saturating_add(nominal_ticks);
        let is_shaped = self.shaped.is_in_motion() || self.is_shaping();
        self.tallies.motion_ticks +=
            if is_shaped { self.begin_shaped(planned, law) } else { self.interpolator.begin(planned, law, sink) };
    }

    /// The speeds and the law of a block of a run.
    #[inline(never)]
    fn along(&mut self, part: &Part) -> (PlannedBlock, TimeLaw<M::Pieces>) {
        let entry = if part.offset_10nm == 0 {
            self.curve = Curve::new(&part.run);
            part.run.entry
        } else {
            self.exit
        };
        let (law, exit) = TimeLaw::along(&self.curve, part.offset_10nm, part.block.length_10nm);
        let ends_run = part.offset_10nm.saturating_add(part.block.length_10nm) >= part.run.length_10nm;
        let exit = if ends_run { part.run.exit } else { exit };
        self.exit = exit;
        (PlannedBlock { block: part.block, entry, exit }, law)
    }

    /// What may leave look-ahead now.
    #[inline]
    fn release_next(&mut self) -> Option<Released> {
        if self.flushing {
            self.close_open_block();
        }
        let released = self.queue.pop(self.pace);
        if let Some(Released::Block(PlannedBlock { block, .. }) | Released::Part(Part { block, .. })) = &released {
            self.released.advance(block);
        }
        released
    }

    /// Forgets all motion that has not happened: the motors stand at these steps (X, Y, Z, extruder), at this tick of
    /// the motion clock, with these direction signals. The position becomes the nearest to where they stand. Returns the
    /// filament that has been taken and not pushed, units of 0.1 nm.
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

    /// Sets the machine's position, at standstill (homing). Returns where its motors therefore stand.
    pub fn set_position(&mut self, position_10nm: [i64; 3]) -> [i32; 3] {
        self.position.set(position_10nm, &self.rules.geometry);
        self.released.steps = self.position.motor_steps;
        self.previous = Previous::NONE;
        self.position.motor_steps
    }
}

/// Filament in units of 0.1 nm for a length in units of 10 nm at a flow in percent: the exact product.
pub const fn filament_100pm(length_10nm: i64, flow_percent: i64) -> i64 {
    // 10 nm are 100 units, a percent is a hundredth.
    const _: () = assert!(FILAMENT_UNITS_PER_MM == 100 * UNITS_PER_MM);
    length_10nm.saturating_mul(flow_percent)
}
