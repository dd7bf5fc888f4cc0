//! The fans' tachometers: inputs whose pulses are counted by looking often enough.
//!
//! A tachometer is an open collector that pulls its line to ground and lets it go, twice a turn.
//! Looked at every millisecond, pulses are counted up to 15,000 turns a minute.

use core::sync::atomic::{AtomicU16, Ordering};

use ferrostep_hal_shim::FanOutput;

use crate::heaters::FanPins;
use crate::registers::Registers;
use crate::sensor_lines::SensorPin;

/// Pulses so far, modulo 2^16, by output.
pub type PulseCounts = [AtomicU16; FanOutput::COUNT];

/// The inputs.
#[derive(Clone, Copy, Debug)]
pub struct Tachometers {
    pins: [Option<SensorPin>; FanOutput::COUNT],
    was_low: [bool; FanOutput::COUNT],
}

impl Tachometers {
    /// Makes the pins inputs with pull-ups.
    pub fn start(fans: &[Option<FanPins>; FanOutput::COUNT], registers: &mut impl Registers) -> Self {
        let pin = |(port, number)| SensorPin { port, number, triggers_low: true };
        let pins = fans.map(|fan| fan.and_then(|fan| fan.tachometer).map(pin));
        pins.into_iter().flatten().for_each(|pin| pin.set_up(registers));
        Self { pins, was_low: [false; FanOutput::COUNT] }
    }

    /// Looks at every line, and counts those that have become low. To be called every millisecond.
    pub fn look(&mut self, counts: &PulseCounts, registers: &mut impl Registers) {
        for ((pin, was_low), count) in self.pins.iter().zip(&mut self.was_low).zip(counts) {
            let Some(pin) = pin else { continue };
            let is_low = pin.is_triggered(registers);
            if is_low && !*was_low {
                count.fetch_add(1, Ordering::Relaxed);
            }
            *was_low = is_low;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::pwm::OutputPin;
    use crate::registers::recorder::Recorder;

    /// PE10, as the part-cooling fan's of the MINI.
    const IDR: u32 = 0x4002_1010;

    #[test]
    fn a_pulse_is_counted_once() {
        let power = OutputPin { port: 4, number: 11, channel: None };
        let mut registers = Recorder::default();
        let fan = FanPins { power, tachometer: Some((4, 10)) };
        let mut tachometers = Tachometers::start(&[Some(fan), None, None, None, None, None], &mut registers);
        let counts = PulseCounts::default();
        let mut look = |is_high: bool| {
            let mut registers = Recorder::default().with(IDR, u32::from(is_high) << 10);
            tachometers.look(&counts, &mut registers);
            counts.each_ref().map(|count| count.load(Ordering::Relaxed))[0]
        };
        let seen = [true, false, false, true, true, false, true, false].map(&mut look);
        assert_eq!(seen, [0, 1, 1, 1, 1, 2, 2, 3]);
        // An input with a pull-up: a line that nothing pulls low gives no pulse.
        assert_eq!(registers.value(0x4002_100c) >> 20 & 0b11, 0b01);
        assert_eq!(registers.value(0x4002_1000) >> 20 & 0b11, 0b00);
    }
}
