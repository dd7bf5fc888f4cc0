//! What the step interrupt does at each update of its timer, without the registers.
//!
//! The timer runs all the time and reloads from a preloaded register: the interval written at one update rules the
//! gap *after the next one*. So the player is two events ahead of the pins, and an interrupt that comes late delays
//! one edge instead of missing a reload. Between motions it finds the queue empty and looks again every
//! [`IDLE_TICKS`]; nobody has to start the timer.

use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering};

use ferrostep_planner::{StepEntry, StepKind};

/// How often the player looks for the first entry of a motion, ticks: a motion starts at most twice this late.
pub const IDLE_TICKS: u32 = 21_000;

/// Longer intervals are passed in pieces of this, so that a stop is noticed within two of them (25 ms) at any speed.
const LONGEST_TICKS: u32 = 1 << 20;

/// Most entries thrown away in one update while stopping: keeps the interrupt short.
const DROPPED_AT_ONCE: usize = 32;

/// Flags between those who make step entries and the interrupt that plays them.
#[derive(Debug, Default)]
pub struct StepLink {
    run: AtomicBool,
    busy: AtomicBool,
    ran_dry: AtomicBool,
    stop: AtomicBool,
    stopped: AtomicBool,
    dropped_steps: [AtomicI32; 4],
    dropped_events: [AtomicU32; 4],
}

/// Steps that were in the queue when motion was stopped: signed by direction, and both directions added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DroppedSteps {
    /// Forwards minus backwards, a motor each.
    pub signed: [i32; 4],
    /// All, a motor each.
    pub issued: [u32; 4],
}

impl StepLink {
    /// Nothing runs.
    pub const fn new() -> Self {
        Self {
            run: AtomicBool::new(false),
            busy: AtomicBool::new(false),
            ran_dry: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            stopped: AtomicBool::new(false),
            dropped_steps: [const { AtomicI32::new(0) }; 4],
            dropped_events: [const { AtomicU32::new(0) }; 4],
        }
    }

    /// Lets the player take entries, until it finds none.
    pub fn start(&self) {
        // In this order: a player that sees `run` is busy from its next update on, and only then may say otherwise.
        self.run.store(true, Ordering::Release);
        self.busy.store(true, Ordering::Release);
    }

    /// Whether the player takes entries.
    pub fn is_running(&self) -> bool {
        self.run.load(Ordering::Acquire)
    }

    /// Whether an event that was taken is still to come.
    pub fn is_busy(&self) -> bool {
        self.busy.load(Ordering::Acquire)
    }

    /// Whether the player has found the queue empty since the last call.
    pub fn take_ran_dry(&self) -> bool {
        self.ran_dry.swap(false, Ordering::AcqRel)
    }

    /// From the next update on no motor steps, and the queue is emptied unplayed. Callable from any priority.
    pub fn request_stop(&self) {
        self.stop.store(true, Ordering::Release);
    }

    /// Whether a stop has been asked for and not been taken note of.
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    /// After a stop, once the queue is empty: what was thrown away. The player may run again after this.
    pub fn take_stopped(&self) -> Option<DroppedSteps> {
        if !(self.stop.load(Ordering::Acquire) && self.stopped.load(Ordering::Acquire)) {
            return None;
        }
        let mut dropped = DroppedSteps::default();
        for (sum, steps) in dropped.signed.iter_mut().zip(&self.dropped_steps) {
            *sum = steps.swap(0, Ordering::AcqRel);
        }
        for (sum, events) in dropped.issued.iter_mut().zip(&self.dropped_events) {
            *sum = events.swap(0, Ordering::AcqRel);
        }
        self.ran_dry.store(false, Ordering::Release);
        // In this order: the player sets `stopped` only while it sees `stop`.
        self.stop.store(false, Ordering::Release);
        self.stopped.store(false, Ordering::Release);
        Some(dropped)
    }

    fn drop_steps(&self, axes: u8, directions: u8, count: u16) {
        for (motor, (steps, events)) in self.dropped_steps.iter().zip(&self.dropped_events).enumerate() {
            if axes >> motor & 1 != 0 {
                let count = u32::from(count);
                let signed = if directions >> motor & 1 != 0 { (count as i32).wrapping_neg() } else { count as i32 };
                steps.fetch_add(signed, Ordering::AcqRel);
                events.fetch_add(count, Ordering::AcqRel);
            }
        }
    }
}

/// One moment of the timer.
#[derive(Clone, Copy, Debug)]
struct Event {
    /// Ticks from the event before.
    interval_ticks: u32,
    /// Motors that step; none in the pauses.
    axes: u8,
    /// Direction signals during the event.
    directions: u8,
    /// Whether it came from the queue.
    is_motion: bool,
}

/// What to do after the steps of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Next {
    /// Direction signals to put out now, if they change: bit i = motor i runs backwards.
    pub directions: Option<u8>,
    /// Ticks between the next update and the one after it, 2 to 2^21.
    pub interval_ticks: u32,
}

/// The state of the step interrupt.
#[derive(Debug)]
pub struct StepPlayer {
    /// The event of the next update.
    due: Event,
    /// The one after it.
    after: Event,
    /// Events of the present entry that are still to be fetched.
    left: u16,
    /// Rest of the interval before the next of them, 0 if it has not begun.
    gap_ticks: u32,
    interval_ticks: u32,
    axes: u8,
    added: u8,
    /// Directions of the last event fetched.
    directions: u8,
    /// Direction signals as they are put out.
    pins: u8,
}

impl Default for StepPlayer {
    fn default() -> Self {
        Self::new()
    }
}

impl StepPlayer {
    /// A player at standstill, all direction signals forwards.
    pub const fn new() -> Self {
        let idle = Event { interval_ticks: IDLE_TICKS, axes: 0, directions: 0, is_motion: false };
        Self {
            due: idle,
            after: idle,
            left: 0,
            gap_ticks: 0,
            interval_ticks: 0,
            axes: 0,
            added: 0,
            directions: 0,
            pins: 0,
        }
    }

    /// At an update: the motors that step now. Once an update, before [`Self::advance`].
    #[inline]
    pub fn due_axes(&mut self, link: &StepLink) -> u8 {
        if link.is_stopping() {
            return 0;
        }
        core::mem::take(&mut self.due.axes)
    }

    /// After the steps: fetches an event from the queue, of which `pop` takes the oldest entry.
    #[inline]
    pub fn advance(&mut self, link: &StepLink, mut pop: impl FnMut() -> Option<StepEntry>) -> Next {
        if link.is_stopping() {
            self.drop_all(link, pop);
        } else {
            self.due = self.after;
            self.after = self.fetch(link, &mut pop);
            let is_over = !(self.due.is_motion || self.after.is_motion || link.is_running());
            if is_over && self.due.directions == self.directions {
                link.busy.store(false, Ordering::Release);
            }
        }
        let directions = (self.due.directions != self.pins).then_some(self.due.directions);
        self.pins = self.due.directions;
        Next { directions, interval_ticks: self.after.interval_ticks }
    }

    #[inline]
    fn fetch(&mut self, link: &StepLink, pop: &mut impl FnMut() -> Option<StepEntry>) -> Event {
        if self.gap_ticks == 0 {
            if self.left == 0 && !self.load(link, pop) {
                return Event { interval_ticks: IDLE_TICKS, axes: 0, directions: self.directions, is_motion: false };
            }
            self.gap_ticks = self.interval_ticks;
        }
        let mut event = Event { interval_ticks: LONGEST_TICKS, axes: 0, directions: self.directions, is_motion: true };
        if self.gap_ticks > 2 * LONGEST_TICKS {
            self.gap_ticks = self.gap_ticks.wrapping_sub(LONGEST_TICKS);
            return event;
        }
        event.interval_ticks = core::mem::take(&mut self.gap_ticks);
        event.axes = self.axes;
        self.left = self.left.wrapping_sub(1);
        if self.left == 0 {
            event.axes |= self.added;
        }
        event
    }

    /// Takes the next entry that has time in it; `false` if there is none.
    #[inline]
    fn load(&mut self, link: &StepLink, pop: &mut impl FnMut() -> Option<StepEntry>) -> bool {
        if !link.is_running() {
            return false;
        }
        loop {
            let (interval_ticks, left, axes, added) = match pop().map(StepEntry::kind) {
                Some(StepKind::Stair { interval_ticks, count, axes, added }) => (interval_ticks, count, axes, added),
                Some(StepKind::Wait { interval_ticks }) => (interval_ticks, 1, 0, 0),
                Some(StepKind::Directions { directions }) => {
                    self.directions = directions;
                    continue;
                }
                None => {
                    link.run.store(false, Ordering::Release);
                    link.ran_dry.store(true, Ordering::Release);
                    return false;
                }
            };
            // A timer whose reload value is zero stands still.
            self.interval_ticks = interval_ticks.max(2);
            (self.left, self.axes, self.added) = (left, axes, added);
            return true;
        }
    }

    /// Counts and forgets what is left, the queue a portion an update.
    #[cold]
    fn drop_all(&mut self, link: &StepLink, mut pop: impl FnMut() -> Option<StepEntry>) {
        for event in [self.due, self.after] {
            link.drop_steps(event.axes, event.directions, 1);
        }
        if self.left > 0 {
            link.drop_steps(self.axes, self.directions, self.left);
            link.drop_steps(self.added & !self.axes, self.directions, 1);
            self.left = 0;
        }
        self.gap_ticks = 0;
        for _ in 0..DROPPED_AT_ONCE {
            match pop().map(StepEntry::kind) {
                Some(StepKind::Stair { count, axes, added, .. }) => {
                    link.drop_steps(axes, self.directions, count);
                    link.drop_steps(added & !axes, self.directions, 1);
                }
                Some(StepKind::Wait { .. }) => {}
                Some(StepKind::Directions { directions }) => self.directions = directions,
                None => {
                    link.run.store(false, Ordering::Release);
                    link.busy.store(false, Ordering::Release);
                    link.stopped.store(true, Ordering::Release);
                    break;
                }
            }
        }
        let idle = Event { interval_ticks: IDLE_TICKS, axes: 0, directions: self.directions, is_motion: false };
        (self.due, self.after) = (idle, idle);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
