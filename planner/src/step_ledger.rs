//! Positions that step entries give the motors, with their times.

use crate::{StepEntry, StepKind};

/// Sees every step event as it happens.
pub trait StepObserver {
    /// Motors in `axes` step at `tick`; bit i of `directions` = motor i steps backwards.
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8);
}

impl StepObserver for () {
    #[inline]
    fn stepped(&mut self, _tick: u64, _axes: u8, _directions: u8) {}
}

/// Counts what step entries do: positions, steps issued, and the motion clock.
#[derive(Clone, Debug, Default)]
pub struct StepLedger {
    tick: u64,
    directions: u8,
    motor_steps: [i64; 4],
    issued: [u64; 4],
}

impl StepLedger {
    /// Motion clock at the last event.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Advances the motion clock to a tick without an event, the end of a move. An earlier tick
    /// changes nothing.
    pub fn advance_to(&mut self, tick: u64) {
        self.tick = self.tick.max(tick);
    }

    /// The direction signals.
    pub fn directions(&self) -> u8 {
        self.directions
    }

    /// Positions of the X, Y, Z (A, B, Z) and extruder motors.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.motor_steps
    }

    /// Steps issued so far, both directions added.
    pub fn issued(&self) -> [u64; 4] {
        self.issued
    }

    /// Tick of the first event of an entry added now, or of its end where it has none.
    #[inline]
    pub fn first_tick(&self, entry: StepEntry) -> u64 {
        self.tick
            + match entry.kind() {
                StepKind::Stair { interval_ticks, .. } | StepKind::Wait { interval_ticks } => u64::from(interval_ticks),
                StepKind::Directions { .. } => 0,
            }
    }

    /// Adds an entry; `observer` sees each of its events.
    #[inline]
    pub fn play(&mut self, entry: StepEntry, observer: &mut impl StepObserver) {
        match entry.kind() {
            StepKind::Directions { directions } => self.directions = directions,
            StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                let all = axes ^ added;
                self.count(all, 1);
                for _ in 1..count {
                    self.event(interval_ticks, axes, observer);
                }
                self.event(interval_ticks, all, observer);
                if count > 1 {
                    self.count(axes, count - 1);
                }
            }
        }
    }

    /// Adds a step of each motor in `axes` for each event.
    #[inline]
    fn count(&mut self, axes: u8, events: u16) {
        let mut motors = axes & 15;
        while motors != 0 {
            let motor = motors.trailing_zeros() as usize & 3;
            motors &= motors.wrapping_sub(1);
            let events = u64::from(events);
            self.issued[motor] = self.issued[motor].wrapping_add(events);
            let steps = if self.directions >> motor & 1 == 0 { events } else { events.wrapping_neg() };
            self.motor_steps[motor] = self.motor_steps[motor].wrapping_add_unsigned(steps);
        }
    }

    #[inline]
    fn event(&mut self, interval_ticks: u32, axes: u8, observer: &mut impl StepObserver) {
        self.tick = self.tick.wrapping_add(u64::from(interval_ticks));
        observer.stepped(self.tick, axes, self.directions & axes);
    }

    /// Takes back steps that never reached the motors, because motion was stopped before them.
    ///
    /// `steps` are signed by direction, `issued` counts both directions.
    pub fn take_back(&mut self, steps: [i32; 4], issued: [u32; 4]) {
        for motor in 0..4 {
            self.motor_steps[motor] -= i64::from(steps[motor]);
            self.issued[motor] = self.issued[motor].saturating_sub(u64::from(issued[motor]));
        }
    }

    /// Turns the motion clock back, by steps that were taken back.
    pub fn turn_back(&mut self, ticks: u64) {
        self.tick = self.tick.saturating_sub(ticks);
    }

    /// Moves the motors without steps: not issued, in no time, seen by no observer.
    pub fn displace(&mut self, steps: [i64; 4]) {
        for (motor, steps) in self.motor_steps.iter_mut().zip(steps) {
            *motor = motor.wrapping_add(steps);
        }
    }

    /// Sets the position counters of X, Y and Z (A, B, Z).
    pub fn redefine_motor_steps(&mut self, motor_steps: [i64; 3]) {
        self.motor_steps[..3].copy_from_slice(&motor_steps);
    }
}
