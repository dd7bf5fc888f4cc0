//! The printer's ports, as the firmware's.

use std::cell::RefCell;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{MotionFigures, Reply};
use ferrostep_hal_shim::Heater;
use ferrostep_hal_shim::stepping::Stepping;
use ferrostep_hal_shim::virtual_board::VirtualDelay;
use ferrostep_planner::{Limits, MotionChoice, Move, MoveError, Moved};
use ferrostep_printer::machine::Silence;
use ferrostep_printer::{Failure, HeaterStatus, Heating, Motion, MotionError, Replies, Seek};

use super::{Board, BoardMachine};

/// How often a command that waits for motion looks whether it has come.
const LOOK_MS: u32 = 1;

/// Planner and motors.
pub struct BoardMotion<'b, 'a, M>(pub(super) &'b Board<'a, M>);

impl<'a, M: Stepping> BoardMotion<'_, 'a, M> {
    fn with<T>(&self, act: impl FnOnce(&mut BoardMachine<'a, M>) -> T) -> T {
        act(&mut self.0.machine.borrow_mut())
    }

    /// Tries until it succeeds, then wakes the planner task, which comes before anything else here goes on.
    async fn wait<T>(&self, mut attempt: impl FnMut(&mut BoardMachine<'a, M>) -> Option<T>) -> Result<T, MotionError> {
        let stops = self.with(|machine| machine.stops());
        loop {
            if self.0.interrupts.signals().is_halted() || self.with(|machine| machine.stops()) != stops {
                return Err(MotionError::Stopped);
            }
            if let Some(value) = self.with(&mut attempt) {
                self.0.plan();
                return Ok(value);
            }
            VirtualDelay(&self.0.clock).delay_ms(LOOK_MS).await;
        }
    }
}

impl<M: Stepping> Motion for BoardMotion<'_, '_, M> {
    async fn add(&mut self, request: Move) -> Result<Moved, MotionError> {
        self.wait(|machine| match machine.add(&request) {
            Err(MoveError::NoRoom) => None,
            Err(error) => Some(Err(MotionError::Move(error))),
            Ok(moved) => Some(Ok(moved)),
        })
        .await?
    }

    async fn set_fan_power(&mut self, power: u8) -> Result<(), MotionError> {
        self.wait(|machine| machine.add_fan_power(power).then_some(())).await
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.with(|machine| machine.flush());
        self.0.plan();
        self.wait(|machine| machine.is_idle().then_some(())).await
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<Seek, MotionError> {
        self.finish().await?;
        if self.add(request).await? == Moved::Nothing {
            return Ok(Seek::Missed);
        }
        self.with(|machine| machine.begin_seek(axis));
        self.0.plan();
        self.wait(|machine| machine.take_sought()).await
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.with(|machine| machine.position_10nm())
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.with(|machine| machine.set_position(position_10nm));
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.with(|machine| machine.motor_steps())
    }

    fn figures(&self) -> MotionFigures {
        self.with(|machine| machine.figures())
    }

    fn limits(&self) -> Limits {
        self.with(|machine| machine.limits())
    }

    fn set_limits(&mut self, limits: Limits) {
        self.with(|machine| machine.set_limits(limits));
    }

    fn motion_choice(&self) -> MotionChoice {
        self.with(|machine| machine.motion_choice())
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) {
        self.with(|machine| machine.set_motion_choice(choice));
    }

    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        self.with(|machine| machine.set_motors_enabled(axes, enabled));
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.with(|machine| machine.is_end_stop_triggered(axis))
    }

    fn stop(&mut self) -> i64 {
        self.with(|machine| machine.request_stop());
        self.0.work(Silence::default());
        self.with(|machine| machine.take_dropped_100pm())
    }
}

/// Heaters without mains: they stay at the temperature of the room, and files must allow that (M302).
pub struct ColdHeaters;

/// Temperature of the room, degrees Celsius.
const ROOM_CELSIUS: f32 = 22.0;

impl Heating for ColdHeaters {
    fn set_target(&mut self, _heater: Heater, _celsius: f32) {}

    fn status(&self, _heater: Heater) -> HeaterStatus {
        HeaterStatus { celsius: ROOM_CELSIUS, ..HeaterStatus::default() }
    }

    fn all_off(&mut self) {}
}

/// Everything that was said to the host, but for `ok`.
#[derive(Debug, Default)]
pub struct Transcript(pub RefCell<Vec<String>>);

impl Replies for Transcript {
    fn send(&self, reply: Reply<'_>) {
        if !matches!(reply, Reply::Ok) {
            self.0.borrow_mut().push(reply.to_string());
        }
    }

    /// The failure is returned as well.
    fn refuse(&self, _line: u32, _failure: &Failure) {}
}
