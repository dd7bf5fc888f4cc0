//! The machine between moves and the step queue, on every board and on the desk: the planner, and
//! the queue that it keeps full.

mod feeder;
mod filament;
mod homing_time;
mod idle_timeout;
pub(crate) mod pushed;
mod timeline;
mod watched_line;
mod work;
mod workload;
mod z_motors;

use ferrostep_gcode::MotionFigures;
use ferrostep_hal_shim::{FanOutput, StepOutput};
use ferrostep_planner::backlash::{Backlash, BacklashCorrection};
use ferrostep_planner::look_ahead::{PlanFault, Slot};
use ferrostep_planner::surface::{Bed, Mesh, MeshError};
use ferrostep_planner::{
    ChoiceError, Limits, MotionChoice, MotionMethods, MoveError, Moved, Pace, Planner, PressureAdvance, Request,
    Standard, StepDigests, StepsPerMm, TICKS_PER_SECOND,
};

use crate::heat::fans::{FanDemand, start_powers};
use crate::motion::fault::{HomingOutcome, MotionError, MotionFault};
use crate::settings::profile::Profile;
use feeder::{Feeder, Seeking};
pub use homing_time::HomingTime;
use idle_timeout::IdleTimeout;
pub use pushed::{Pushed, PushedFilament};
use watched_line::WatchedLine;
use workload::Workload;

/// Motion at hand from which on a host waits for the `ok` of its move: 1 s. The next move is also
/// to come within the time that a person takes for an answer at once.
const BOUND_TICKS: u64 = TICKS_PER_SECOND as u64;

/// The part of it that must be certain whatever the host sends next: 0.5 s. A host that must first
/// wake up, or send a line again, takes less.
const MIN_CERTAIN_TICKS: u64 = TICKS_PER_SECOND as u64 / 2;

/// Mask of all motors.
const ALL_MOTORS: u8 = 0b1111;

/// Actions that the machine may take because the host is silent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silence {
    /// True to let blocks leave the look-ahead ring in motion before it is full, if the
    /// step queue runs low.
    pub may_release: bool,
    /// True to execute the moves that wait in the ring at standstill, as the host seems to have
    /// no further ones.
    pub may_flush: bool,
}

/// Numbers of faults, and of times that a part could not keep up.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    /// The queue refused an entry.
    refused_entries: u64,
    /// The step interrupt missed an update of its timer.
    missed_updates: u64,
    /// The pace was lowered because planning did not keep up.
    planning_slowdowns: u64,
    /// The queue was empty while motors ran.
    underruns: u64,
    /// Waiting moves were executed because the host was silent.
    idle_flushes: u64,
    /// A motor was not where its block ends.
    miscounts: u64,
}

/// The machine; `R` is the memory of the look-ahead ring, `Q` the board's step queue and the parts
/// around it, `M` the methods of motion that the image contains.
#[derive(Debug)]
pub struct Machine<R, Q, M: MotionMethods = Standard> {
    planner: Planner<R, M>,
    feeder: Feeder<Q, M::Bed, M::Backlash>,
    workload: Workload,
    counts: Counts,
    idle_timeout: IdleTimeout,
    homing_time: HomingTime,
    /// Motors that have current.
    enabled_motors: u8,
    /// Filament that stops have left unpushed since [`Self::take_dropped_100pm`], units of 0.1 nm.
    dropped_100pm: i64,
    /// True if all moves taken are to be executed without waiting for more.
    flushed: bool,
    /// True if the motors run at the end of the entries queued so far.
    in_motion: bool,
    /// True if hosts also wait for room in time ([`Self::set_bounded_in_time`]).
    is_bounded: bool,
    /// Number of stops of motion.
    stops: u32,
    /// The fault that stopped motion, until the printer task has read it.
    fault: Option<MotionFault>,
}

impl<R: AsRef<[Slot]> + AsMut<[Slot]>, Q: StepOutput, M: MotionMethods> Machine<R, Q, M> {
    /// A machine that has just been switched on, with the standard methods:
    /// [`Self::set_motion_choice`] takes the profile's. Not here, where a copy of the machine would
    /// be on the stack beneath.
    pub fn new(profile: &Profile, ring: R, queue: Q) -> Self {
        Self {
            planner: Planner::new(profile.geometry(), profile.limits, ring),
            feeder: Feeder::new(&profile.geometry(), &profile.limits, queue, start_powers(&profile.fans)),
            workload: Workload::default(),
            counts: Counts::default(),
            idle_timeout: IdleTimeout::default(),
            homing_time: HomingTime::default(),
            enabled_motors: 0,
            dropped_100pm: 0,
            flushed: false,
            in_motion: false,
            is_bounded: false,
            stops: 0,
            fault: None,
        }
    }

    /// Adds motion.
    ///
    /// # Errors
    /// As [`Planner::add`]; [`MoveError::NoRoom`] passes.
    pub fn add(&mut self, request: &impl Request) -> Result<Moved, MoveError> {
        if self.feeder.queue.link().is_stopping() {
            return Err(MoveError::NoRoom);
        }
        let moved = self.planner.add(request)?;
        if moved == Moved::Queued {
            if let Some(request) = request.as_move() {
                self.feeder.queue.move_taken(&request, self.planner.slowed_moves());
            }
            self.flushed = false;
            self.set_motors_enabled(ALL_MOTORS, true);
        }
        Ok(moved)
    }

    /// Changes a fan after the motion taken so far; `false` without room.
    pub fn add_fan_power(&mut self, fan: FanOutput, power: u8) -> bool {
        if self.planner.is_look_ahead_empty() {
            self.feeder.fan.set_now(fan, power);
            return true;
        }
        self.planner.add_fan_power(fan as u8, power)
    }

    /// Demand on the fans at the present point of the motion.
    pub fn fan_demand(&self) -> FanDemand {
        FanDemand { powers: self.feeder.fan.powers(), motors_on: self.enabled_motors != 0 }
    }

    /// Executes all moves taken.
    pub fn flush(&mut self) {
        self.planner.flush();
        self.flushed = true;
    }

    /// Takes the planner's fault, see [`Planner::take_plan_fault`].
    pub fn take_plan_fault(&mut self) -> Option<PlanFault> {
        self.planner.take_plan_fault()
    }

    /// Returns true if a move would be taken now, and answered at once. After `false` a move
    /// may still be taken.
    pub fn has_room(&mut self) -> bool {
        self.planner.has_room() && !self.feeder.queue.link().is_stopping() && !self.holds_enough()
    }

    /// Sets whether a host also waits for room with 1 s (`BOUND_TICKS`) of motion at hand, though
    /// the look-ahead ring has room: it is to see soon that it pauses, cancels or changes the feed.
    pub fn set_bounded_in_time(&mut self, is_bounded: bool) {
        self.is_bounded = is_bounded;
    }

    /// Returns true if the machine is bounded in time and the motion at hand lasts for long enough.
    /// Part of it must be certain whatever comes next: the motion that the machine needs to brake
    /// from any speed is beyond that part, so that no speed depends on when the next move comes.
    pub fn holds_enough(&mut self) -> bool {
        if !self.is_bounded {
            return false;
        }
        let queued = self.feeder.remaining_ticks();
        if queued >= BOUND_TICKS {
            return true;
        }
        let certain = queued.saturating_add(self.planner.certain_ticks(self.feeder.ledger.tick()));
        certain >= MIN_CERTAIN_TICKS && certain.saturating_add(self.planner.unsettled_ticks()) >= BOUND_TICKS
    }

    /// Returns true if all moves taken have been executed, to the last step.
    pub fn is_idle(&self) -> bool {
        self.is_planned() && self.feeder.queue.waiting() == 0 && !self.feeder.queue.link().is_stopping()
    }

    /// Returns true if all moves taken have become step entries, with their corrections.
    fn is_planned(&self) -> bool {
        self.planner.is_idle() && !self.feeder.is_waiting()
    }

    /// The moves to come, until the position is set, are part of homing: [`Self::motion_ticks`]
    /// leaves them out.
    pub fn begin_homing(&mut self) {
        self.homing_time.begin(self.planner.motion_ticks());
    }

    /// Sum of the durations of all blocks so far, ticks; homing that has ended is left out.
    pub fn motion_ticks(&self) -> u64 {
        self.planner.motion_ticks() - self.homing_time.ticks()
    }

    /// Makes the move just taken end where the sensor of `axis` triggers. The machine must have
    /// been at standstill before that move.
    pub fn begin_seek(&mut self, axis: usize) {
        self.begin_homing();
        self.planner.set_unshaped(true);
        self.flush();
        self.feeder.seeking = Seeking::Approaching;
        // First the edge, then the level: if the sensor triggers in between, one of them sees it.
        self.feeder.queue.watch_sensor(Some(axis));
        if self.is_end_stop_triggered(axis) {
            self.end_seek(HomingOutcome::Triggered);
        }
    }

    /// Result of the move towards a sensor; `None` until the motors are at rest.
    ///
    /// # Errors
    /// It was stopped.
    pub fn take_homing_result(&mut self) -> Option<Result<HomingOutcome, MotionError>> {
        if !self.is_idle() {
            return None;
        }
        if self.feeder.seeking == Seeking::Approaching {
            self.end_seek(HomingOutcome::Missed);
        }
        self.planner.set_unshaped(false);
        Some(match core::mem::replace(&mut self.feeder.seeking, Seeking::No) {
            Seeking::Ended(outcome) => Ok(outcome),
            Seeking::No | Seeking::Approaching => Err(MotionError::Stopped),
        })
    }

    fn end_seek(&mut self, outcome: HomingOutcome) {
        self.feeder.seeking = Seeking::Ended(outcome);
        self.feeder.queue.watch_sensor(None);
        if outcome == HomingOutcome::Triggered {
            self.forget_plan();
            self.flushed = true;
        }
    }

    /// Lets the planner forget the motion that has not been queued: the motors stop
    /// where the queue ends.
    fn forget_plan(&mut self) {
        let motor_steps = self.feeder.stand();
        let ledger = &self.feeder.ledger;
        self.dropped_100pm += self.planner.reset_to(motor_steps, ledger.tick(), ledger.directions());
        self.in_motion = false;
        self.planner.set_pace(Pace::FULL);
    }

    /// Machine position at the end of all moves taken, units of 10 nm.
    pub fn position_10nm(&self) -> [i64; 3] {
        self.planner.position_10nm()
    }

    /// Sets where the machine is, at standstill. From then on Z follows no bed.
    pub fn set_position(&mut self, position_10nm: [i64; 3]) {
        if M::Bed::PRESENT && self.feeder.bed.is_on() {
            let _always_works = self.switch_bed(false);
        }
        let motors = self.planner.set_position(position_10nm);
        self.feeder.redefine_motor_steps(motors.map(i64::from));
        self.homing_time.end(self.planner.motion_ticks());
    }

    /// The measured mesh of the bed, to be changed while Z does not follow it.
    pub fn mesh(&mut self) -> Option<&mut Mesh> {
        self.feeder.bed.mesh()
    }

    /// Returns true if Z follows the bed.
    pub fn follows_bed(&self) -> bool {
        self.feeder.bed.is_on()
    }

    /// Makes Z follow the mesh of the bed, or stops it, at standstill. The motors stay: the
    /// position's Z becomes that above the mesh, or without it.
    ///
    /// # Errors
    /// [`MeshError`]; Z does not follow the bed then.
    pub fn follow_bed(&mut self, on: bool) -> Result<(), MeshError> {
        if self.is_idle() && M::Bed::PRESENT { self.switch_bed(on) } else { Err(MeshError::Incomplete) }
    }

    #[inline(never)]
    fn switch_bed(&mut self, on: bool) -> Result<(), MeshError> {
        let switched = self.feeder.bed.switch(on);
        self.planner.set_surface(switched.ok().filter(|_| on));
        // X and Y stay as exact as they were; their positions by steps are less exact.
        let [x, y, _] = self.planner.position_10nm();
        self.forget_plan();
        let [.., z] = self.planner.position_10nm();
        self.planner.set_position([x, y, z]);
        switched.map(|_| ())
    }

    /// Step counters of all motors at the end of the queue.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.feeder.ledger.motor_steps()
    }

    /// Steps that the motors have made so far, counted as [`Self::motor_steps`].
    pub fn made_steps(&self) -> [i64; 4] {
        let mut made = self.motor_steps();
        for (made, unplayed) in made.iter_mut().zip(self.feeder.queue.unplayed_steps()) {
            *made -= i64::from(unplayed);
        }
        made
    }

    /// Slots of the step queue filled so far, modulo 2^32.
    pub fn slots_queued(&self) -> u32 {
        self.feeder.queue.queued()
    }

    /// Limits of the moves to come.
    pub fn limits(&self) -> Limits {
        *self.planner.limits()
    }

    /// Sets the limits of the moves to come.
    pub fn set_limits(&mut self, limits: Limits) {
        self.feeder.set_limits(&limits);
        self.planner.set_limits(limits);
    }

    /// The play of the drives.
    pub fn backlash(&self) -> Backlash {
        self.feeder.backlash()
    }

    /// Sets the play of the drives, at standstill. The motors stay.
    pub fn set_backlash(&mut self, backlash: &Backlash) {
        if self.is_idle() && M::Backlash::PRESENT {
            self.feeder.set_backlash(backlash);
        }
    }

    /// Watches a line, see [`crate::ports::Motion::watch_line`].
    pub fn watch_line(&mut self, line: u32) {
        self.feeder.watched = WatchedLine::Ahead(line);
    }

    /// Returns true if the motors have passed it, see [`crate::ports::Motion::has_passed_line`].
    pub fn has_passed_line(&self) -> bool {
        self.feeder.watched.is_passed(self.feeder.queue.played())
    }

    /// The methods that make the steps.
    pub fn motion_choice(&self) -> MotionChoice {
        *self.planner.motion_choice()
    }

    /// Sets the methods that make the steps.
    ///
    /// # Errors
    /// [`ChoiceError`]; the choice is unchanged then.
    pub fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        self.planner.set_motion_choice(choice)
    }

    /// Steps of the extruder in a millimetre of filament.
    pub fn extruder_steps_per_mm(&self) -> StepsPerMm {
        self.planner.extruder_steps_per_mm()
    }

    /// Sets the steps of the extruder in a millimetre of filament, at standstill.
    ///
    /// # Errors
    /// [`ChoiceError::InMotion`]; the steps are unchanged then.
    pub fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        self.planner.set_extruder_steps_per_mm(steps_per_mm)
    }

    /// Sets the pressure advance, see [`Planner::set_pressure_advance`].
    ///
    /// # Errors
    /// The ring has no room now.
    pub fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> Result<bool, MoveError> {
        self.planner.set_pressure_advance(advance)
    }

    /// Switches the motors in the mask on or off.
    pub fn set_motors_enabled(&mut self, motors: u8, enabled: bool) {
        self.enabled_motors = if enabled { self.enabled_motors | motors } else { self.enabled_motors & !motors };
        self.feeder.queue.set_motors_enabled(motors, enabled);
    }

    /// Mask of the motors that are switched on.
    pub fn enabled_motors(&self) -> u8 {
        self.enabled_motors
    }

    /// Switches all motors off, as a halt does.
    pub fn switch_motors_off(&mut self) {
        self.set_motors_enabled(ALL_MOTORS, false);
    }

    /// Switches the motors off when they have rested for `timeout_ms`; `None`: they keep their
    /// current. To be called every now and then with a clock of milliseconds, which may wrap.
    /// Returns true if it has just switched them off.
    pub fn rest(&mut self, now_ms: u32, timeout_ms: Option<u32>) -> bool {
        let rests = self.is_idle() && self.enabled_motors != 0;
        let is_over = self.idle_timeout.check(now_ms, timeout_ms.filter(|_| rests));
        if is_over {
            self.switch_motors_off();
        }
        is_over
    }

    /// Returns true if the idle timeout has fired since the last call, see
    /// [`crate::ports::Motion::take_switched_off`].
    pub fn take_switched_off(&mut self) -> bool {
        self.idle_timeout.take_fired()
    }

    /// Returns true if the end stop of an axis is triggered.
    pub fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.feeder.queue.is_sensor_triggered(axis)
    }

    /// Digests and counters.
    pub fn figures(&self) -> MotionFigures {
        let StepDigests { order, step } = self.feeder.queue.digests();
        let Counts { refused_entries, missed_updates, planning_slowdowns, underruns, idle_flushes, miscounts } =
            self.counts;
        MotionFigures {
            order_digest: order,
            step_digest: step,
            underruns,
            starvation_flushes: self.planner.starvation_flushes(),
            idle_flushes,
            issued_steps: self.feeder.ledger.issued(),
            slowed_moves: self.planner.slowed_moves(),
            merged_moves: self.planner.merged_moves(),
            planning_slowdowns,
            missed_updates,
            refused_entries,
            miscounts,
        }
    }

    /// Number of stops of motion so far; a command that waits for motion compares it.
    pub fn stops(&self) -> u32 {
        self.stops
    }

    /// Takes the fault for which motion was stopped.
    pub fn take_fault(&mut self) -> Option<MotionFault> {
        self.fault.take()
    }

    /// Stops motion because of a fault.
    fn stop_for(&mut self, fault: MotionFault) {
        self.fault.get_or_insert(fault);
        self.feeder.queue.request_stop();
    }

    /// Takes the filament that stops have left unpushed, units of 0.1 nm.
    pub fn take_dropped_100pm(&mut self) -> i64 {
        core::mem::take(&mut self.dropped_100pm)
    }

    /// Stops all motors before their next step; the next [`Self::work`] drops the
    /// rest of the motion.
    pub fn request_stop(&mut self) {
        self.feeder.queue.request_stop();
    }

    /// Makes plan and ledger follow the motors, after a stop.
    fn follow_stop(&mut self) {
        let is_requested = self.feeder.drop_all();
        self.forget_plan();
        let seeks = self.feeder.seeking == Seeking::Approaching;
        if !is_requested {
            // The sensor. Its edge may come twice: before its level is read, or right
            // after the move's end.
            if seeks {
                self.end_seek(HomingOutcome::Triggered);
            }
            return;
        }
        if seeks {
            self.feeder.queue.watch_sensor(None);
        }
        self.feeder.seeking = Seeking::No;
        self.planner.set_unshaped(false);
        self.flushed = false;
        self.stops = self.stops.wrapping_add(1);
    }

    /// Plans block by block, for comparison: see [`Planner::plan_block_by_block`].
    pub fn plan_block_by_block(&mut self) -> bool {
        self.planner.plan_block_by_block()
    }

    /// The step queue and the parts around it.
    pub fn queue(&self) -> &Q {
        &self.feeder.queue
    }

    /// The step queue, for a board that plays it in virtual time.
    pub fn queue_mut(&mut self) -> &mut Q {
        &mut self.feeder.queue
    }

    /// The step queue, when the machine is no longer needed.
    pub fn into_queue(self) -> Q {
        self.feeder.queue
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod tests;
