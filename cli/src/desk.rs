//! The machine on the desk: planner, step queue and virtual board, and the virtual time they share.

mod drivers;
mod handles;
mod heat_at_rest;

pub use drivers::DeskDrivers;
pub use handles::{DeskHeating, DeskMotion};

use std::collections::VecDeque;

use ferrostep_gcode::MotionFigures;
use ferrostep_hal_shim::virtual_board::{EventRate, StallSignal, VirtualBoard, VirtualClock, VirtualHeaters};
use ferrostep_hal_shim::{Heater, ThermalBoard};
use ferrostep_planner::extruder::rounded_steps;
use ferrostep_planner::interpolator::MAX_ENTRIES;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    Move, MoveError, Moved, Notice, PlannedBlock, Planner, Progress, Recorded, StepDigests, StepEntry, StepLedger,
    StepObserver, StepSink, TICKS_PER_SECOND,
};
use ferrostep_printer::heat::{HeatControl, HeatFault, SAMPLE_MS};
use ferrostep_printer::{HomingOutcome, Miscount, MotionError, Profile};

use crate::gpre::Script;
use crate::record::Observer;
use heat_at_rest::{HeatAtRest, HeaterSample};

/// Blocks in the look-ahead ring, as on the target.
pub const LOOK_AHEAD_BLOCKS: usize = 128;

/// All motors.
const ALL: u8 = 0b1111;

/// Entries in the step queue, as on the target.
const STEP_QUEUE_ENTRIES: usize = 2048;

/// Interval of heater control.
const HEAT_INTERVAL_NS: u64 = SAMPLE_MS as u64 * 1_000_000;

/// Longest time that passes at once while a command waits for motion, so that it can look around.
const LONGEST_LEAP_TICKS: u64 = TICKS_PER_SECOND as u64 / 2;

/// What a command waits for, so that time passes until it is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Awaited {
    Nothing,
    /// Room in the look-ahead ring.
    Room,
    /// The end of all motion.
    Idle,
    /// The end stop of an axis, or the end of all motion.
    EndStop(usize),
}

/// Whether steps are made or only counted in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Every step.
    Print,
    /// Durations only.
    Estimate,
    /// Durations, and what was planned is written down.
    Prepare,
}

/// Entries and notices on their way from the planner to the motors.
#[derive(Debug, Default)]
struct Queues {
    entries: VecDeque<StepEntry>,
    notices: VecDeque<Notice>,
}

impl StepSink for Queues {
    #[inline]
    fn entry(&mut self, entry: StepEntry) {
        self.entries.push_back(entry);
    }

    fn notice(&mut self, notice: Notice) {
        self.notices.push_back(notice);
    }
}

impl Queues {
    fn has_room(&self) -> bool {
        self.entries.len() + MAX_ENTRIES <= STEP_QUEUE_ENTRIES
    }
}

/// What watches the motors, and the event rate for the report.
struct Watch<O> {
    rate: EventRate,
    observer: O,
}

impl<O: StepObserver> StepObserver for Watch<O> {
    #[inline]
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.rate.add(tick);
        self.observer.stepped(tick, axes, directions);
    }
}

/// What a print did, in numbers.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    /// Virtual time from the start to the last step, s.
    pub print_time_s: f64,
    /// Sum of the durations of all blocks, homing left out, s.
    pub motion_time_s: f64,
    /// Steps issued, both directions.
    pub motor_steps: [u64; 4],
    /// Most events in any millisecond, times 1000.
    pub max_event_rate_hz: u64,
    /// How often the step queue was empty at non-zero speed.
    pub underruns: u64,
    /// How often a block left the look-ahead ring because steps ran out.
    pub starvation_flushes: u64,
    /// Moves planned slower than asked for, because a board could not keep up with them.
    pub slowed_moves: u64,
    /// Moves that became one block with the one before.
    pub merged_moves: u64,
    /// Digests of all step events.
    pub digests: StepDigests,
}

/// The machine.
pub struct Desk<O> {
    mode: Mode,
    planner: Planner<Vec<Slot>>,
    queues: Queues,
    board: VirtualBoard,
    heat: HeatControl,
    heat_at_rest: HeatAtRest,
    heat_samples: u64,
    /// A fault found while a move was added; the next wait reports it.
    late_fault: Option<HeatFault>,
    observer: Watch<O>,
    /// Motors that have current.
    pub enabled_motors: u8,
    awaited: Awaited,
    sought: Option<HomingOutcome>,
    /// When the driver of the axis that seeks says that its motor stalls.
    stall_signal: Option<StallSignal>,
    /// Tick of the last move's end.
    last_notice: u64,
    /// Tick of the last block's end.
    last_block_end: u64,
    /// Durations of the blocks that an estimate did not execute.
    estimated_ticks: u64,
    /// Where the extruder is after these blocks, 1/256 steps.
    planned_256ths: i64,
    /// Time during which the motion clock stood still.
    idle_ns: u64,
    next_heat_ns: u64,
    last_step_ns: u64,
    /// The last step that [`Self::take_moved`] has seen.
    seen_step_ns: u64,
    underruns: u64,
    homing_ticks: u64,
    homing_since: Option<u64>,
    /// A motor that stood elsewhere than its block ends, until a command has been told; and how often that was.
    miscount: Option<Miscount>,
    miscounts: u64,
    /// What is written down, if anything is.
    script: Option<Script>,
}

impl<O: Observer> Desk<O> {
    /// A machine that has just been switched on.
    pub fn new(profile: &Profile, mode: Mode, look_ahead: usize, observer: O) -> Self {
        let mut planner = Planner::new(profile.geometry(), profile.limits, vec![Slot::EMPTY; look_ahead]);
        planner.set_motion_choice(&profile.motion);
        let mut heaters = profile.virtual_heaters();
        let mut motors = profile.virtual_motors();
        motors.set_framed(profile.framed_axes());
        // The first temperatures are there before the first command.
        let heat = HeatControl::new(profile.nozzle, profile.bed, &mut heaters);
        Self {
            mode,
            planner,
            queues: Queues::default(),
            board: VirtualBoard { motors, heaters },
            heat,
            heat_at_rest: HeatAtRest::default(),
            heat_samples: 0,
            late_fault: None,
            observer: Watch { rate: EventRate::default(), observer },
            enabled_motors: 0,
            awaited: Awaited::Nothing,
            sought: None,
            stall_signal: None,
            last_notice: 0,
            last_block_end: 0,
            estimated_ticks: 0,
            planned_256ths: 0,
            idle_ns: 0,
            next_heat_ns: HEAT_INTERVAL_NS,
            last_step_ns: 0,
            seen_step_ns: 0,
            underruns: 0,
            homing_ticks: 0,
            homing_since: None,
            miscount: None,
            miscounts: 0,
            script: (mode == Mode::Prepare).then(Script::default),
        }
    }

    /// What was done so far.
    pub fn figures(&self) -> Figures {
        let seconds = |ticks: u64| ticks as f64 / f64::from(TICKS_PER_SECOND);
        Figures {
            print_time_s: self.last_step_ns as f64 * 1e-9,
            motion_time_s: seconds(self.planner.motion_ticks() - self.homing_ticks),
            motor_steps: self.board.motors.ledger.issued(),
            max_event_rate_hz: self.observer.rate.most_hz(),
            underruns: self.underruns,
            starvation_flushes: self.planner.starvation_flushes(),
            slowed_moves: self.planner.slowed_moves(),
            merged_moves: self.planner.merged_moves(),
            digests: self.board.motors.ledger.digests(),
        }
    }

    /// Whether motors have moved since this was last asked.
    pub fn take_moved(&mut self) -> bool {
        std::mem::replace(&mut self.seen_step_ns, self.last_step_ns) != self.last_step_ns
    }

    /// What M797 reports.
    fn motion_figures(&self) -> MotionFigures {
        let StepDigests { order, step } = self.board.motors.ledger.digests();
        MotionFigures {
            order_digest: order,
            step_digest: step,
            underruns: self.underruns,
            starvation_flushes: self.planner.starvation_flushes(),
            // Here lines are always at hand.
            idle_flushes: 0,
            issued_steps: self.board.motors.ledger.issued(),
            slowed_moves: self.planner.slowed_moves(),
            merged_moves: self.planner.merged_moves(),
            // Here planning takes no time, and the motors play whatever they are given.
            planning_slowdowns: 0,
            missed_updates: 0,
            refused_entries: 0,
            miscounts: self.miscounts,
        }
    }

    /// For comparison: see [`Planner::plan_block_by_block`].
    pub fn plan_block_by_block(&mut self) -> bool {
        self.planner.plan_block_by_block()
    }

    /// The board, to look at.
    pub fn board(&self) -> &VirtualBoard {
        &self.board
    }

    /// The board's heaters, to let one fail.
    pub fn heaters_mut(&mut self) -> &mut VirtualHeaters {
        self.heat_at_rest.disturb();
        &mut self.board.heaters
    }

    /// Samples of the heaters' model so far. Only what follows the print's time can make an estimate slow: this is it.
    pub fn heat_samples(&self) -> u64 {
        self.heat_samples
    }

    /// What watched the motors.
    pub fn into_observer(self) -> O {
        self.observer.observer
    }

    /// Lets time pass until what the last command waits for is there: its moves, or its moment.
    ///
    /// # Errors
    /// A heater or thermometer has failed; heaters are off and motion has stopped. It is told once.
    pub fn pass_time(&mut self, clock: &VirtualClock) -> Result<(), HeatFault> {
        match std::mem::replace(&mut self.awaited, Awaited::Nothing) {
            Awaited::Room => self.run_until(Self::has_room),
            Awaited::Idle => self.run_until(Self::is_idle),
            Awaited::EndStop(axis) => self.run_to_end_stop(axis),
            Awaited::Nothing => {}
        }
        let now_ns = match clock.take_wake_ns() {
            Some(wake_ns) => {
                self.idle_ns += wake_ns.saturating_sub(self.now_ns());
                wake_ns
            }
            None => self.now_ns(),
        };
        clock.advance_to(now_ns);
        let outcome = self.heat_until(now_ns);
        self.late_fault.take().map_or(outcome, Err)
    }

    /// Everything off, as after M112.
    pub fn halt(&mut self) {
        self.all_heat_off();
        self.stop();
    }

    fn all_heat_off(&mut self) {
        self.heat_at_rest.disturb();
        self.heat.all_off();
        for heater in Heater::ALL {
            self.board.heaters.set_power(heater, 0.0);
        }
    }

    fn set_heat_target(&mut self, heater: Heater, celsius: f32) {
        let before = self.heat.status(heater).target_celsius;
        self.heat.set_target(heater, celsius);
        if self.heat.status(heater).target_celsius != before {
            self.heat_at_rest.disturb();
        }
    }

    fn restart_heat(&mut self) -> Result<(), HeatFault> {
        self.heat_at_rest.disturb();
        self.heat.restart()
    }

    /// Whether a move would be taken.
    fn has_room(&self) -> bool {
        self.planner.has_room()
    }

    /// Whether all motion has ended.
    fn is_idle(&self) -> bool {
        self.planner.is_idle() && self.queues.entries.is_empty()
    }

    fn motion_tick(&self) -> u64 {
        self.board.motors.ledger.tick() + self.estimated_ticks
    }

    fn now_ns(&self) -> u64 {
        // Whole seconds apart, so that no product leaves 64 bits.
        let (tick, a_second) = (self.motion_tick(), u64::from(TICKS_PER_SECOND));
        self.idle_ns + tick / a_second * 1_000_000_000 + tick % a_second * 1_000_000_000 / a_second
    }

    /// Lets the heaters' time pass; after a failure it goes on, for they cool. Only a print steps the model of heaters at
    /// rest: the time that an estimate takes must not follow the print's.
    fn heat_until(&mut self, now_ns: u64) -> Result<(), HeatFault> {
        let mut outcome = Ok(());
        while self.next_heat_ns <= now_ns {
            if self.mode != Mode::Print {
                if self.heat_at_rest.is_at_rest() {
                    self.next_heat_ns +=
                        (now_ns - self.next_heat_ns) / HEAT_INTERVAL_NS * HEAT_INTERVAL_NS + HEAT_INTERVAL_NS;
                    break;
                }
                let sample = |heater| HeaterSample {
                    celsius: self.board.heaters.true_celsius(heater),
                    target_celsius: self.heat.status(heater).target_celsius,
                };
                self.heat_at_rest.note(Heater::ALL.map(sample));
            }
            self.next_heat_ns += HEAT_INTERVAL_NS;
            self.heat_samples += 1;
            self.board.heaters.advance(SAMPLE_MS as f32 * 1e-3);
            if let Err(fault) = self.heat.update(&mut self.board.heaters) {
                self.stop();
                outcome = Err(fault);
            }
        }
        outcome
    }

    /// Plans and plays until `done`, or for a while; the step queue is kept as full as it gets, as on the board. An estimate plans only.
    fn run_until(&mut self, done: impl Fn(&Self) -> bool) {
        if self.mode != Mode::Print {
            let before = self.planner.motion_ticks();
            while !done(self) {
                let steps = &mut self.board.motors.ledger;
                if !plan_only(&mut self.planner, self.script.as_mut(), &mut self.planned_256ths, steps) {
                    break;
                }
            }
            self.pass_planned(before);
            return;
        }
        let latest = self.board.motors.ledger.tick() + LONGEST_LEAP_TICKS;
        while !done(self) {
            if self.queues.has_room() && self.planner.advance(&mut self.queues) == Progress::Worked {
                continue;
            }
            // Half the queue at a time is kinder to the caches than one entry.
            let keep = if self.queues.has_room() { 0 } else { STEP_QUEUE_ENTRIES / 2 };
            if !self.play_down_to(keep, latest) || self.board.motors.ledger.tick() > latest {
                // Whoever waits looks again, and waits again if it must.
                break;
            }
        }
        if self.is_idle() {
            self.deliver_notices(u64::MAX);
        }
    }

    /// Gives the planner a move. What only plans makes room for it at once: waiting for it would plan the move again.
    fn add(&mut self, request: &Move) -> Result<Moved, MoveError> {
        if self.mode == Mode::Print {
            return self.planner.add(request);
        }
        if self.late_fault.is_some() {
            // Whoever adds the move waits, and hears of it.
            return Err(MoveError::NoRoom);
        }
        let before = self.planner.motion_ticks();
        let Self { planner, script, board, planned_256ths, .. } = self;
        let steps = &mut board.motors.ledger;
        let make_room = |planner: &mut _| plan_only(planner, script.as_mut(), planned_256ths, steps);
        let outcome = planner.add_making_room(request, make_room);
        self.pass_planned(before);
        self.late_fault = self.heat_until(self.now_ns()).err();
        outcome
    }

    /// Time passes for what was planned since the planner's clock stood there.
    fn pass_planned(&mut self, before_ticks: u64) {
        let ticks = self.planner.motion_ticks() - before_ticks;
        if ticks > 0 {
            self.estimated_ticks += ticks;
            self.last_step_ns = self.now_ns();
        }
    }

    /// What became of a move that the planner was given; `None` if it has to wait.
    fn taken(&mut self, outcome: Result<Moved, MoveError>) -> Option<Result<Moved, MotionError>> {
        match outcome {
            Err(MoveError::NoRoom) => {
                self.awaited = Awaited::Room;
                None
            }
            Err(error) => Some(Err(MotionError::Move(error))),
            Ok(moved) => {
                self.enabled_motors = ALL;
                Some(Ok(moved))
            }
        }
    }

    /// What is written down, if anything is.
    pub fn script(&mut self) -> Option<&mut Script> {
        self.script.as_mut()
    }

    /// Plays entries until `keep` are left or `latest` has passed; whether any was there.
    fn play_down_to(&mut self, keep: usize, latest: u64) -> bool {
        let mut played = false;
        while self.queues.entries.len() > keep && self.board.motors.ledger.tick() <= latest {
            let Some(entry) = self.queues.entries.pop_front() else { break };
            played = true;
            let before = self.board.motors.ledger.first_tick(entry).saturating_sub(1);
            if self.queues.notices.front().is_some_and(|notice| notice.tick() <= before) {
                self.deliver_notices(before);
            }
            self.board.motors.ledger.play(entry, &mut self.observer);
        }
        if played {
            self.last_step_ns = self.now_ns();
            if self.queues.entries.is_empty() && self.planner.is_in_motion() {
                self.underruns += 1;
            }
        }
        played
    }

    /// Acts on the notices up to a tick.
    fn deliver_notices(&mut self, upto: u64) {
        while let Some(notice) = self.queues.notices.pop_front_if(|notice| notice.tick() <= upto) {
            match notice {
                Notice::BlockEnded { tick, motor_steps } => {
                    self.last_block_end = tick;
                    let miscount = Miscount::between(self.board.motors.ledger.motor_steps(), motor_steps);
                    self.miscount = self.miscount.or(miscount);
                    self.miscounts += u64::from(miscount.is_some());
                }
                Notice::MoveEnded { tick, line } => {
                    self.last_notice = tick;
                    self.observer.observer.move_ended(tick, line);
                }
                Notice::FanPower { power, .. } => self.heat.set_part_fan_power(power),
            }
        }
    }

    /// Takes note of a motor that stood elsewhere than its block ends; motion has stopped then.
    fn take_miscount(&mut self) -> Option<Miscount> {
        let miscount = self.miscount.take();
        if miscount.is_some() {
            self.stop();
        }
        miscount
    }

    /// From now on it is homing that the motors move for.
    fn begin_homing(&mut self) {
        self.homing_since.get_or_insert(self.planner.motion_ticks());
    }

    /// Plays event by event and looks at the end stop after each; in an estimate too, for how long it takes depends on
    /// where the end stop is.
    fn run_to_end_stop(&mut self, axis: usize) {
        self.begin_homing();
        let latest = self.board.motors.ledger.tick() + LONGEST_LEAP_TICKS;
        let mut triggered = self.board.motors.is_triggered(axis);
        while !triggered && !self.is_idle() {
            if self.board.motors.ledger.tick() > latest {
                // Not there yet: the command waits on.
                return;
            }
            if self.queues.has_room() && self.planner.advance(&mut self.queues) == Progress::Worked {
                continue;
            }
            let Some(entry) = self.queues.entries.pop_front() else { break };
            let motors = &mut self.board.motors;
            motors.set_stall_signal(self.stall_signal);
            triggered = motors.play_until_triggered(entry, axis, &mut self.observer).triggered;
        }
        if triggered {
            self.stand();
        }
        if let Some(script) = &mut self.script {
            script.sought();
        }
        self.last_step_ns = self.now_ns();
        self.sought = Some(if triggered { HomingOutcome::Triggered } else { HomingOutcome::Missed });
    }

    /// The motors stand where they are; all that was planned is forgotten. Returns the filament that was not pushed,
    /// units of 0.1 nm.
    fn stop(&mut self) -> i64 {
        if self.mode != Mode::Print {
            // Without steps there is no place on the way to stop at.
            self.planner.flush();
            self.run_until(Self::is_idle);
            return 0;
        }
        self.stand()
    }

    fn stand(&mut self) -> i64 {
        self.deliver_notices(self.board.motors.ledger.tick());
        self.queues = Queues::default();
        // A move ends half a step after its last event; standing there, the clock does not go back.
        self.board.motors.ledger.advance_to(self.last_notice);
        let steps = &self.board.motors.ledger;
        self.planner.stand_at(steps.motor_steps(), steps.tick(), steps.directions())
    }

    /// Homing: the machine is at this position.
    fn set_position(&mut self, position_10nm: [i64; 3]) {
        let motors = self.planner.set_position(position_10nm);
        self.board.motors.redefine_motor_steps(motors.map(i64::from));
        // A move ends half a step after its last event.
        let tick = self.board.motors.ledger.tick().max(self.last_block_end);
        self.observer.observer.redefined(tick, self.board.motors.ledger.motor_steps());
        if let Some(since) = self.homing_since.take() {
            self.homing_ticks += self.planner.motion_ticks() - since;
        }
    }
}

/// Plans a block without its steps; whether there was one. The motors stand at its end: homing goes on from there.
fn plan_only(
    planner: &mut Planner<Vec<Slot>>,
    script: Option<&mut Script>,
    planned_256ths: &mut i64,
    motors: &mut StepLedger,
) -> bool {
    let planned = match script {
        None => planner.next_planned(),
        Some(script) => {
            let Some(recorded) = planner.next_recorded() else { return false };
            script.left(&recorded);
            match recorded {
                Recorded::Block { planned, .. } => Some(planned),
                Recorded::FanPower { .. } => return true,
            }
        }
    };
    let Some(PlannedBlock { block, .. }) = planned else { return false };
    let before = rounded_steps(*planned_256ths);
    *planned_256ths += i64::from(block.extruder_256ths);
    let extruder = rounded_steps(*planned_256ths) - before;
    let [x, y, z] = block.steps.map(|steps| -steps);
    motors.take_back([x, y, z, -(extruder as i32)], [0; 4]);
    true
}
