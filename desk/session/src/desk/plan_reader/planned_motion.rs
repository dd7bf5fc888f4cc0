//! The motion of a plan that is only read, as the printer's commands see it.

use ferrostep_gcode::MotionFigures;
use ferrostep_hal_shim::{FanOutput, ServoPulses};
use ferrostep_planner::surface::{Bed, BedStage, Mesh, MeshError};
use ferrostep_planner::{
    ChoiceError, Limits, MotionChoice, Move, MoveError, Moved, PressureAdvance, Request, StepDigests, StepsPerMm,
    TICKS_PER_SECOND,
};
use ferrostep_printer::{HomingOutcome, Motion, MotionError, Signals};

use super::{Figures, MotionState, Plan, PlanReader, Reading};
use crate::desk::session_motion::let_time_pass;

/// Motion that is planned before the desk lets time pass.
pub(crate) const LEAP_TICKS: u64 = TICKS_PER_SECOND as u64 / 10;

/// The motion of a plan, as the printer's commands see it.
pub struct PlannedMotion<'a> {
    pub(super) reader: &'a PlanReader,
    pub(super) signals: &'a Signals,
}

impl PlannedMotion<'_> {
    /// Acts on the plan. Afterwards, if `leap_ticks` of motion have been planned since the last
    /// time, the desk lets time pass.
    async fn act<T>(
        &self,
        leap_ticks: u64,
        act: impl FnOnce(&mut Plan) -> Result<T, MotionError>,
    ) -> Result<T, MotionError> {
        if self.signals.is_halted() {
            return Err(MotionError::Stopped);
        }
        let outcome = act(&mut self.reader.plan.borrow_mut());
        if self.reader.tick() - self.reader.passed_tick.get() < leap_ticks {
            return outcome;
        }
        let_time_pass().await;
        if self.signals.is_halted() { Err(MotionError::Stopped) } else { outcome }
    }
}

impl Motion for PlannedMotion<'_> {
    async fn add(&mut self, request: impl Request) -> Result<Moved, MotionError> {
        self.act(LEAP_TICKS, |plan| plan.add(&request)).await
    }

    async fn set_fan_power(&mut self, fan: FanOutput, power: u8) -> Result<(), MotionError> {
        self.act(LEAP_TICKS, |plan| {
            if plan.planner.is_look_ahead_empty() {
                plan.fan_powers[fan.index()] = power;
            } else {
                while !plan.planner.add_fan_power(fan as u8, power) && plan.makes_room() {}
            }
            Ok(())
        })
        .await
    }

    async fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> Result<bool, MotionError> {
        self.act(LEAP_TICKS, |plan| {
            loop {
                match plan.planner.set_pressure_advance(advance) {
                    Err(MoveError::NoRoom) if plan.makes_room() => {}
                    outcome => return outcome.map_err(MotionError::Move),
                }
            }
        })
        .await
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.act(1, |plan| {
            plan.read_all();
            let fault = plan.planner.take_plan_fault();
            fault.map_or(Ok(()), |fault| Err(MotionError::Move(MoveError::Plan(fault))))
        })
        .await
    }

    fn begin_homing(&mut self) {
        let plan = &mut *self.reader.plan.borrow_mut();
        plan.homing_time.begin(plan.planner.motion_ticks());
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        self.finish().await?;
        let signal = self.reader.drivers.stall_signal(axis);
        self.act(1, |plan| {
            plan.reading.motors.set_stall_signal(signal);
            plan.seek(&request, axis)
        })
        .await
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.reader.plan.borrow().planner.position_10nm()
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        let plan = &mut *self.reader.plan.borrow_mut();
        let motors = plan.planner.set_position(position_10nm);
        plan.reading.ledger.redefine_motor_steps(motors.map(i64::from));
        plan.homing_time.end(plan.planner.motion_ticks());
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.reader.plan.borrow().reading.ledger.motor_steps()
    }

    fn figures(&self) -> MotionFigures {
        let Figures { motor_steps, starvation_flushes, slowed_moves, merged_moves, digests, .. } =
            self.reader.figures();
        let StepDigests { order, step } = digests;
        MotionFigures {
            order_digest: order,
            step_digest: step,
            issued_steps: motor_steps,
            starvation_flushes,
            slowed_moves,
            merged_moves,
            ..MotionFigures::default()
        }
    }

    fn limits(&self) -> Limits {
        self.reader.factors.inverse().of(*self.reader.plan.borrow().planner.limits())
    }

    fn set_limits(&mut self, limits: Limits) {
        self.reader.plan.borrow_mut().planner.set_limits(self.reader.factors.of(limits));
    }

    fn motion_choice(&self) -> MotionChoice {
        *self.reader.plan.borrow().planner.motion_choice()
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        self.reader.plan.borrow_mut().planner.set_motion_choice(choice)
    }

    fn extruder_steps_per_mm(&self) -> StepsPerMm {
        self.reader.plan.borrow().planner.extruder_steps_per_mm()
    }

    fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        self.reader.plan.borrow_mut().planner.set_extruder_steps_per_mm(steps_per_mm)
    }

    type Servo = ferrostep_printer::Present;
    type ZMotors = ferrostep_printer::Present;
    type Tools = ferrostep_printer::Present;
    type Backlash = ferrostep_printer::Present;
    type SupplySignal = ferrostep_printer::Present;

    fn step_z_motors(&mut self, motors: u8) {
        let Reading { motors: virtual_motors, z_motors, .. } = &mut self.reader.plan.borrow_mut().reading;
        if let Some(z_motors) = z_motors {
            z_motors.step(motors, virtual_motors);
        }
    }

    fn step_extruder(&mut self, _tool: u8, offset_10nm: [i32; 2]) {
        self.reader.plan.borrow_mut().bed.set_nozzle_offset(offset_10nm);
    }

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        self.reader.plan.borrow_mut().reading.motors.tell_pin(pulses.width_us);
    }

    type Bed = BedStage;

    fn mesh<T>(&mut self, act: impl FnOnce(&mut Mesh) -> T) -> Option<T> {
        self.reader.plan.borrow_mut().bed.mesh().map(act)
    }

    /// Blocks keep to what Z needs, so that they last as long as on a machine whose Z follows the
    /// bed.
    fn follow_bed(&mut self, on: bool) -> Result<(), MeshError> {
        let plan = &mut *self.reader.plan.borrow_mut();
        let switched = plan.bed.switch(on);
        plan.planner.set_surface(switched.ok().filter(|_| on));
        switched.map(|_| ())
    }

    fn set_motors_enabled(&mut self, motors: u8, enabled: bool) {
        let mask = &mut self.reader.plan.borrow_mut().enabled_motors;
        *mask = if enabled { *mask | motors } else { *mask & !motors };
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.reader.plan.borrow().reading.motors.is_triggered(axis)
    }

    fn stop(&mut self) -> i64 {
        self.reader.stop();
        0
    }
}
