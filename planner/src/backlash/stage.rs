//! Stage in which compensating steps join the events on their way to the step queue.

use super::changes::{Change, Changes};
use super::{Backlash, BacklashCorrection};
use crate::kinematics::Geometry;
use crate::limits::Limits;
use crate::passing::{PassedEntries, Stage, Waiting};
use crate::step_queue::{Notice, StepEntry, StepKind};
use crate::time_units::TICKS_PER_SECOND;

/// Units of 10 nm in a millimetre.
const MM: f32 = 100_000.0;

/// Bits of X and Y in an axis mask.
const XY: u8 = 0b11;

/// Index of Z.
const Z: usize = 2;

/// Fraction of its axis' highest speed up to which a motor takes up play, since it gets that speed
/// with one step.
const PART_OF_SPEED: f32 = 0.25;

/// A motor and its play.
#[derive(Clone, Copy, Debug)]
struct Drive {
    /// Steps of the corrected share of the play.
    play: i32,
    /// Length of a step, 10 nm.
    step_10nm: u32,
    /// Path between two compensating steps, 10 nm.
    way_10nm: i32,
    /// Minimum time between two compensating steps, ticks.
    least_ticks: u32,
    /// Direction of the motor's last step: 1 or -1; 0 if none was seen.
    side: i32,
    /// Steps by which the motor should be ahead of the plan (`wanted`) and steps by which it is
    /// (`made`).
    wanted: i32,
    made: i32,
    /// Path until the next compensating step; negative if it is overdue.
    left_10nm: i32,
    /// Time since the last compensating step.
    since_ticks: u32,
    /// Steps handed on, modulo 2^32.
    steps: u32,
}

impl Drive {
    const NONE: Self = Self {
        play: 0,
        step_10nm: 0,
        way_10nm: 0,
        least_ticks: 0,
        side: 0,
        wanted: 0,
        made: 0,
        left_10nm: 0,
        since_ticks: u32::MAX,
        steps: 0,
    };

    /// True if play is left to take up in the direction of the last step.
    fn is_behind(&self) -> bool {
        self.wanted.wrapping_sub(self.made).signum() == self.side && self.side != 0
    }

    /// True if a step that takes up play is due `ticks` from now.
    fn is_due(&self, ticks: u32, at_once: bool) -> bool {
        let since_ticks = self.since_ticks.saturating_add(ticks);
        self.is_behind() && (at_once || self.left_10nm <= 0) && since_ticks >= self.least_ticks
    }
}

/// Backlash stage between the planner, or the bed's stage, and the step queue.
#[derive(Debug)]
pub struct BacklashStage {
    backlash: Backlash,
    geometry: Geometry,
    drives: [Drive; 3],
    is_on: bool,
    /// Direction signals of the plan, and the actual ones: a motor that still takes up play
    /// reverses with its next step.
    planned: u8,
    actual: u8,
    /// The motors move towards a sensor.
    seeks: bool,
    /// Z has stepped since X and Y last did.
    z_moves_alone: bool,
    changes: Changes,
    waiting: Waiting,
}

impl BacklashCorrection for BacklashStage {
    const PRESENT: bool = true;

    fn new(geometry: &Geometry, limits: &Limits) -> Self {
        let mut stage = Self {
            backlash: Backlash::NONE,
            geometry: *geometry,
            drives: [Drive::NONE; 3],
            is_on: false,
            planned: 0,
            actual: 0,
            seeks: false,
            z_moves_alone: false,
            changes: Changes::NONE,
            waiting: Waiting::NONE,
        };
        stage.set_limits(limits);
        stage
    }

    fn backlash(&self) -> Backlash {
        self.backlash
    }

    #[inline(never)]
    fn set(&mut self, backlash: &Backlash) {
        self.backlash = *backlash;
        let Backlash { play_mm, correction, smoothing_mm } = *backlash;
        for (drive, (mm, steps)) in self.drives.iter_mut().zip(play_mm.into_iter().zip(self.geometry.steps_per_mm)) {
            let per_mm = steps.to_f64() as f32;
            // The casts saturate.
            drive.play = ((mm * correction) as f32 * per_mm + 0.5) as i32;
            drive.step_10nm = (MM / per_mm) as u32;
            drive.way_10nm = if drive.play > 0 { (smoothing_mm as f32 * MM / drive.play as f32) as i32 } else { 0 };
            if !self.is_on {
                // The moves made meanwhile were not seen.
                (drive.side, drive.wanted) = (0, drive.made);
            }
        }
        // A started correction is finished even if the play is set to 0.
        self.is_on = self.drives.iter().any(|drive| drive.play > 0 || drive.wanted != drive.made);
    }

    #[inline(never)]
    fn set_limits(&mut self, limits: &Limits) {
        let axes = self.geometry.steps_per_mm.into_iter().zip(limits.max_feed_mm_per_s);
        for (drive, (steps, speed)) in self.drives.iter_mut().zip(axes) {
            // The cast saturates.
            drive.least_ticks = (TICKS_PER_SECOND as f32 / ((steps.to_f64() * speed) as f32 * PART_OF_SPEED)) as u32;
        }
    }

    #[inline(never)]
    fn stand(&mut self, issued: [u64; 4], directions: u8) -> [i64; 3] {
        let [x, y, z, _] = issued.map(|steps| steps as u32);
        while let Some((motor, change)) = self.changes.take_undone([x, y, z]) {
            let Some(drive) = self.drives.get_mut(motor) else { continue };
            match change {
                Change::Began => drive.side = 0,
                Change::TookUp => drive.made = drive.made.wrapping_sub(drive.side),
                Change::Turned => {
                    drive.wanted = drive.wanted.wrapping_sub(drive.side.wrapping_mul(drive.play));
                    drive.side = drive.side.wrapping_neg();
                }
            }
        }
        for (drive, steps) in self.drives.iter_mut().zip([x, y, z]) {
            drive.steps = steps;
        }
        self.waiting = Waiting::NONE;
        (self.planned, self.actual) = (directions, directions);
        self.drives.map(|drive| drive.made.into())
    }

    fn redefined(&mut self) {
        for drive in &mut self.drives {
            drive.wanted = drive.wanted.wrapping_sub(drive.made);
            drive.made = 0;
        }
    }

    fn take(&mut self, entries: &[StepEntry]) -> bool {
        if self.is_on {
            self.waiting.take(entries);
        }
        self.is_on
    }

    fn take_notice(&mut self, notice: &Notice) -> bool {
        if self.is_on {
            self.waiting.take_notice(notice);
        }
        self.is_on
    }

    fn is_waiting(&self) -> bool {
        self.waiting.is_any()
    }

    // Not inlined: it exists once in the image, for the planner's task alone.
    #[inline(never)]
    fn work(&mut self, seeks: bool, out: &mut PassedEntries) -> Option<Notice> {
        self.seeks = seeks;
        self.pass_on(out)
    }
}

/// Direction in which a motor steps with these direction signals: 1 or -1.
fn way(directions: u8, motor: usize) -> i32 {
    if directions >> motor & 1 == 0 { 1 } else { -1 }
}

impl Stage for BacklashStage {
    fn waiting(&mut self) -> &mut Waiting {
        &mut self.waiting
    }

    fn added_steps(&self) -> [i32; 3] {
        self.drives.map(|drive| drive.made)
    }

    fn pass(&mut self, entry: StepEntry, out: &mut PassedEntries) {
        match entry.kind() {
            StepKind::Directions { directions } => {
                self.planned = directions;
                self.turn_to(directions ^ (directions ^ self.actual) & self.behind(), out);
                self.waiting.pass_entry();
            }
            StepKind::Wait { interval_ticks } => {
                self.let_pass(interval_ticks, 0);
                out.push(entry);
                self.waiting.pass_entry();
            }
            StepKind::Stair { interval_ticks, axes, added, .. } => {
                let left = self.waiting.events_left();
                let sure = self.sure_events(interval_ticks, axes, added, left);
                if sure == 0 {
                    let axes = if left == 1 { axes ^ added } else { axes };
                    self.pass_one(interval_ticks, axes, out);
                } else {
                    let added = if sure == left { added } else { 0 };
                    self.pass_some(interval_ticks, sure, axes, added, out);
                }
            }
        }
    }
}

impl BacklashStage {
    /// Sets the direction signals.
    fn turn_to(&mut self, directions: u8, out: &mut PassedEntries) {
        if directions != self.actual {
            self.actual = directions;
            out.push(StepEntry::directions(directions));
        }
    }

    /// The motors that still have play to take up.
    fn behind(&self) -> u8 {
        let drives = self.drives.iter().zip(0..);
        drives.filter(|(drive, _)| drive.play > 0 && drive.is_behind()).fold(0, |mask, (_, motor)| mask | 1 << motor)
    }

    /// True if a motor takes up play as fast as it may: while seeking a sensor, and Z while it
    /// moves alone, so that a line begins at its height.
    fn is_at_once(&self, motor: usize) -> bool {
        self.seeks || motor == Z && self.z_moves_alone
    }

    /// Direction of a motor's next planned step: 1 or -1.
    fn way_of(&self, motor: usize) -> i32 {
        way(self.planned, motor)
    }

    /// Number of an entry's next `left` events that can pass unchanged: in none of them does a
    /// motor reverse or take up play.
    #[inline(never)]
    fn sure_events(&self, interval_ticks: u32, axes: u8, added: u8, left: u16) -> u16 {
        let mut sure = left;
        let way_10nm = self.way_10nm(axes).max(1);
        for (motor, drive) in self.drives.iter().enumerate() {
            let steps_at = |axes: u8| axes >> motor & 1 == 1;
            if drive.side != self.way_of(motor) && drive.play > 0 {
                // The motor reverses with its first step.
                if steps_at(axes) && (left > 1 || !steps_at(added)) {
                    return 0;
                }
                if steps_at(axes | added) {
                    sure = sure.min(left.wrapping_sub(1));
                }
            }
            if drive.is_behind() {
                let by_way =
                    if self.is_at_once(motor) { 0 } else { (drive.left_10nm.max(0) as u32).div_ceil(way_10nm) };
                let time_left = drive.least_ticks.saturating_sub(drive.since_ticks);
                let by_time = time_left.div_ceil(interval_ticks.max(1)).saturating_sub(1);
                // A compensating step is due in the event after these.
                sure = sure.min(by_way.max(by_time).min(u16::MAX.into()) as u16);
            }
        }
        sure
    }

    /// Path of an event of these motors, the sum over X, Y and Z.
    #[inline(never)]
    fn way_10nm(&self, axes: u8) -> u32 {
        let ways = self.drives.iter().enumerate();
        ways.filter(|(motor, _)| axes >> motor & 1 == 1).map(|(_, drive)| drive.step_10nm).sum()
    }

    /// Adds time and distance to the motors that have play to take up.
    #[inline(never)]
    fn let_pass(&mut self, ticks: u32, way_10nm: u32) {
        for drive in &mut self.drives {
            drive.since_ticks = drive.since_ticks.saturating_add(ticks);
            drive.left_10nm = drive.left_10nm.saturating_sub_unsigned(way_10nm);
        }
    }

    /// Counts steps of these motors that are handed on.
    #[inline(never)]
    fn count(&mut self, axes: u8, steps: u16) {
        if axes & (XY | 1 << Z) != 0 {
            self.z_moves_alone = axes & XY == 0;
        }
        for (motor, drive) in self.drives.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                drive.steps = drive.steps.wrapping_add(steps.into());
            }
        }
    }

    /// Adds events in which nothing reverses and nothing is due.
    fn pass_some(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8, out: &mut PassedEntries) {
        let last = axes ^ added;
        self.count(axes, count.wrapping_sub(1));
        self.count(last, 1);
        let ways_10nm = self.way_10nm(axes).saturating_mul(u32::from(count).saturating_sub(1));
        self.let_pass(interval_ticks.saturating_mul(count.into()), ways_10nm.saturating_add(self.way_10nm(last)));
        let entry = if count == 1 {
            StepEntry::stair(interval_ticks, 1, last, 0)
        } else {
            StepEntry::stair(interval_ticks, count, axes, added)
        };
        if let Some(entry) = entry {
            out.push(entry);
        }
        self.waiting.pass_events(count);
    }

    /// Adds an event, together with the compensating steps that are due.
    fn pass_one(&mut self, interval_ticks: u32, axes: u8, out: &mut PassedEntries) {
        self.turn(axes);
        self.turn_to(self.actual ^ (self.actual ^ self.planned) & axes, out);
        let (mut interval_ticks, beside) = (interval_ticks, self.due(interval_ticks) & !axes);
        // A motor that steps in this event gets its other step in the middle of the preceding
        // interval. Without room for one there, it is left to a later event.
        let half = interval_ticks / 2;
        let has_room = half >= self.geometry.minimum_event_interval_ticks.max(1);
        let early = if has_room { self.due(half) & axes } else { 0 };
        if early != 0 {
            out.push(StepEntry::event(half, early));
            interval_ticks = interval_ticks.wrapping_sub(half);
            self.let_pass(half, 0);
            self.take_up(early);
        }
        self.let_pass(interval_ticks, self.way_10nm(axes));
        self.take_up(beside);
        self.count(axes, 1);
        out.push(StepEntry::event(interval_ticks, axes | beside));
        self.waiting.pass_events(1);
    }

    /// Notes which of the stepping motors reverse.
    #[inline(never)]
    fn turn(&mut self, axes: u8) {
        for motor in 0..3 {
            let way = self.way_of(motor);
            let Some(drive) = self.drives.get_mut(motor) else { continue };
            if axes >> motor & 1 == 0 || drive.side == way {
                continue;
            }
            let change = if drive.side == 0 { Change::Began } else { Change::Turned };
            self.changes.note(motor, drive.steps.wrapping_add(1), change);
            if change == Change::Turned {
                drive.wanted = drive.wanted.wrapping_add(way.wrapping_mul(drive.play));
                drive.left_10nm = drive.way_10nm / 2;
            }
            drive.side = way;
        }
    }

    /// The motors for which a compensating step is due in this time.
    #[inline(never)]
    fn due(&self, ticks: u32) -> u8 {
        let mut due = 0;
        for (motor, drive) in self.drives.iter().enumerate() {
            // The direction signal of a motor without play may already have changed, before its
            // first step in the new direction.
            if drive.is_due(ticks, self.is_at_once(motor)) && way(self.actual, motor) == drive.side {
                due |= 1 << motor;
            }
        }
        due
    }

    /// Makes these motors take a compensating step.
    #[inline(never)]
    fn take_up(&mut self, axes: u8) {
        for (motor, drive) in self.drives.iter_mut().enumerate() {
            if axes >> motor & 1 == 0 {
                continue;
            }
            drive.steps = drive.steps.wrapping_add(1);
            drive.made = drive.made.wrapping_add(drive.side);
            // The next one is due this far from where this one was due, or from here if it comes
            // early.
            drive.left_10nm = drive.left_10nm.min(0).saturating_add(drive.way_10nm);
            drive.since_ticks = 0;
            self.changes.note(motor, drive.steps, Change::TookUp);
        }
    }
}
