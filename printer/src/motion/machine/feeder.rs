//! Queueing of the planner's entries, with corrections for the bed's surface and the drives' play,
//! and with the ledger of the queued steps.

use ferrostep_hal_shim::{Approach, FanOutput, StepOutput};
use ferrostep_planner::backlash::{Backlash, BacklashCorrection};
use ferrostep_planner::surface::Bed;
use ferrostep_planner::{Geometry, Limits, Notice, PassedEntries, StepEntry, StepLedger, StepSink};
use ferrostep_step_player::DroppedSteps;

use super::pushed::{FilamentCount, PushedFilament};
use super::timeline::Timeline;
use super::watched_line::WatchedLine;
use crate::motion::fault::{HomingOutcome, Miscount, MotionFault};

/// Entries between two marks of the timeline, at least.
const ENTRIES_BETWEEN_MARKS: usize = 8;

/// Fan changes on their way through the step queue.
const FAN_CHANGES: usize = 32;

/// A move towards a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seeking {
    /// No such move, or it was stopped.
    No,
    /// The watched sensor ends the present move.
    Approaching,
    /// The seek has ended.
    Ended(HomingOutcome),
}

/// Fan changes that take effect when the entries before them have been played.
#[derive(Debug)]
pub struct FanChanges {
    /// Slots that must have been played, modulo 2^32, the fan, and its power from then on.
    waiting: heapless::Deque<(u32, u8, u8), FAN_CHANGES>,
    powers: [u8; FanOutput::COUNT],
}

impl FanChanges {
    /// Powers at the start, without changes.
    const fn new(powers: [u8; FanOutput::COUNT]) -> Self {
        Self { waiting: heapless::Deque::new(), powers }
    }

    /// Applies the changes that are due when this many slots have been played, modulo 2^32.
    pub fn advance(&mut self, played: u32) {
        while let Some(&(due, fan, power)) = self.waiting.front()
            && played.wrapping_sub(due) as i32 >= 0
        {
            self.set(fan, power);
            self.waiting.pop_front();
        }
    }

    /// Sets a fan's power now, in place of its changes that wait.
    pub fn set_now(&mut self, fan: FanOutput, power: u8) {
        let fan = fan as u8;
        for _ in 0..self.waiting.len() {
            if let Some(change) = self.waiting.pop_front().filter(|(_, other, _)| *other != fan) {
                // There is room: as many were taken.
                self.waiting.push_back(change).ok();
            }
        }
        self.set(fan, power);
    }

    fn set(&mut self, fan: u8, power: u8) {
        if let Some(place) = self.powers.get_mut(usize::from(fan)) {
            *place = power;
        }
    }

    /// Forgets the changes that wait.
    pub fn forget(&mut self) {
        self.waiting.clear();
    }

    /// Returns true if no further change fits.
    pub fn is_full(&self) -> bool {
        self.waiting.is_full()
    }

    /// The powers now, 0 to 255, by output.
    pub fn powers(&self) -> [u8; FanOutput::COUNT] {
        self.powers
    }
}

/// Feeds the step queue and keeps the ledger of the queued steps.
#[derive(Debug)]
pub struct Feeder<Q, B, L> {
    /// Bed following, which moves Z with the bed's surface.
    pub bed: B,
    /// Correction of the drives' play.
    backlash: L,
    /// The queue, and the board around it.
    pub queue: Q,
    /// Position of the motors at the end of the queue.
    pub ledger: StepLedger,
    /// Amount of motion in the queue.
    pub timeline: Timeline,
    /// The new filament of the queue, where a sensor sees it move.
    filament: FilamentCount,
    /// The fans, which change with the motion.
    pub fan: FanChanges,
    /// Tick at which the last move ends.
    pub last_move_end: u64,
    /// Tick at which the last block ends.
    last_block_end: u64,
    /// The line whose beginning the motors are to pass.
    pub watched: WatchedLine,
    /// The move towards a sensor.
    pub seeking: Seeking,
    /// The fault found in the planned steps since [`Self::take_fault`].
    fault: Option<MotionFault>,
}

impl<Q: StepOutput, B: Bed, L: BacklashCorrection> Feeder<Q, B, L> {
    /// An empty queue; motors at 0, fans at these powers.
    pub fn new(geometry: &Geometry, limits: &Limits, queue: Q, fan_powers: [u8; FanOutput::COUNT]) -> Self {
        Self {
            bed: B::new(geometry),
            backlash: L::new(geometry, limits),
            queue,
            ledger: StepLedger::default(),
            timeline: Timeline::default(),
            filament: FilamentCount::default(),
            fan: FanChanges::new(fan_powers),
            last_move_end: 0,
            last_block_end: 0,
            watched: WatchedLine::None,
            seeking: Seeking::No,
            fault: None,
        }
    }

    /// Takes the fault found in the planned steps.
    pub fn take_fault(&mut self) -> Option<MotionFault> {
        self.fault.take()
    }

    /// Amount of motion in the step queue, at least, ticks.
    pub fn remaining_ticks(&self) -> u64 {
        self.timeline.remaining_ticks(self.ledger.tick())
    }

    /// Marks the queue's end in the timeline, and drops the marks that have been played.
    pub fn update_timeline(&mut self) {
        self.mark();
        self.timeline.pass(self.queue.played());
    }

    fn mark(&mut self) {
        if Q::FOLLOWS_FILAMENT {
            self.filament.follow(self.extruder_steps());
        }
        self.timeline.mark(self.queue.queued(), self.ledger.tick(), self.filament.at_end());
    }

    /// Position of the extruder at the end of the queue.
    fn extruder_steps(&self) -> i64 {
        let [.., extruder] = self.ledger.motor_steps();
        extruder
    }

    /// Filament that the extruder has pushed by now.
    pub fn pushed_filament(&self) -> PushedFilament {
        let end = self.filament.at_end();
        if self.queue.waiting() == 0 {
            return PushedFilament { at_least: end, at_most: end };
        }
        self.timeline.pushed(end)
    }

    /// Makes the queue forget the entries that were not played, after a stop, and takes their steps
    /// back from the ledger. Returns true if anything but a sensor has asked for the stop.
    pub fn drop_all(&mut self) -> bool {
        if !self.watched.is_passed(self.queue.played()) {
            // Its moves are dropped now, and the queue would count them as played.
            self.watched = WatchedLine::None;
        }
        let DroppedSteps { signed, issued, ticks, requested } = self.queue.drop_all();
        self.ledger.take_back(signed, issued);
        if ticks > 0 {
            self.ledger.turn_back(ticks);
            self.last_move_end = self.last_move_end.min(self.ledger.tick());
        }
        self.fan.forget();
        requested
    }

    /// Returns true if something waits for its corrections.
    pub fn is_waiting(&self) -> bool {
        self.bed.is_waiting() || self.backlash.is_waiting()
    }

    /// Queues some of the waiting entries with their corrections; `false` if none waits. There is
    /// room for some entries.
    pub fn correct(&mut self) -> bool {
        if !self.is_waiting() {
            return false;
        }
        let mut out = PassedEntries::NONE;
        if self.backlash.is_waiting() {
            let notice = self.backlash.work(self.seeking != Seeking::No, &mut out);
            self.queue_entries(out.all());
            if let Some(notice) = notice {
                self.pass_notice(notice);
            }
        } else {
            let notice = self.bed.work(&mut out);
            self.take_entries(out.all());
            if let Some(notice) = notice {
                self.take_notice(notice);
            }
        }
        true
    }

    /// Takes entries that follow the bed.
    fn take_entries(&mut self, entries: &[StepEntry]) {
        if !self.backlash.take(entries) {
            self.queue_entries(entries);
        }
    }

    /// Takes a notice after the entries before it.
    fn take_notice(&mut self, notice: Notice) {
        if !self.backlash.take_notice(&notice) {
            self.pass_notice(notice);
        }
    }

    /// The play of the drives.
    pub fn backlash(&self) -> Backlash {
        self.backlash.backlash()
    }

    /// Sets the play of the drives, at standstill: the motors are counted from here on as
    /// if they had none.
    pub fn set_backlash(&mut self, backlash: &Backlash) {
        let [x, y, z, _] = self.ledger.motor_steps();
        let [of_x, of_y, of_z] = self.backlash.stand(self.ledger.issued(), self.ledger.directions());
        self.redefine_motor_steps([x - of_x, y - of_y, z - of_z]);
        self.backlash.set(backlash);
    }

    /// Sets the limits by which play is taken up.
    pub fn set_limits(&mut self, limits: &Limits) {
        self.backlash.set_limits(limits);
    }

    /// Stops the motors where the ledger ends. Returns their position by the plan, which knows
    /// of no correction.
    pub fn stand(&mut self) -> [i64; 4] {
        // A move ends half a step after its last event; the clock does not go back before that.
        self.ledger.advance_to(self.last_move_end);
        if Q::FOLLOWS_FILAMENT {
            let played = self.timeline.pushed(self.filament.at_end()).at_least;
            self.filament.stop_at(played, self.extruder_steps());
        }
        self.timeline.clear(self.ledger.tick(), self.filament.at_end());
        self.queue.stands_at(self.ledger.tick());
        let [x, y, z, extruder] = self.ledger.motor_steps();
        let directions = self.ledger.directions();
        let [of_x, of_y, of_z] = self.backlash.stand(self.ledger.issued(), directions);
        let [x, y, z] = [x - of_x, y - of_y, z - of_z];
        let correction = self.bed.stand([x, y, z], directions);
        [x, y, z - correction, extruder]
    }

    /// Sets the position of X, Y and Z (A, B, Z), at standstill, without steps for their play.
    pub fn redefine_motor_steps(&mut self, motor_steps: [i64; 3]) {
        self.backlash.redefined();
        self.ledger.redefine_motor_steps(motor_steps);
        let tick = self.ledger.tick().max(self.last_block_end);
        self.queue.redefined(tick, self.ledger.motor_steps());
    }

    /// The queue has refused an entry. The planner asks for room and keeps the intervals that
    /// the profile's checks ask for, so the plan is wrong, and all motion stops before the
    /// motors are out of step.
    #[cold]
    fn refuse(&mut self) {
        self.fault.get_or_insert(MotionFault::StepsTooNear);
    }

    /// Queues an entry of a move towards the watched sensor.
    #[inline(never)]
    fn approach(&mut self, entry: StepEntry) {
        match self.queue.push_towards_sensor(entry) {
            Ok(Approach { added, triggered }) => {
                if let Some(added) = added {
                    self.ledger.play(added, &mut self.queue);
                }
                if triggered {
                    self.seeking = Seeking::Ended(HomingOutcome::Triggered);
                }
            }
            Err(_) => self.refuse(),
        }
    }
}

impl<Q: StepOutput, B: Bed, L: BacklashCorrection> Feeder<Q, B, L> {
    fn queue_entries(&mut self, entries: &[StepEntry]) {
        if self.seeking != Seeking::No {
            entries.iter().for_each(|&entry| self.queue_entry(entry));
            return;
        }
        for some in entries.chunks(ENTRIES_BETWEEN_MARKS) {
            if self.queue.push_all(some).is_err() {
                self.refuse();
            }
            some.iter().for_each(|&entry| self.ledger.play(entry, &mut self.queue));
            self.mark();
        }
    }

    fn queue_entry(&mut self, entry: StepEntry) {
        match self.seeking {
            Seeking::No => {
                if self.queue.push(entry).is_err() {
                    self.refuse();
                }
                self.ledger.play(entry, &mut self.queue);
            }
            Seeking::Approaching => self.approach(entry),
            // The sensor has ended the move: the motors stay.
            Seeking::Ended(_) => {}
        }
    }

    fn pass_notice(&mut self, notice: Notice) {
        match notice {
            Notice::MoveEnded { tick, line } => {
                self.last_move_end = tick;
                self.watched.note(line, self.queue.queued());
                self.queue.move_ended(tick, line);
            }
            // After a block that a sensor has ended early the motors are elsewhere.
            Notice::BlockEnded { tick, motor_steps } if !matches!(self.seeking, Seeking::Ended(_)) => {
                self.last_block_end = tick;
                if let Some(miscount) = Miscount::between(self.ledger.motor_steps(), motor_steps) {
                    self.fault.get_or_insert(MotionFault::Miscount(miscount));
                }
            }
            Notice::BlockEnded { .. } => {}
            Notice::FanPower { fan, power, .. } => {
                if self.fan.waiting.push_back((self.queue.queued(), fan, power)).is_err() {
                    // There is room whenever the planner advances. If there were none, an early
                    // change is better than a lost one.
                    self.fan.set(fan, power);
                }
            }
        }
    }
}

impl<Q: StepOutput, B: Bed, L: BacklashCorrection> StepSink for Feeder<Q, B, L> {
    fn entries(&mut self, entries: &[StepEntry]) {
        if !self.bed.take(entries) {
            self.take_entries(entries);
        }
    }

    fn entry(&mut self, entry: StepEntry) {
        if !self.bed.take(&[entry]) && !self.backlash.take(&[entry]) {
            self.queue_entry(entry);
        }
    }

    fn notice(&mut self, notice: Notice) {
        if !self.bed.take_notice(&notice) {
            self.take_notice(notice);
        }
    }
}
