//! Model of a timer with a preloaded reload register, as the step player sees it, in cycles of the
//! core.

use core::cell::Cell;

use crate::{IDLE_TICKS, MAX_EVENTS, NextWords, OutputPorts, StepPlayer, Stepping, UpdateTimer};

/// Core cycles in a tick of the timer.
pub const CYCLES_A_TICK: u64 = 2;

/// A virtual timer in cycles of the core; each access by the interrupt takes time.
#[derive(Debug)]
pub struct VirtualUpdateTimer {
    now: Cell<u64>,
    period_start: Cell<u64>,
    /// Reload value in force; the preloaded one follows.
    active: Cell<u32>,
    preloaded: Cell<u32>,
    due: Cell<bool>,
    updates: Cell<u16>,
    latched: Cell<bool>,
    count_is_wired: Cell<bool>,
    /// Cost of an access, cycles.
    access_cycles: Cell<u64>,
    turning: Cell<bool>,
    masked: Cell<bool>,
}

impl Default for VirtualUpdateTimer {
    /// A timer that has just been started.
    fn default() -> Self {
        Self {
            now: Cell::new(0),
            period_start: Cell::new(0),
            active: Cell::new(IDLE_TICKS - 1),
            preloaded: Cell::new(IDLE_TICKS - 1),
            due: Cell::new(false),
            updates: Cell::new(0),
            latched: Cell::new(false),
            count_is_wired: Cell::new(false),
            access_cycles: Cell::new(0),
            turning: Cell::new(false),
            masked: Cell::new(true),
        }
    }
}

impl VirtualUpdateTimer {
    /// Current time, in cycles of the core.
    pub fn now_cycles(&self) -> u64 {
        self.now.get()
    }

    /// Sets the cost of every access of the interrupt to the timer, cycles: it stands for the
    /// surrounding instructions.
    pub fn set_access_cycles(&self, cycles: u64) {
        self.access_cycles.set(cycles);
    }

    /// Connects or disconnects a second timer that counts the updates.
    pub fn wire_update_count(&self, wired: bool) {
        self.count_is_wired.set(wired);
    }

    /// The second timer's count of updates, modulo 2^15; 0 without one.
    pub fn update_count(&self) -> u16 {
        if self.count_is_wired.get() { self.updates.get() } else { 0 }
    }

    /// Time of the next update, cycles.
    pub fn next_at(&self) -> u64 {
        self.period_start.get() + (u64::from(self.active.get()) + 1) * CYCLES_A_TICK
    }

    /// Advances time to `cycle`, with the updates that fall into it.
    pub fn pass_to(&self, cycle: u64) {
        while self.next_at() <= cycle {
            self.period_start.set(self.next_at());
            self.active.set(self.preloaded.get());
            // The interrupt's line rises once; it is the flag.
            let was_due = self.due.replace(true);
            self.latched.set(self.latched.get() || !was_due);
            self.updates.set((self.updates.get() + 1) & MAX_EVENTS);
            // All periods after the first are alike.
            let period = (u64::from(self.active.get()) + 1) * CYCLES_A_TICK;
            let whole = cycle.saturating_sub(self.period_start.get()) / period;
            self.period_start.set(self.period_start.get() + whole * period);
            self.updates.set((u64::from(self.updates.get()) + whole) as u16 & MAX_EVENTS);
        }
        self.now.set(self.now.get().max(cycle));
    }

    /// Advances by some cycles.
    pub fn pass(&self, cycles: u64) {
        self.pass_to(self.now.get() + cycles);
    }

    /// Advances time to the next update, unless one waits to be served.
    pub fn next_update(&self) {
        if !self.latched.get() {
            self.pass_to(self.next_at());
        }
    }

    /// Returns true if the interrupt is called.
    pub fn is_called(&self) -> bool {
        self.latched.get() && !self.masked.get()
    }

    /// Returns true if the interrupt is masked.
    pub fn is_masked(&self) -> bool {
        self.masked.get()
    }

    /// Calls the player as the processor does: the step interrupt, then the other one if it was
    /// requested.
    pub fn interrupt<M: Stepping, const PORTS: usize, const N: usize>(
        &self,
        player: &StepPlayer<M, PORTS, N>,
        next: &mut NextWords<PORTS>,
        ports: &impl OutputPorts<PORTS>,
    ) {
        self.latched.set(false);
        player.update(next, self, ports);
        if self.turning.take() {
            player.start_or_end(next, self);
        }
        // The interrupt line follows the flag's level.
        self.latched.set(self.latched.get() || self.due.get());
    }
}

impl UpdateTimer for VirtualUpdateTimer {
    fn clear_update(&self) {
        self.pass(self.access_cycles.get());
        self.due.set(false);
    }

    fn is_update_due(&self) -> bool {
        self.pass(self.access_cycles.get());
        self.due.get()
    }

    fn set_reload(&self, reload: u32) {
        debug_assert!(reload >= 1);
        self.pass(self.access_cycles.get());
        self.preloaded.set(reload);
    }

    fn set_update_count(&self, count: u16) {
        self.updates.set(count);
    }

    fn call_start_or_end(&self) {
        self.turning.set(true);
    }

    fn mask(&self) {
        self.masked.set(true);
    }

    fn unmask(&self) {
        self.masked.set(false);
    }

    fn forget_served(&self) {
        // The interrupt line follows the flag's level: an unserved update stays pending.
        self.latched.set(self.due.get());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks that the flag is up, and that the second timer counts every update, even if many fall
    /// into one pass.
    #[test]
    fn one_pass_is_as_many_small_ones() {
        for (reload, cycles) in [(0, 1_000_001), (99, 70_000 * 200), (20_999, 41_999), (20_999, 42_000), (6, 3)] {
            let [leaping, stepping] = [(); 2].map(|()| {
                let timer = VirtualUpdateTimer::default();
                timer.wire_update_count(true);
                timer.preloaded.set(reload);
                timer
            });
            let start = stepping.next_at();
            leaping.pass_to(start + cycles);
            while stepping.next_at() <= start + cycles {
                stepping.pass_to(stepping.next_at());
            }
            stepping.pass_to(start + cycles);
            assert_eq!(leaping.update_count(), stepping.update_count(), "{reload} {cycles}");
            assert_eq!(leaping.next_at(), stepping.next_at(), "{reload} {cycles}");
            assert_eq!(leaping.now_cycles(), stepping.now_cycles());
            assert!(leaping.due.get() && leaping.latched.get());
        }
    }
}
