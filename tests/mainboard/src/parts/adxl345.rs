//! The accelerometer ADXL345 on four wires (SPI), by edges.
//!
//! From the ADXL345 data sheet, revision G (Analog Devices): *Serial communications*, *Register
//! map*, *FIFO*, *Specifications*, figures of *SPI*.
//!
//! | covered | |
//! |---|---|
//! | SPI of four wires, mode 3: read, write, several registers in a frame; the output floats while it is not selected | `bus` |
//! | DEVID, BW_RATE (25 to 3200 Hz), POWER_CTL (measure), DATA_FORMAT (range, full resolution), INT_SOURCE, DATAX0 to DATAZ1, FIFO_CTL (bypass, FIFO, stream), FIFO_STATUS | |
//! | 33 samples wait; the overrun mark is set when the memory is filled and cleared by reading | |
//! | at 1600 and 3200 Hz the lowest bit is 0; noise; an oscillator that is off | |
//! | violations of the bus's times, and of the 5 us between samples, are counted ([`Violations`]) | |
//!
//! Left out: SPI of three wires, I2C, interrupt pins, taps, activity, offsets, self-test, low
//! power, the trigger mode, left justification, and the filter before the converter, whose
//! bandwidth is half of the rate.

mod bus;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::random::Random;
use bus::Bus;
pub use bus::Violations;

/// Registers by their names.
const DEVID: usize = 0x00;
const BW_RATE: usize = 0x2c;
const POWER_CTL: usize = 0x2d;
const INT_SOURCE: usize = 0x30;
const DATA_FORMAT: usize = 0x31;
const DATAX0: usize = 0x32;
const DATAZ1: usize = 0x37;
const FIFO_CTL: usize = 0x38;
const FIFO_STATUS: usize = 0x39;
const REGISTERS: usize = 0x3a;

/// The memory, and one sample more in the output filter.
const FILLED: usize = 32;
const CAPACITY: usize = 33;
/// Time from standby to measuring, besides a period.
const WAKE_UP_NS: f64 = 1.1e6;

/// Properties that differ from chip to chip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Value of DEVID: 0xe5.
    pub identity: u8,
    /// Excess of its oscillator's rate over the nominal one, as a share.
    pub fast: f64,
    /// Noise, as the standard deviation: about one and a half units of 3.9 mg at 100 Hz, in g.
    pub noise_g: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self { identity: 0xe5, fast: 0.0, noise_g: 0.006, seed: 1 }
    }
}

/// The chip.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Adxl345 {
    config: Config,
    registers: Vec<u8>,
    memory: VecDeque<[i16; 3]>,
    newest: [i16; 3],
    overrun: bool,
    /// Since when it measures, and how many samples it has taken since.
    measures_since_ns: Option<u64>,
    sampled: u64,
    random: Random,
    plugged: bool,
    bus: Bus,
}

impl Adxl345 {
    /// A chip after power-on.
    pub fn new(config: Config) -> Self {
        let mut registers = vec![0; REGISTERS];
        registers[DEVID] = config.identity;
        registers[BW_RATE] = 0x0a;
        Self {
            random: Random::new(config.seed),
            config,
            registers,
            memory: VecDeque::new(),
            newest: [0; 3],
            overrun: false,
            measures_since_ns: None,
            sampled: 0,
            plugged: true,
            bus: Bus::default(),
        }
    }

    /// Unplugs it, with all of its wires, or plugs it in again: then it has been without supply.
    pub fn set_plugged(&mut self, plugged: bool) {
        if plugged && !self.plugged {
            *self = Self::new(self.config);
        }
        self.plugged = plugged;
    }

    /// The level of the chip's output; `None` while it floats.
    #[must_use]
    pub fn output(&self) -> Option<bool> {
        if self.plugged { self.bus.output() } else { None }
    }

    /// Accesses of the bus that the data sheet forbids.
    #[must_use]
    pub fn violations(&self) -> Violations {
        self.bus.violations()
    }

    /// Samples a second.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        let code = i32::from(self.registers[BW_RATE] & 0x0f);
        3200.0 * 2f64.powi(code - 15) * (1.0 + self.config.fast)
    }

    /// Instant of the next sample, ns; `None` at rest.
    #[must_use]
    pub fn next_sample_ns(&self) -> Option<u64> {
        let since_ns = self.measures_since_ns?;
        let periods = (self.sampled + 1) as f64;
        Some(since_ns + (WAKE_UP_NS + periods * 1e9 / self.rate_hz()) as u64)
    }

    /// Takes the sample that is due: accelerations along the chip's axes, g.
    pub fn sample(&mut self, acceleration_g: [f64; 3]) {
        self.sampled += 1;
        let format = self.registers[DATA_FORMAT];
        let range = f64::from(2 << (format & 0b11));
        // Full resolution: 256 units a g in any range; otherwise 1024 units for the range.
        let unit_g = if format & 1 << 3 != 0 { 1.0 / 256.0 } else { range / 512.0 };
        let most = range / unit_g;
        let is_fast = self.registers[BW_RATE] & 0x0f >= 0b1110;
        let noise_g = self.config.noise_g;
        let sample = acceleration_g.map(|g| {
            let units = ((g + noise_g * self.random.normal()) / unit_g).round().clamp(-most, most - 1.0) as i16;
            if is_fast { units & !1 } else { units }
        });
        self.newest = sample;
        match self.registers[FIFO_CTL] >> 6 {
            0b00 => {
                self.overrun |= !self.memory.is_empty();
                self.memory = VecDeque::from([sample]);
            }
            0b01 if self.memory.len() >= CAPACITY => {}
            _ => {
                if self.memory.len() >= CAPACITY {
                    self.memory.pop_front();
                }
                self.memory.push_back(sample);
                self.overrun |= self.memory.len() >= FILLED;
            }
        }
    }

    /// The select line: low while the chip is asked.
    pub fn set_select(&mut self, now_ns: u64, high: bool) {
        if self.bus.set_select(now_ns, high) {
            // The end of a read of the data.
            self.memory.pop_front();
            self.overrun = false;
        }
    }

    /// The clock line.
    pub fn set_clock(&mut self, now_ns: u64, high: bool) {
        let Some(byte) = self.bus.set_clock(now_ns, high) else { return };
        match byte {
            bus::Byte::Read(register) => {
                let value = self.read(register);
                self.bus.answer(now_ns, register, value);
            }
            bus::Byte::Written(register, value) => self.write(now_ns, register, value),
        }
    }

    /// The data line to the chip.
    pub fn set_data(&mut self, high: bool) {
        self.bus.set_data(high);
    }

    fn read(&self, register: u8) -> u8 {
        let register = usize::from(register);
        match register {
            INT_SOURCE => {
                let watermark = self.memory.len() >= usize::from(self.registers[FIFO_CTL] & 0x1f);
                u8::from(!self.memory.is_empty()) << 7 | u8::from(watermark) << 1 | u8::from(self.overrun)
            }
            DATAX0..=DATAZ1 => {
                let oldest = self.memory.front().copied().unwrap_or(self.newest);
                oldest[(register - DATAX0) / 2].to_le_bytes()[register % 2]
            }
            FIFO_STATUS => self.memory.len() as u8,
            _ => self.registers.get(register).copied().unwrap_or(0),
        }
    }

    fn write(&mut self, now_ns: u64, register: u8, value: u8) {
        let register = usize::from(register);
        // DEVID, reserved registers, and those that only the chip writes.
        if !(0x1d..REGISTERS).contains(&register)
            || matches!(register, 0x2b | INT_SOURCE | DATAX0..=DATAZ1 | FIFO_STATUS)
        {
            return;
        }
        self.registers[register] = value;
        match register {
            FIFO_CTL if value >> 6 == 0 => {
                self.memory.clear();
                self.overrun = false;
            }
            POWER_CTL | BW_RATE => {
                let measures = self.registers[POWER_CTL] & 1 << 3 != 0;
                self.measures_since_ns = measures.then_some(now_ns);
                self.sampled = 0;
            }
            _ => {}
        }
    }
}
