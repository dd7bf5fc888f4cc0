//! The filament encoder, read by the planner task, which has the motor positions and runs every 2
//! ms.

use ferrostep_printer::{EncoderWatch, Signals};
use ferrostep_stm32f4_board::board::is_triggered;

use crate::ports::BoardMachine;
use crate::profile::PROFILE;
use crate::wiring::FILAMENT;

/// Reader of the filament encoder, on machines that have one.
pub struct Encoder(EncoderWatch);

impl Encoder {
    /// Creates the reader before any filament has moved.
    pub const fn new() -> Self {
        Self(EncoderWatch::new())
    }

    /// Reads the encoder after the planner task's work. The millisecond clock may wrap.
    pub fn look(&mut self, machine: &BoardMachine, now_ms: u32, signals: &Signals) {
        if let (Some(pin), Some(sensor)) = (FILAMENT, &PROFILE.filament_sensor)
            && sensor.detection_10nm().is_some()
        {
            let steps_per_mm = machine.extruder_steps_per_mm().to_f64() as f32;
            let pushed = machine.pushed_filament();
            self.0.look(now_ms, is_triggered(pin), pushed, steps_per_mm, sensor.debounce_ms, signals);
        }
    }
}
