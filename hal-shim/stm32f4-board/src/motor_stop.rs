//! Immediate stop of all motors.

use ferrostep_step_player::StepLink;

use crate::pac::TIM2;

/// Stops all motors before the next instruction; the planner task does the rest. For any task but
/// the step interrupt.
pub fn stop(link: &StepLink) {
    halt();
    link.request_stop();
}

/// Stops all motors as [`stop`] does, for the sensor of a homing axis.
pub(crate) fn stop_at_sensor(link: &StepLink) {
    halt();
    link.request_sensor_stop();
}

fn halt() {
    // SAFETY: a store to a register that only the step interrupt writes besides.
    unsafe { &*TIM2::ptr() }.dier().write(|w| w.uie().clear_bit());
    // An update that came before the store is played before the next instruction.
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}
