//! Planner, step queue and counting motors as one machine: what a board's planner task works on.
//!
//! Every entry is played on counting motors as it is queued. They know where the motors will stand, make the digests
//! that M797 reports, and on a board without sensors tell where its end stops trigger; there homing ends at the very
//! event that triggers, as on the desk.

mod shared;
mod timeline;
mod workload;

use ferrostep_gcode::MotionFigures;
use ferrostep_hal_shim::{EndStops, MotorEnable, StepOutput};
use ferrostep_planner::interpolator::MAX_ENTRIES;
use ferrostep_planner::look_ahead::{PlanFault, Slot};
use ferrostep_planner::{
    Limits, MotionChoice, MoveError, Moved, Notice, Pace, Planner, Progress, Request, StepDigests, StepEntry, StepSink,
    TICKS_PER_SECOND,
};
use ferrostep_virtual_board::VirtualMotors;

use crate::ports::{Miscount, MotionError, MotionFault, Seek};
use crate::profile::Profile;
pub use shared::{SharedMachine, SharedMotion};
use timeline::Timeline;
use workload::Workload;

/// Ticks in a millisecond.
const MS: u64 = TICKS_PER_SECOND as u64 / 1000;

/// Motion that waits before the motors start from standstill, where it takes fewer entries than below.
const START_TICKS: u64 = 100 * MS;

/// Entries that wait before the motors start from standstill. Blocks leave the look-ahead ring one for each that
/// comes in: without this head start a few short ones would be over before the host has sent the next line.
const START_ENTRIES: usize = 512;

/// So many entries are queued before somebody looks whether they are worth a mark in the timeline.
const MARKED_ENTRIES: usize = 8;

/// With less than this in the step queue, in motion, blocks leave the look-ahead ring before it is full: some of the
/// planner task's visits, and what it takes to make a block's steps.
const LOW_TICKS: u64 = 8 * MS;

/// Updates of the step timer that may be missed between two visits of the planner task, 2 ms apart. Nothing in the
/// firmware holds the step interrupt up for that long, and each miss only repeats an interval; more of them are no motion
/// to go on with, or a hardware count that is wrong.
const MAX_MISSED_UPDATES: u32 = 8;

/// Fan changes on their way through the step queue.
const FAN_CHANGES: usize = 32;

/// Steps of work in one call of [`Machine::work`], so that other users of the machine get their turn.
const WORK_AT_ONCE: usize = 256;

/// All motors.
const ALL: u8 = 0b1111;

/// What the planner may do because the host sends nothing, and no line is at hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silence {
    /// In motion: let blocks leave the look-ahead ring before it is full, if the step queue runs low.
    pub may_release: bool,
    /// At standstill: execute what waits in the ring, as the host seems to have no more.
    pub may_flush: bool,
}

/// The machine; `R` is the memory of the look-ahead ring, `Q` the step queue.
#[derive(Debug)]
pub struct Machine<R, Q> {
    planner: Planner<R>,
    motors: VirtualMotors,
    queue: Q,
    fan: FanChanges,
    /// Tick of the last move's end.
    last_move_end: u64,
    /// Filament that stops have left unpushed since somebody asked, units of 0.1 nm.
    dropped_100pm: i64,
    /// Everything that is planned shall be executed now.
    flushed: bool,
    /// The entries queued so far leave the motors running.
    in_motion: bool,
    /// The queue has refused an entry.
    refused: bool,
    refused_entries: u64,
    missed_updates: u64,
    timeline: Timeline,
    workload: Workload,
    /// How often the pace was lowered because planning did not keep up.
    planning_slowdowns: u64,
    underruns: u64,
    idle_flushes: u64,
    seeking: Seeking,
    /// How often motion was stopped.
    stops: u32,
    /// Why motion was stopped, if it was found wrong, until the printer task has read it.
    fault: Option<MotionFault>,
    /// How often a motor stood elsewhere than its block ends.
    miscounts: u64,
    /// Since when the motors rest with current, ms.
    rests_since_ms: Option<u32>,
    /// They have been switched off for that, and the printer task has not read it yet.
    switched_off: bool,
}

/// A move towards a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seeking {
    /// No such move, or it was stopped.
    No,
    /// The end stop of this axis ends the present move.
    Towards(usize),
    /// The move has ended so.
    Ended(Seek),
}

impl Seeking {
    /// The axis that seeks.
    fn axis(self) -> Option<usize> {
        match self {
            Self::Towards(axis) => Some(axis),
            Self::No | Self::Ended(_) => None,
        }
    }
}

/// Fan changes that take effect when the entries before them have been played.
#[derive(Debug, Default)]
struct FanChanges {
    waiting: heapless::Deque<(u32, u8), FAN_CHANGES>,
    power: u8,
}

impl FanChanges {
    /// Applies the changes due when so many slots have been played.
    fn advance(&mut self, played: u32) {
        while let Some(&(due, power)) = self.waiting.front()
            && played.wrapping_sub(due) as i32 >= 0
        {
            self.power = power;
            self.waiting.pop_front();
        }
    }
}

/// Where the planner's entries go.
struct Sink<'a, Q> {
    motors: &'a mut VirtualMotors,
    queue: &'a mut Q,
    fan: &'a mut FanChanges,
    last_move_end: &'a mut u64,
    refused: &'a mut bool,
    timeline: &'a mut Timeline,
    seeking: Option<usize>,
    triggered: bool,
    miscount: Option<Miscount>,
}

impl<Q: StepOutput> Sink<'_, Q> {
    /// There is room, and the planner keeps the intervals that the profile's checks ask for. If not, all motion stops
    /// rather than to go on out of step.
    fn queue_entry(&mut self, entry: StepEntry) {
        *self.refused |= self.queue.push(entry).is_err();
    }
}

impl<Q: StepOutput> StepSink for Sink<'_, Q> {
    fn entries(&mut self, entries: &[StepEntry]) {
        if self.triggered || self.seeking.is_some() {
            entries.iter().for_each(|&entry| self.entry(entry));
            return;
        }
        for some in entries.chunks(MARKED_ENTRIES) {
            *self.refused |= self.queue.push_all(some).is_err();
            some.iter().for_each(|&entry| self.motors.steps.play(entry, &mut ()));
            self.timeline.mark(self.queue.queued(), self.motors.steps.tick());
        }
    }

    fn entry(&mut self, entry: StepEntry) {
        if self.triggered {
            // The rest of the way is not gone.
            return;
        }
        match self.seeking {
            None => {
                self.queue_entry(entry);
                self.motors.steps.play(entry, &mut ());
            }
            Some(axis) => {
                let (played, triggered) = self.motors.play_until_triggered(entry, axis, &mut ());
                self.triggered = triggered;
                if let Some(entry) = played {
                    self.queue_entry(entry);
                }
            }
        }
    }

    fn notice(&mut self, notice: Notice) {
        match notice {
            Notice::MoveEnded { tick, .. } => {
                *self.last_move_end = tick;
                self.queue.move_planned();
            }
            // The rest of a way that a sensor has ended is not gone.
            Notice::BlockEnded { motor_steps, .. } if !self.triggered => {
                self.miscount = Miscount::between(self.motors.steps.motor_steps(), motor_steps);
            }
            Notice::BlockEnded { .. } => {}
            Notice::FanPower { power, .. } => {
                if self.fan.waiting.push_back((self.queue.queued(), power)).is_err() {
                    // There is room whenever the planner advances; if not, early is better than never.
                    self.fan.power = power;
                }
            }
        }
    }
}

impl<R: AsRef<[Slot]> + AsMut<[Slot]>, Q: StepOutput> Machine<R, Q> {
    /// A machine that has just been switched on.
    pub fn new(profile: &Profile, ring: R, queue: Q) -> Self {
        let mut planner = Planner::new(profile.geometry(), profile.limits, ring);
        planner.set_motion_choice(&profile.motion);
        Self {
            planner,
            motors: profile.virtual_motors(),
            queue,
            fan: FanChanges::default(),
            last_move_end: 0,
            dropped_100pm: 0,
            flushed: false,
            in_motion: false,
            refused: false,
            refused_entries: 0,
            missed_updates: 0,
            timeline: Timeline::default(),
            workload: Workload::default(),
            planning_slowdowns: 0,
            underruns: 0,
            idle_flushes: 0,
            seeking: Seeking::No,
            stops: 0,
            fault: None,
            miscounts: 0,
            rests_since_ms: None,
            switched_off: false,
        }
    }

    /// Takes motion.
    ///
    /// # Errors
    /// As [`Planner::add`]; [`MoveError::NoRoom`] passes.
    pub fn add(&mut self, request: &impl Request) -> Result<Moved, MoveError> {
        if self.queue.link().is_stopping() {
            return Err(MoveError::NoRoom);
        }
        let moved = self.planner.add(request)?;
        if moved == Moved::Queued {
            self.flushed = false;
            self.set_motors_enabled(ALL, true);
        }
        Ok(moved)
    }

    /// See [`Planner::refine_position`].
    pub fn refine_position(&mut self, position_10nm: [i64; 3]) -> bool {
        self.planner.refine_position(position_10nm)
    }

    /// Changes the fan with the motion taken so far; `false` without room.
    pub fn add_fan_power(&mut self, power: u8) -> bool {
        if self.planner.is_look_ahead_empty() {
            self.fan.waiting.clear();
            self.fan.power = power;
            return true;
        }
        self.planner.add_fan_power(power)
    }

    /// The fan's power now, 0 to 255.
    pub fn fan_power(&self) -> u8 {
        self.fan.power
    }

    /// Executes all that was taken.
    pub fn flush(&mut self) {
        self.planner.flush();
        self.flushed = true;
    }

    /// See [`Planner::take_plan_fault`].
    pub fn take_plan_fault(&mut self) -> Option<PlanFault> {
        self.planner.take_plan_fault()
    }

    /// Whether all that was taken has been executed, to the last step.
    pub fn is_idle(&self) -> bool {
        self.planner.is_idle() && self.queue.waiting() == 0 && !self.queue.link().is_stopping()
    }

    /// The move just taken ends where the end stop of `axis` triggers. Standstill before it is the caller's to see to.
    pub fn begin_seek(&mut self, axis: usize) {
        self.flush();
        self.seeking = Seeking::Towards(axis);
        // First the edge, then the level: what comes in between is not lost.
        self.queue.watch_sensor(Some(axis));
        if self.is_end_stop_triggered(axis) {
            self.end_seek(Seek::Triggered);
        }
    }

    /// How the seek ended, once the motors stand: `None` as long as they do not.
    ///
    /// # Errors
    /// It was stopped.
    pub fn take_homing_result(&mut self) -> Option<Result<Seek, MotionError>> {
        if !self.is_idle() {
            return None;
        }
        if self.seeking.axis().is_some() {
            self.end_seek(Seek::Missed);
        }
        Some(match core::mem::replace(&mut self.seeking, Seeking::No) {
            Seeking::Ended(outcome) => Ok(outcome),
            Seeking::No | Seeking::Towards(_) => Err(MotionError::Stopped),
        })
    }

    fn end_seek(&mut self, outcome: Seek) {
        self.seeking = Seeking::Ended(outcome);
        self.queue.watch_sensor(None);
        if outcome == Seek::Triggered {
            self.forget_plan();
            self.flushed = true;
        }
    }

    /// The planner forgets what has not been queued: the motors will stand where the queue takes them.
    fn forget_plan(&mut self) {
        let steps = &mut self.motors.steps;
        // A move ends half a step after its last event; standing there, the clock does not go back.
        steps.pass_to(self.last_move_end);
        self.dropped_100pm += self.planner.reset_to(steps.motor_steps(), steps.tick(), steps.directions());
        self.in_motion = false;
        self.timeline.clear(self.motors.steps.tick());
        self.planner.set_pace(Pace::FULL);
    }

    /// Machine position at the end of all that was taken, units of 10 nm.
    pub fn position_10nm(&self) -> [i64; 3] {
        self.planner.position_10nm()
    }

    /// Says where the machine is, at standstill.
    pub fn set_position(&mut self, position_10nm: [i64; 3]) {
        let motors = self.planner.set_position(position_10nm);
        self.motors.redefine_motor_steps(motors.map(i64::from));
    }

    /// Step counters of all motors at the end of the queue.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.motors.steps.motor_steps()
    }

    /// Limits of the moves to come.
    pub fn limits(&self) -> Limits {
        *self.planner.limits()
    }

    /// Sets the limits of the moves to come.
    pub fn set_limits(&mut self, limits: Limits) {
        self.planner.set_limits(limits);
    }

    /// The methods that make the steps.
    pub fn motion_choice(&self) -> MotionChoice {
        *self.planner.motion_choice()
    }

    /// Sets the methods that make the steps, at standstill; in motion nothing changes.
    pub fn set_motion_choice(&mut self, choice: &MotionChoice) {
        self.planner.set_motion_choice(choice);
    }

    /// Switches the motors in the mask on or off.
    pub fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        self.motors.set_motors_enabled(axes, enabled);
        self.queue.set_motors_enabled(axes, enabled);
    }

    /// Mask of the motors that are switched on.
    pub fn enabled_motors(&self) -> u8 {
        self.motors.enabled_motors()
    }

    /// Switches all motors off, as a halt does.
    pub fn switch_motors_off(&mut self) {
        self.set_motors_enabled(ALL, false);
    }

    /// To be called now and then, with a clock of milliseconds that may wrap: switches the motors off when they have rested
    /// for so long; `None` if there is a reason that they keep their current. Whether it just did.
    pub fn rest(&mut self, now_ms: u32, timeout_ms: Option<u32>) -> bool {
        let Some(timeout_ms) = timeout_ms.filter(|_| self.is_idle() && self.motors.enabled_motors() != 0) else {
            self.rests_since_ms = None;
            return false;
        };
        let is_over = now_ms.wrapping_sub(*self.rests_since_ms.get_or_insert(now_ms)) >= timeout_ms;
        if is_over {
            self.switch_motors_off();
            self.switched_off = true;
        }
        is_over
    }

    /// See [`crate::Motion::take_switched_off`].
    pub fn take_switched_off(&mut self) -> bool {
        core::mem::take(&mut self.switched_off)
    }

    /// Whether the end stop of an axis is triggered.
    pub fn is_end_stop_triggered(&self, axis: usize) -> bool {
        if Q::HAS_SENSORS { self.queue.is_sensor_triggered(axis) } else { self.motors.is_triggered(axis) }
    }

    /// Digests and counters.
    pub fn figures(&self) -> MotionFigures {
        let StepDigests { order, step } = self.motors.steps.digests();
        MotionFigures {
            order_digest: order,
            step_digest: step,
            underruns: self.underruns,
            starvation_flushes: self.planner.starvation_flushes(),
            idle_flushes: self.idle_flushes,
            issued_steps: self.motors.steps.issued(),
            slowed_moves: self.planner.slowed_moves(),
            merged_moves: self.planner.merged_moves(),
            planning_slowdowns: self.planning_slowdowns,
            missed_updates: self.missed_updates,
            refused_entries: self.refused_entries,
            miscounts: self.miscounts,
        }
    }

    /// How often motion was stopped so far; whoever waits for motion compares.
    pub fn stops(&self) -> u32 {
        self.stops
    }

    /// Takes the fault for which motion was stopped.
    pub fn take_fault(&mut self) -> Option<MotionFault> {
        self.fault.take()
    }

    /// Better no motion than a wrong one.
    fn stop_for(&mut self, fault: MotionFault) {
        self.fault.get_or_insert(fault);
        self.queue.request_stop();
    }

    /// Takes the filament that stops have left unpushed, units of 0.1 nm.
    pub fn take_dropped_100pm(&mut self) -> i64 {
        core::mem::take(&mut self.dropped_100pm)
    }

    /// From the next event on no motor steps; [`Self::work`] sees to the rest.
    pub fn request_stop(&mut self) {
        self.queue.request_stop();
    }

    /// After a stop: plan and counters follow the motors.
    fn follow_stop(&mut self) {
        let dropped = self.queue.drop_all();
        self.motors.steps.take_back(dropped.signed, dropped.issued);
        self.forget_plan();
        self.fan.waiting.clear();
        if !dropped.requested {
            // The sensor; its edge may also come twice, before its level is looked at, or right after the move's end.
            if self.seeking.axis().is_some() {
                self.end_seek(Seek::Triggered);
            }
            return;
        }
        if self.seeking.axis().is_some() {
            self.queue.watch_sensor(None);
        }
        self.seeking = Seeking::No;
        self.flushed = false;
        self.stops = self.stops.wrapping_add(1);
    }

    /// Keeps the step queue full; to be called when something was added, and at a steady pace. Whether there is more
    /// to do at once.
    pub fn work(&mut self, silence: Silence) -> bool {
        if self.queue.link().is_stopping() {
            self.follow_stop();
            return false;
        }
        let missed_updates = self.queue.take_missed_updates();
        self.missed_updates += u64::from(missed_updates);
        if missed_updates > MAX_MISSED_UPDATES {
            self.stop_for(MotionFault::MissedUpdates(missed_updates));
            return true;
        }
        if self.queue.link().take_ran_dry() && self.in_motion {
            self.underruns += 1;
        }
        let played = self.queue.played();
        self.fan.advance(played);
        self.timeline.pass(played);
        if silence.may_flush {
            self.flush_at_standstill();
        }
        let more = self.plan(silence.may_release);
        if self.planner.is_idle() {
            self.queue.seal();
            self.planner.set_pace(Pace::FULL);
        }
        self.in_motion = self.planner.is_in_motion();
        let waiting = self.queue.waiting();
        let full = self.queue.room() < MAX_ENTRIES;
        let enough = waiting >= START_ENTRIES || self.left_ticks() >= START_TICKS;
        if waiting > 0 && !self.queue.link().is_running() && (self.flushed || full || enough) {
            self.queue.start();
        }
        more
    }

    /// At standstill: executes what waits, as nothing more seems to come.
    fn flush_at_standstill(&mut self) {
        let something_waits = !self.planner.is_look_ahead_empty() || self.queue.waiting() > 0;
        if something_waits && !self.flushed && !self.queue.link().is_running() {
            self.idle_flushes += 1;
            self.flush();
        }
    }

    /// In motion: lets a block leave a look-ahead ring that is not full, if steps run out. Whether it did.
    fn release(&mut self) -> bool {
        let runs_out = self.planner.is_in_motion() && self.left_ticks() < LOW_TICKS;
        let releases = runs_out && self.queue.link().is_running() && !self.planner.is_look_ahead_empty();
        if releases {
            self.planner.release();
        }
        releases
    }

    /// How much motion is in the step queue, at least.
    fn left_ticks(&self) -> u64 {
        self.timeline.left_ticks(self.motors.steps.tick())
    }

    /// After some planning that began at a tick: what is to come keeps the pace that planning can.
    fn adjust_pace(&mut self, began: Option<u32>) {
        self.timeline.mark(self.queue.queued(), self.motors.steps.tick());
        self.timeline.pass(self.queue.played());
        let (Some(began), Some(now)) = (began, self.queue.now_ticks()) else { return };
        if let Some(pace) = self.workload.add(now.wrapping_sub(began), self.planner.nominal_ticks()) {
            self.planning_slowdowns += u64::from(pace < self.planner.pace());
            self.planner.set_pace(pace);
        }
    }

    /// Plans while there is room; whether there is more to do at once.
    fn plan(&mut self, may_release: bool) -> bool {
        for _ in 0..WORK_AT_ONCE {
            if self.queue.room() < MAX_ENTRIES || self.fan.waiting.is_full() {
                return false;
            }
            self.queue.planning_begins();
            let began = self.queue.now_ticks();
            let mut sink = Sink {
                motors: &mut self.motors,
                queue: &mut self.queue,
                fan: &mut self.fan,
                refused: &mut self.refused,
                timeline: &mut self.timeline,
                last_move_end: &mut self.last_move_end,
                seeking: if Q::HAS_SENSORS { None } else { self.seeking.axis() },
                triggered: false,
                miscount: None,
            };
            let progress = self.planner.advance(&mut sink);
            let (triggered, miscount) = (sink.triggered, sink.miscount);
            if triggered {
                self.end_seek(Seek::Triggered);
            }
            if let Some(miscount) = miscount {
                self.miscounts += 1;
                self.stop_for(MotionFault::Miscount(miscount));
                return true;
            }
            if core::mem::take(&mut self.refused) {
                self.refused_entries += 1;
                self.stop_for(MotionFault::StepsTooNear);
                return true;
            }
            if progress == Progress::Waiting {
                if may_release && self.release() {
                    continue;
                }
                return false;
            }
            self.queue.planning_ends();
            self.adjust_pace(began);
        }
        true
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod tests;
