//! Several motors of Z, of which some move alone.

use ferrostep_hal_shim::StepOutput;
use ferrostep_planner::MotionMethods;
use ferrostep_planner::look_ahead::Slot;

use super::Machine;

impl<R: AsRef<[Slot]> + AsMut<[Slot]>, Q: StepOutput, M: MotionMethods> Machine<R, Q, M> {
    /// Of Z's motors those in the mask make the steps to come ([`ferrostep_hal_shim::MotorEnable::step_z_motors`]). Only at standstill:
    /// otherwise motion was stopped, and all of them will take part.
    pub fn step_z_motors(&mut self, motors: u8) {
        if self.is_idle() {
            self.feeder.queue.step_z_motors(motors);
        }
    }
}
