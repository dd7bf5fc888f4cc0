//! A board whose motors are real, or virtual, and whose sensors are models.

use ferrostep_planner::{Move, StepDigests, StepEntry, StepObserver};

use super::VirtualMotors;
use ferrostep_hal_shim::{Approach, HomingSensors, MotionWatch, MotorEnable, PlanningClock, ServoPulses, StepQueue};
use ferrostep_step_player::{DroppedSteps, FeedError, StepLink};

/// A step queue with modelled sensors. Virtual motors make all steps of the queue as they are
/// added, and tell where a sensor triggers.
#[derive(Debug)]
pub struct ModelledSensors<Q> {
    queue: Q,
    motors: VirtualMotors,
    watched: Option<usize>,
}

impl<Q> ModelledSensors<Q> {
    /// Sensors of `motors` beside an empty queue.
    pub fn new(queue: Q, motors: VirtualMotors) -> Self {
        Self { queue, motors, watched: None }
    }
}

impl<Q: StepQueue> StepQueue for ModelledSensors<Q> {
    fn queued(&self) -> u32 {
        self.queue.queued()
    }

    fn played(&self) -> u32 {
        self.queue.played()
    }

    fn waiting(&self) -> usize {
        self.queue.waiting()
    }

    fn room(&self) -> usize {
        self.queue.room()
    }

    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.queue.push(entry)?;
        self.motors.ledger.play(entry, &mut ());
        Ok(())
    }

    fn seal(&mut self) {
        self.queue.seal();
    }

    fn start(&mut self) {
        self.queue.start();
    }

    fn link(&self) -> &StepLink {
        self.queue.link()
    }

    fn unplayed_steps(&self) -> [i32; 4] {
        self.queue.unplayed_steps()
    }

    fn request_stop(&mut self) {
        self.queue.request_stop();
    }

    fn drop_all(&mut self) -> DroppedSteps {
        let dropped = self.queue.drop_all();
        self.motors.ledger.take_back(dropped.signed, dropped.issued);
        dropped
    }

    fn take_missed_updates(&mut self) -> u32 {
        self.queue.take_missed_updates()
    }
}

impl<Q: StepQueue> HomingSensors for ModelledSensors<Q> {
    fn is_sensor_triggered(&self, axis: usize) -> bool {
        self.motors.is_triggered(axis)
    }

    fn watch_sensor(&mut self, axis: Option<usize>) {
        self.watched = axis;
    }

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        self.motors.tell_pin(pulses.width_us);
    }

    fn push_towards_sensor(&mut self, entry: StepEntry) -> Result<Approach, FeedError> {
        let Some(axis) = self.watched else {
            self.push(entry)?;
            return Ok(Approach { added: Some(entry), triggered: false });
        };
        let approach = self.motors.play_until_triggered(entry, axis, &mut ());
        if let Some(added) = approach.added {
            self.queue.push(added)?;
        }
        Ok(approach)
    }
}

impl<Q: StepObserver> StepObserver for ModelledSensors<Q> {
    #[inline]
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.queue.stepped(tick, axes, directions);
    }
}

impl<Q: MotionWatch> MotionWatch for ModelledSensors<Q> {
    const FOLLOWS_FILAMENT: bool = Q::FOLLOWS_FILAMENT;
    const HAS_FILAMENT_SWITCH: bool = Q::HAS_FILAMENT_SWITCH;

    fn digests(&self) -> StepDigests {
        self.queue.digests()
    }

    fn move_taken(&mut self, taken: &Move, slowed_moves: u64) {
        self.queue.move_taken(taken, slowed_moves);
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        self.queue.move_ended(tick, line);
    }

    fn stands_at(&mut self, tick: u64) {
        self.queue.stands_at(tick);
    }

    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.queue.redefined(tick, motor_steps);
    }
}

impl<Q: PlanningClock> PlanningClock for ModelledSensors<Q> {
    fn now_ticks(&self) -> Option<u32> {
        self.queue.now_ticks()
    }

    fn planning_begins(&mut self) {
        self.queue.planning_begins();
    }

    fn planning_ends(&mut self) {
        self.queue.planning_ends();
    }
}

impl<Q: MotorEnable> MotorEnable for ModelledSensors<Q> {
    fn set_motors_enabled(&mut self, motors: u8, enabled: bool) {
        self.queue.set_motors_enabled(motors, enabled);
    }

    fn step_z_motors(&mut self, motors: u8) {
        self.queue.step_z_motors(motors);
    }

    fn step_extruder(&mut self, tool: u8) {
        self.queue.step_extruder(tool);
    }
}
