//! The motion of a plan by another firmware's rules, as the printer's commands see it.

use ferrostep_gcode::{Command, MotionFigures};
use ferrostep_hal_shim::{FanOutput, ServoPulses};
use ferrostep_planner::surface::{BedStage, Mesh, MeshError};
use ferrostep_planner::{ChoiceError, Limits, MotionChoice, Move, Moved, PressureAdvance, Request, StepsPerMm};
use ferrostep_printer::{HomingOutcome, Motion, MotionError, Present, Signals};

use super::reader::RulesReader;
use crate::desk::{LEAP_TICKS, PlannedMotion, let_time_pass};

/// Mask of all motors.
const ALL_MOTORS: u8 = 0b1111;

/// Motion by another firmware's rules; homing, and what only sets a state, is that
/// of this firmware.
pub struct RulesMotion<'a> {
    reader: &'a RulesReader,
    own: PlannedMotion<'a>,
    signals: &'a Signals,
}

impl<'a> RulesMotion<'a> {
    /// The motion of a reader.
    pub(super) const fn new(reader: &'a RulesReader, own: PlannedMotion<'a>, signals: &'a Signals) -> Self {
        Self { reader, own, signals }
    }

    /// Advances time if this much motion was planned since the last time.
    async fn pass(&self, leap_ticks: u64) -> Result<(), MotionError> {
        if self.reader.waiting_ticks() >= leap_ticks {
            let_time_pass().await;
        }
        if self.signals.is_halted() { Err(MotionError::Stopped) } else { Ok(()) }
    }
}

impl Motion for RulesMotion<'_> {
    async fn add(&mut self, request: impl Request) -> Result<Moved, MotionError> {
        let own_move = if self.reader.is_homing() { None } else { request.as_move() };
        let Some(one) = own_move else { return self.own.add(request).await };
        if self.signals.is_halted() {
            return Err(MotionError::Stopped);
        }
        self.reader.add(&one, &self.own)?;
        self.own.set_motors_enabled(ALL_MOTORS, true);
        self.pass(LEAP_TICKS).await?;
        Ok(Moved::Queued)
    }

    fn see(&mut self, command: &Command<'_>, unit_mm: f64) {
        self.reader.with_plan(|plan| plan.see(command, unit_mm));
    }

    fn begin_arc(&mut self, centre_mm: [f64; 2], is_clockwise: bool) {
        let start_10nm = self.position_10nm();
        self.reader.with_plan(|plan| plan.begin_arc(start_10nm, centre_mm, is_clockwise));
    }

    async fn set_fan_power(&mut self, fan: FanOutput, power: u8) -> Result<(), MotionError> {
        self.own.set_fan_power(fan, power).await
    }

    async fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> Result<bool, MotionError> {
        self.own.set_pressure_advance(advance).await
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.reader.come_to_rest();
        self.pass(1).await?;
        self.own.finish().await
    }

    fn begin_homing(&mut self) {
        self.reader.come_to_rest();
        self.reader.set_homing(true);
        self.own.begin_homing();
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        self.finish().await?;
        self.reader.set_homing(true);
        self.own.seek(request, axis).await
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.reader.position_10nm(&self.own)
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.reader.come_to_rest();
        self.reader.set_homing(false);
        self.own.set_position(position_10nm);
        self.reader.stands(position_10nm);
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.own.motor_steps()
    }

    fn figures(&self) -> MotionFigures {
        Motion::figures(&self.own)
    }

    fn limits(&self) -> Limits {
        self.own.limits()
    }

    fn set_limits(&mut self, limits: Limits) {
        self.own.set_limits(limits);
    }

    fn motion_choice(&self) -> MotionChoice {
        self.own.motion_choice()
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        self.own.set_motion_choice(choice)
    }

    fn extruder_steps_per_mm(&self) -> StepsPerMm {
        self.own.extruder_steps_per_mm()
    }

    fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        self.own.set_extruder_steps_per_mm(steps_per_mm)
    }

    type Servo = Present;
    type ZMotors = Present;
    type Tools = Present;
    type Backlash = Present;
    type SupplySignal = Present;

    fn step_z_motors(&mut self, motors: u8) {
        self.own.step_z_motors(motors);
    }

    fn step_extruder(&mut self, tool: u8, offset_10nm: [i32; 2]) {
        self.own.step_extruder(tool, offset_10nm);
    }

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        self.own.send_servo_pulses(pulses);
    }

    type Bed = BedStage;

    fn mesh<T>(&mut self, act: impl FnOnce(&mut Mesh) -> T) -> Option<T> {
        self.own.mesh(act)
    }

    fn follow_bed(&mut self, on: bool) -> Result<(), MeshError> {
        self.own.follow_bed(on)
    }

    fn set_motors_enabled(&mut self, motors: u8, enabled: bool) {
        self.own.set_motors_enabled(motors, enabled);
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.own.is_end_stop_triggered(axis)
    }

    fn stop(&mut self) -> i64 {
        self.reader.come_to_rest();
        self.own.stop()
    }
}
