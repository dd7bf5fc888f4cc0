//! The machine, as commands share it with the planner task.

use core::future::Future;

use ferrostep_gcode::MotionFigures;
use ferrostep_hal_shim::{FanOutput, HomingSensors, MotionWatch, ServoPulses, StepOutput};
use ferrostep_planner::backlash::Backlash;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::surface::{Mesh, MeshError};
use ferrostep_planner::{
    ChoiceError, Limits, MotionChoice, MotionMethods, Move, MoveError, Moved, PressureAdvance, Request, StepsPerMm,
};

use crate::motion::fault::{HomingOutcome, MotionError, MotionFault};
use crate::motion::machine::{Machine, Silence};
use crate::part::Part;
use crate::ports::Motion;

/// Sharing of a board's machine between the task that executes commands and the planner task.
pub trait SharedMachine {
    /// Memory of the look-ahead ring.
    type Ring: AsRef<[Slot]> + AsMut<[Slot]>;
    /// The step queue.
    type Queue: StepOutput;
    /// The methods of motion that the board's image contains.
    type Methods: MotionMethods;
    /// [`crate::Present`] if a servo may move the probe's pin.
    type Servo: Part;
    /// [`crate::Present`] if Z may have several motors that are aligned.
    type ZMotors: Part;
    /// [`crate::Present`] if there may be several tools.
    type Tools: Part;
    /// [`crate::Present`] if the drives may have play that is taken up.
    type Backlash: Part;
    /// [`crate::Present`] if a signal may report a failing supply.
    type SupplySignal: Part;

    /// Calls `act` with the machine locked.
    fn with<T>(&self, act: impl FnOnce(&mut Machine<Self::Ring, Self::Queue, Self::Methods>) -> T) -> T;

    /// Wakes the planner task. It runs before the commands' task continues, which then
    /// sees its effects.
    fn wake_planner(&self);

    /// Does the planner task's work at once.
    fn work(&self) {
        self.with(|machine| machine.work(Silence::default()));
    }

    /// Returns true if M112 has stopped everything.
    fn is_halted(&self) -> bool;

    /// Advances time a little before a command that waits for motion looks again.
    fn pause(&self) -> impl Future<Output = ()>;
}

/// Planner and motors of a board.
#[derive(Debug)]
pub struct SharedMotion<S> {
    machine: S,
    /// Number of stops of motion when the present command began.
    stops: u32,
}

impl<S: SharedMachine> SharedMotion<S> {
    /// Motion of a shared machine.
    pub fn new(machine: S) -> Self {
        let stops = machine.with(|machine| machine.stops());
        Self { machine, stops }
    }

    /// Tries until it succeeds, then wakes the planner task. Any stop since the command began ends
    /// the wait, even one that came before the wait, between two of the command's steps.
    async fn wait<T>(
        &self,
        mut attempt: impl FnMut(&mut Machine<S::Ring, S::Queue, S::Methods>) -> Option<T>,
    ) -> Result<T, MotionError> {
        let stops = self.stops;
        loop {
            if self.machine.is_halted() {
                return Err(MotionError::Stopped);
            }
            // Both under one lock: a stop between them would already be over, and the move would
            // run on a halted machine.
            let outcome = self.machine.with(|machine| {
                if machine.stops() == stops {
                    return attempt(machine).map(Ok);
                }
                Some(Err(machine.take_fault().map_or(MotionError::Stopped, MotionError::Fault)))
            });
            match outcome {
                Some(Ok(value)) => {
                    self.machine.wake_planner();
                    return Ok(value);
                }
                Some(Err(stopped)) => return Err(stopped),
                None => {}
            }
            self.machine.pause().await;
        }
    }
}

/// The outcome for a move; `None` if the move has to wait for room.
fn unless_full<T>(outcome: Result<T, MoveError>) -> Option<Result<T, MotionError>> {
    match outcome {
        Err(MoveError::NoRoom) => None,
        outcome => Some(outcome.map_err(MotionError::Move)),
    }
}

impl<S: SharedMachine> Motion for SharedMotion<S> {
    const FOLLOWS_FILAMENT: bool = <S::Queue as MotionWatch>::FOLLOWS_FILAMENT;
    const HAS_FILAMENT_SWITCH: bool = <S::Queue as MotionWatch>::HAS_FILAMENT_SWITCH;

    fn begin_command(&mut self) -> bool {
        let stops = self.stops();
        core::mem::replace(&mut self.stops, stops) != stops
    }

    fn stops(&self) -> u32 {
        self.machine.with(|machine| machine.stops())
    }

    async fn add(&mut self, request: impl Request) -> Result<Moved, MotionError> {
        self.wait(|machine| unless_full(machine.add(&request))).await?
    }

    async fn wait_for_room_in_time(&mut self) -> Result<(), MotionError> {
        self.wait(|machine| (!machine.holds_enough()).then_some(())).await
    }

    fn try_add(&mut self, request: &impl Request) -> Option<Result<Moved, MotionError>> {
        let moved = self.machine.with(|machine| {
            // M112 before this check is handled here; after it, the stop waits for the machine and
            // drops the motion.
            if self.machine.is_halted() {
                return Some(Err(MotionError::Stopped));
            }
            unless_full(machine.add(request))
        })?;
        self.machine.wake_planner();
        Some(moved)
    }

    fn set_bounded_in_time(&mut self, is_bounded: bool) {
        self.machine.with(|machine| machine.set_bounded_in_time(is_bounded));
    }

    async fn set_fan_power(&mut self, fan: FanOutput, power: u8) -> Result<(), MotionError> {
        self.wait(|machine| machine.add_fan_power(fan, power).then_some(())).await
    }

    async fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> Result<bool, MotionError> {
        self.wait(|machine| unless_full(machine.set_pressure_advance(advance))).await?
    }

    fn watch_line(&mut self, line: u32) {
        self.machine.with(|machine| machine.watch_line(line));
    }

    fn has_passed_line(&self) -> bool {
        self.machine.with(|machine| machine.has_passed_line())
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.machine.with(|machine| machine.flush());
        self.machine.wake_planner();
        let fault = self.wait(|machine| machine.is_idle().then(|| machine.take_plan_fault())).await?;
        fault.map_or(Ok(()), |fault| Err(MotionError::Move(MoveError::Plan(fault))))
    }

    fn begin_homing(&mut self) {
        self.machine.with(|machine| machine.begin_homing());
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        self.finish().await?;
        if self.add(request).await? == Moved::Nothing {
            return Ok(HomingOutcome::Missed);
        }
        self.machine.with(|machine| machine.begin_seek(axis));
        self.machine.wake_planner();
        self.wait(|machine| machine.take_homing_result()).await?
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.machine.with(|machine| machine.position_10nm())
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.machine.with(|machine| machine.set_position(position_10nm));
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.machine.with(|machine| machine.made_steps())
    }

    fn figures(&self) -> MotionFigures {
        self.machine.with(|machine| machine.figures())
    }

    fn limits(&self) -> Limits {
        self.machine.with(|machine| machine.limits())
    }

    fn set_limits(&mut self, limits: Limits) {
        self.machine.with(|machine| machine.set_limits(limits));
    }

    fn motion_choice(&self) -> MotionChoice {
        self.machine.with(|machine| machine.motion_choice())
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        self.machine.with(|machine| machine.set_motion_choice(choice))
    }

    fn extruder_steps_per_mm(&self) -> StepsPerMm {
        self.machine.with(|machine| machine.extruder_steps_per_mm())
    }

    fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        self.machine.with(|machine| machine.set_extruder_steps_per_mm(steps_per_mm))
    }

    type Bed = <S::Methods as MotionMethods>::Bed;

    fn mesh<T>(&mut self, act: impl FnOnce(&mut Mesh) -> T) -> Option<T> {
        self.machine.with(|machine| machine.mesh().map(act))
    }

    fn follow_bed(&mut self, on: bool) -> Result<(), MeshError> {
        self.machine.with(|machine| machine.follow_bed(on))
    }

    type Servo = S::Servo;

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        self.machine.with(|machine| machine.queue_mut().send_servo_pulses(pulses));
    }

    async fn servo_pulses_sent(&mut self) -> Result<(), MotionError> {
        self.wait(|machine| machine.queue().are_servo_pulses_sent().then_some(())).await
    }

    type ZMotors = S::ZMotors;
    type SupplySignal = S::SupplySignal;

    fn step_z_motors(&mut self, motors: u8) {
        self.machine.with(|machine| machine.step_z_motors(motors));
    }

    type Tools = S::Tools;
    type Backlash = S::Backlash;

    fn backlash(&self) -> Backlash {
        self.machine.with(|machine| machine.backlash())
    }

    fn set_backlash(&mut self, backlash: &Backlash) {
        self.machine.with(|machine| machine.set_backlash(backlash));
    }

    fn step_extruder(&mut self, tool: u8, offset_10nm: [i32; 2]) {
        self.machine.with(|machine| machine.step_extruder(tool, offset_10nm));
    }

    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        self.machine.with(|machine| machine.set_motors_enabled(axes, enabled));
    }

    fn take_switched_off(&mut self) -> bool {
        self.machine.with(|machine| machine.take_switched_off())
    }

    fn take_fault(&mut self) -> Option<MotionFault> {
        self.machine.with(|machine| machine.take_fault())
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.machine.with(|machine| machine.is_end_stop_triggered(axis))
    }

    fn stop(&mut self) -> i64 {
        self.machine.with(|machine| machine.request_stop());
        self.machine.work();
        // The command's own stop does not end its later waits.
        self.begin_command();
        self.take_dropped_100pm()
    }

    fn take_dropped_100pm(&mut self) -> i64 {
        self.machine.with(|machine| machine.take_dropped_100pm())
    }
}
