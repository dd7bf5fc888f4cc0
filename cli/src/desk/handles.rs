//! The machine as the printer's commands see it.

use std::cell::RefCell;
use std::future::poll_fn;
use std::task::Poll;

use ferrostep_gcode::MotionFigures;
use ferrostep_hal_shim::Heater;
use ferrostep_planner::{Limits, MotionChoice, Move, MoveError, Moved, PreparedBlock, PreparedMove, Retuned};
use ferrostep_printer::heat::HeatFault;
use ferrostep_printer::{HeaterStatus, Heating, HomingOutcome, Motion, MotionError, MotionFault, Signals};

use super::{Awaited, Desk, DeskDrivers};
use crate::record::Observer;

/// The desk's motion, seen from the command side.
#[derive(Clone, Copy)]
pub struct DeskMotion<'a, O> {
    /// The machine.
    pub desk: &'a RefCell<Desk<O>>,
    /// The drivers, whose stall signals axes may home by.
    pub drivers: &'a DeskDrivers,
    /// M112 ends every wait for motion.
    pub signals: &'a Signals,
}

impl<O: Observer> DeskMotion<'_, O> {
    /// Polls `attempt` until it is ready; time passes in between.
    async fn wait<T>(&self, mut attempt: impl FnMut(&mut Desk<O>) -> Option<T>) -> Result<T, MotionError> {
        poll_fn(|_| {
            if self.signals.is_halted() {
                return Poll::Ready(Err(MotionError::Stopped));
            }
            let mut desk = self.desk.borrow_mut();
            if let Some(miscount) = desk.take_miscount() {
                return Poll::Ready(Err(MotionError::Fault(MotionFault::Miscount(miscount))));
            }
            match attempt(&mut desk) {
                Some(value) => Poll::Ready(Ok(value)),
                None => Poll::Pending,
            }
        })
        .await
    }

    async fn wait_until_idle(&self) -> Result<(), MotionError> {
        self.wait(|desk| {
            if desk.is_idle() {
                return Some(());
            }
            desk.awaited = Awaited::Idle;
            None
        })
        .await
    }
}

impl<O: Observer> Motion for DeskMotion<'_, O> {
    async fn add(&mut self, request: Move) -> Result<Moved, MotionError> {
        self.wait(|desk| {
            let merged = desk.planner.merged_moves();
            let outcome = desk.add(&request);
            if outcome == Ok(Moved::Queued) {
                desk.observer.observer.planned(request.filament_100pm, request.ends_move);
                if let Some(script) = &mut desk.script {
                    script.moved(&request, desk.planner.merged_moves() > merged);
                }
            }
            desk.taken(outcome)
        })
        .await?
    }

    async fn add_prepared(&mut self, prepared: PreparedMove, now: Option<Retuned>) -> Result<Moved, MotionError> {
        self.wait(|desk| {
            let outcome = desk.planner.add_prepared(&prepared, now.as_ref());
            desk.taken(outcome)
        })
        .await?
    }

    async fn add_prepared_block(&mut self, prepared: PreparedBlock) -> Result<(), MotionError> {
        let taken = self.wait(|desk| {
            let outcome = desk.planner.add_prepared_block(&prepared);
            desk.taken(outcome.map(|()| Moved::Queued))
        });
        taken.await?.map(|_| ())
    }

    fn refine_position(&mut self, position_10nm: [i64; 3]) -> bool {
        self.desk.borrow_mut().planner.refine_position(position_10nm)
    }

    async fn set_fan_power(&mut self, power: u8) -> Result<(), MotionError> {
        self.wait(|desk| {
            if desk.planner.is_look_ahead_empty() {
                desk.heat.set_part_fan_power(power);
            } else if !desk.planner.add_fan_power(power) {
                desk.awaited = Awaited::Room;
                return None;
            }
            Some(())
        })
        .await
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.desk.borrow_mut().planner.flush();
        self.wait_until_idle().await?;
        let violation = self.desk.borrow_mut().planner.take_violation();
        violation.map_or(Ok(()), |violation| Err(MotionError::Move(MoveError::Violation(violation))))
    }

    fn begin_homing(&mut self) {
        self.desk.borrow_mut().begin_homing();
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        self.finish().await?;
        if self.add(request).await? == Moved::Nothing {
            return Ok(HomingOutcome::Missed);
        }
        {
            let mut desk = self.desk.borrow_mut();
            desk.planner.flush();
            desk.sought = None;
            desk.stall_signal = self.drivers.stall_signal(axis);
        }
        self.wait(|desk| {
            let sought = desk.sought.take();
            if sought.is_none() {
                desk.awaited = Awaited::EndStop(axis);
            }
            sought
        })
        .await
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.desk.borrow().planner.position_10nm()
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.desk.borrow_mut().set_position(position_10nm);
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.desk.borrow().board.motors.ledger.motor_steps()
    }

    fn figures(&self) -> MotionFigures {
        self.desk.borrow().motion_figures()
    }

    fn limits(&self) -> Limits {
        *self.desk.borrow().planner.limits()
    }

    fn set_limits(&mut self, limits: Limits) {
        self.desk.borrow_mut().planner.set_limits(limits);
    }

    fn motion_choice(&self) -> MotionChoice {
        *self.desk.borrow().planner.motion_choice()
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) {
        self.desk.borrow_mut().planner.set_motion_choice(choice);
    }

    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        let motors = &mut self.desk.borrow_mut().enabled_motors;
        *motors = if enabled { *motors | axes } else { *motors & !axes };
    }

    fn take_fault(&mut self) -> Option<MotionFault> {
        self.desk.borrow_mut().take_miscount().map(MotionFault::Miscount)
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.desk.borrow().board.motors.is_triggered(axis)
    }

    fn stop(&mut self) -> i64 {
        self.desk.borrow_mut().stop()
    }
}

/// The desk's heaters, seen from the command side.
#[derive(Clone, Copy)]
pub struct DeskHeating<'a, O> {
    /// The machine.
    pub desk: &'a RefCell<Desk<O>>,
}

impl<O: Observer> Heating for DeskHeating<'_, O> {
    fn set_target(&mut self, heater: Heater, celsius: f32) {
        self.desk.borrow_mut().set_heat_target(heater, celsius);
    }

    fn status(&self, heater: Heater) -> HeaterStatus {
        self.desk.borrow().heat.status(heater)
    }

    fn all_off(&mut self) {
        self.desk.borrow_mut().all_heat_off();
    }

    fn restart(&mut self) -> Result<(), HeatFault> {
        self.desk.borrow_mut().restart_heat()
    }
}
