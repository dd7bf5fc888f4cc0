//! Several motors of Z, some of which may move alone, and several extruders, one of which moves.

use ferrostep_hal_shim::StepOutput;
use ferrostep_planner::MotionMethods;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::surface::Bed as _;

use super::Machine;

impl<R: AsRef<[Slot]> + AsMut<[Slot]>, Q: StepOutput, M: MotionMethods> Machine<R, Q, M> {
    /// Selects the motors of Z that make the next steps
    /// ([`ferrostep_hal_shim::MotorEnable::step_z_motors`]). Only at standstill: otherwise motion
    /// was stopped, and all of them will take part.
    pub fn step_z_motors(&mut self, motors: u8) {
        if self.is_idle() {
            self.feeder.queue.step_z_motors(motors);
        }
    }

    /// The extruder of this tool makes the steps to come
    /// ([`ferrostep_hal_shim::MotorEnable::step_extruder`]). At standstill. Its nozzle is this
    /// far from the first's, X and Y in units of 10 nm: a bed that Z follows from then on is
    /// the one below it.
    pub fn step_extruder(&mut self, tool: u8, offset_10nm: [i32; 2]) {
        self.feeder.queue.step_extruder(tool);
        self.feeder.bed.set_nozzle_offset(offset_10nm);
    }
}
