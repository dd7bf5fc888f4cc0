//! The desk's step queue: its interrupt is the desk, which plays it on virtual motors as
//! virtual time passes.

use std::collections::VecDeque;
use std::rc::Rc;

use ferrostep_hal_shim::{
    Approach, DroppedSteps, FeedError, HomingSensors, MotionWatch, MotorEnable, PlanningClock, ServoPulses, StepLink,
    StepQueue,
};
use ferrostep_planner::{Move, StepDigests, StepEntry, StepLedger, StepObserver};
use ferrostep_printer::MAX_TOOLS;
use ferrostep_virtual_board::{EventRate, VirtualMotors};

use super::drivers::DeskDrivers;
use super::line_ends::LineEnds;
use super::tools::DeskExtruders;
use super::z_motors::DeskZMotors;
use crate::record::{AnyObserver, Observer};

/// Entries that the queue holds, as many as a board's has slots.
const CAPACITY: usize = 2048;

/// Entries that stay when the queue has been full: playing half of it at a time is faster than
/// one entry (caches).
const KEPT_OF_A_FULL_QUEUE: usize = CAPACITY / 2;

/// Observers of the motors: the digests and the event rate for the report, and the session's own.
struct Watch {
    digests: StepDigests,
    rate: EventRate,
    observer: AnyObserver,
}

impl StepObserver for Watch {
    #[inline]
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.digests.stepped(tick, axes, directions);
        self.rate.add(tick);
        self.observer.stepped(tick, axes, directions);
    }
}

/// The queue, and the motors that it drives.
pub struct VirtualStepQueue {
    entries: VecDeque<StepEntry>,
    /// Ends of moves that have not been reached: tick and source line.
    move_ends: VecDeque<(u64, u32)>,
    /// Entries added so far, modulo 2^32.
    queued: u32,
    link: StepLink,
    motors: VirtualMotors,
    z_motors: Option<DeskZMotors>,
    extruders: DeskExtruders,
    drivers: Rc<DeskDrivers>,
    /// The axis whose sensor ends the present move.
    watched_axis: Option<usize>,
    /// Tick up to which motion goes before the command side looks again.
    pause_tick: u64,
    /// Motion clock now, if time passes by itself. A value before the last event means the
    /// time of that event.
    now_tick: u64,
    watch: Watch,
    /// The ends of lines, if someone follows them.
    line_ends: Option<Rc<LineEnds>>,
}

impl VirtualStepQueue {
    /// An empty queue.
    pub(super) fn new(
        motors: VirtualMotors,
        z_motors: Option<DeskZMotors>,
        drivers: Rc<DeskDrivers>,
        observer: AnyObserver,
    ) -> Self {
        Self {
            entries: VecDeque::with_capacity(CAPACITY),
            move_ends: VecDeque::new(),
            queued: 0,
            link: StepLink::new(),
            motors,
            z_motors,
            extruders: DeskExtruders::default(),
            drivers,
            watched_axis: None,
            pause_tick: 0,
            now_tick: 0,
            watch: Watch { digests: StepDigests::default(), rate: EventRate::default(), observer },
            line_ends: None,
        }
    }

    /// Notes from now on where the motion of each source line ends.
    pub(super) fn follow_lines(&mut self, ends: Rc<LineEnds>) {
        self.line_ends = Some(ends);
    }

    /// The motors, as far as the queue has been played.
    pub fn motors(&self) -> &VirtualMotors {
        &self.motors
    }

    /// The motors.
    pub fn motors_mut(&mut self) -> &mut VirtualMotors {
        &mut self.motors
    }

    /// The steps that the extruder of each tool has made.
    pub fn extruder_steps(&self) -> [i64; MAX_TOOLS] {
        let [.., e] = self.motors.ledger.motor_steps();
        self.extruders.steps(e)
    }

    /// Maximum number of events in any millisecond, times 1000.
    pub fn max_event_rate_hz(&self) -> u64 {
        self.watch.rate.most_hz()
    }

    /// The session's observer.
    pub fn observer_mut(&mut self) -> &mut dyn Observer {
        &mut *self.watch.observer
    }

    /// The session's observer.
    pub fn into_observer(self) -> AnyObserver {
        self.watch.observer
    }

    /// Continues motion up to a tick.
    pub fn set_pause_tick(&mut self, tick: u64) {
        self.pause_tick = tick;
    }

    /// Returns true if motion has reached its pause.
    pub fn is_paused(&self) -> bool {
        self.motors.ledger.tick() > self.pause_tick
    }

    /// Plays entries up to the pause: half of a full queue, all of any other. Returns whether there
    /// was one to play.
    pub fn play(&mut self) -> bool {
        if !self.link.is_running() {
            return false;
        }
        let kept = if self.room() < ferrostep_planner::interpolator::MAX_ENTRIES { KEPT_OF_A_FULL_QUEUE } else { 0 };
        let mut has_played = false;
        while self.entries.len() > kept && !self.is_paused() {
            let Some(entry) = self.entries.pop_front() else { break };
            has_played = true;
            self.play_entry(entry);
        }
        if self.entries.is_empty() {
            self.link.run_dry();
        }
        has_played
    }

    /// The motion clock, if time passes by itself.
    pub fn now_tick(&self) -> u64 {
        self.now_tick.max(self.motors.ledger.tick())
    }

    /// Advances by this number of ticks: plays the events that they contain, and no other.
    pub fn pass(&mut self, ticks: u64) {
        self.now_tick = self.now_tick() + ticks;
        if self.watched_axis.is_some() {
            // A move towards a sensor is played as it is planned, which is up to here.
            self.pause_tick = self.now_tick;
            return;
        }
        if !self.link.is_running() || self.link.is_stopping() {
            self.now_tick = 0;
            return;
        }
        while let Some(entry) = self.entries.pop_front() {
            let Some((now, later)) = self.split(entry) else {
                self.entries.push_front(entry);
                return;
            };
            self.play_entry(now);
            if let Some(later) = later {
                self.entries.push_front(later);
                return;
            }
        }
        self.link.run_dry();
        self.now_tick = 0;
        self.tell_move_ends(u64::MAX);
    }

    /// The part of an entry that is due, and the rest; `None` if none of it is due.
    fn split(&self, entry: StepEntry) -> Option<(StepEntry, Option<StepEntry>)> {
        let due_ticks = self.now_tick - self.motors.ledger.tick();
        let interval_ticks = u64::from(entry.interval_ticks());
        if interval_ticks > due_ticks {
            return None;
        }
        let due = due_ticks.checked_div(interval_ticks).and_then(|due| u16::try_from(due).ok());
        let Some(due) = due.filter(|due| *due < entry.count()) else { return Some((entry, None)) };
        let now = entry.first_events(due)?;
        let later = StepEntry::stair(entry.interval_ticks(), entry.count() - due, entry.axes(), entry.added());
        Some((now, later))
    }

    /// The entries that have not been played, from 0.
    fn left(&self) -> StepLedger {
        let mut left = StepLedger::default();
        left.play(StepEntry::directions(self.motors.ledger.directions()), &mut ());
        self.entries.iter().for_each(|entry| left.play(*entry, &mut ()));
        left
    }

    fn play_entry(&mut self, entry: StepEntry) {
        let before = self.motors.ledger.first_tick(entry).saturating_sub(1);
        self.tell_move_ends(before);
        self.motors.ledger.play(entry, &mut self.watch);
    }

    /// Tells the observer of the moves that have ended up to a tick.
    pub fn tell_move_ends(&mut self, upto: u64) {
        while let Some((tick, line)) = self.move_ends.pop_front_if(|(tick, _)| *tick <= upto) {
            self.watch.observer.move_ended(tick, line);
            if let Some(ends) = &self.line_ends {
                ends.note(line, tick);
            }
        }
    }
}

impl StepQueue for VirtualStepQueue {
    fn queued(&self) -> u32 {
        self.queued
    }

    fn played(&self) -> u32 {
        self.queued.wrapping_sub(self.entries.len() as u32)
    }

    fn waiting(&self) -> usize {
        self.entries.len()
    }

    fn room(&self) -> usize {
        // A move towards a sensor is played as it is planned.
        if self.watched_axis.is_some() && self.is_paused() { 0 } else { CAPACITY - self.entries.len() }
    }

    #[inline]
    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.push_all(&[entry])
    }

    #[inline]
    fn push_all(&mut self, entries: &[StepEntry]) -> Result<(), FeedError> {
        if self.entries.len() + entries.len() > CAPACITY {
            return Err(FeedError::Full);
        }
        self.entries.extend(entries);
        self.queued = self.queued.wrapping_add(entries.len() as u32);
        Ok(())
    }

    fn seal(&mut self) {}

    fn start(&mut self) {
        self.link.start();
    }

    fn link(&self) -> &StepLink {
        &self.link
    }

    fn unplayed_steps(&self) -> [i32; 4] {
        self.left().motor_steps().map(|steps| steps as i32)
    }

    fn request_stop(&mut self) {
        self.link.request_stop();
    }

    fn drop_all(&mut self) -> DroppedSteps {
        let left = self.left();
        self.entries.clear();
        // The direction signals change at once, as on a board.
        self.motors.ledger.play(StepEntry::directions(left.directions()), &mut ());
        self.step_z_motors(u8::MAX);
        DroppedSteps {
            signed: left.motor_steps().map(|steps| steps as i32),
            issued: left.issued().map(|steps| steps as u32),
            ticks: left.tick(),
            requested: self.link.stopped(),
        }
    }

    fn take_missed_updates(&mut self) -> u32 {
        0
    }
}

impl HomingSensors for VirtualStepQueue {
    fn is_sensor_triggered(&self, axis: usize) -> bool {
        self.motors.is_triggered(axis)
    }

    fn watch_sensor(&mut self, axis: Option<usize>) {
        self.watched_axis = axis;
        self.now_tick = 0;
        self.motors.set_stall_signal(axis.and_then(|axis| self.drivers.stall_signal(axis)));
    }

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        self.motors.tell_pin(pulses.width_us);
    }

    /// Plays the entry at once: the queue is empty, as the machine has stopped.
    fn push_towards_sensor(&mut self, entry: StepEntry) -> Result<Approach, FeedError> {
        let Some(axis) = self.watched_axis else {
            self.push(entry)?;
            return Ok(Approach { added: Some(entry), triggered: false });
        };
        Ok(self.motors.play_until_triggered(entry, axis, &mut self.watch))
    }
}

/// Planning takes no virtual time.
impl PlanningClock for VirtualStepQueue {}

/// Virtual motors hold without current.
impl MotorEnable for VirtualStepQueue {
    fn set_motors_enabled(&mut self, _motors: u8, _enabled: bool) {}

    fn step_z_motors(&mut self, motors: u8) {
        if let Some(z_motors) = &mut self.z_motors {
            z_motors.step(motors, &mut self.motors);
        }
    }

    fn step_extruder(&mut self, tool: u8) {
        let [.., e] = self.motors.ledger.motor_steps();
        self.extruders.select(tool, e);
    }
}

/// The motors are watched as they step: after a stop, digests and traces do not contain the
/// steps that were left.
impl StepObserver for VirtualStepQueue {
    #[inline]
    fn stepped(&mut self, _tick: u64, _axes: u8, _directions: u8) {}
}

impl MotionWatch for VirtualStepQueue {
    fn digests(&self) -> StepDigests {
        self.watch.digests
    }

    fn move_taken(&mut self, taken: &Move, slowed_moves: u64) {
        self.watch.observer.planned(taken, slowed_moves);
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        self.move_ends.push_back((tick, line));
    }

    fn stands_at(&mut self, tick: u64) {
        self.tell_move_ends(self.motors.ledger.tick());
        self.move_ends.clear();
        self.motors.ledger.advance_to(tick);
    }

    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.watch.observer.redefined(tick, motor_steps);
    }
}
