//! The accelerometer ADXL345 over SPI: its identity, rate, resolution, and the
//! samples in its memory.
//!
//! Registers and bits are those of the ADXL345 data sheet, revision G: *Register map*, *Register
//! definitions*, *FIFO*. The bus is any [`SpiDevice`] of four wires in mode 3, which may be clocked
//! at 1.6 MHz at most: up to there a sample's address takes the 5 us that the memory needs from one
//! sample to the next (*Retrieving data from FIFO*).
#![cfg_attr(not(test), no_std)]

use embedded_hal::spi::SpiDevice;
use ferrostep_hal_shim::{AccelerometerChip, AccelerometerFault, AccelerometerType, WaitingSamples};

/// The type: its faster rates, and its two resolutions of +-16 g.
pub const TYPE: AccelerometerType = AccelerometerType {
    name: "ADXL345",
    rates_hz: &[25, 50, 100, 200, 400, 800, 1600, 3200],
    resolution_bits: &[10, 13],
};

/// Fastest clock at which samples may follow each other without a pause, Hz.
pub const MAX_CLOCK_HZ: u32 = 1_600_000;

/// Bits of a frame's first byte: the register is read (`READ`), and the registers after it
/// follow (`MANY`).
const READ: u8 = 0x80;
const MANY: u8 = 0x40;

/// DEVID and its value.
const DEVICE_ID: u8 = 0x00;
const IDENTITY: u8 = 0xe5;
/// BW_RATE: the code of 25 Hz, whose successors double it.
const BANDWIDTH_RATE: u8 = 0x2c;
const CODE_OF_25_HZ: u8 = 0b1000;
/// POWER_CTL: at rest, and measuring.
const POWER_CONTROL: u8 = 0x2d;
const STANDBY: u8 = 0;
const MEASURE: u8 = 1 << 3;
/// INT_SOURCE: the memory has been filled.
const INTERRUPT_SOURCE: u8 = 0x30;
const OVERRUN: u8 = 1;
/// DATA_FORMAT: +-16 g, and 256 units a g instead of 1024 units for the whole range.
const DATA_FORMAT: u8 = 0x31;
const RANGE_16_G: u8 = 0b11;
const FULL_RESOLUTION: u8 = 1 << 3;
/// DATAX0, the first of six.
const DATA: u8 = 0x32;
/// FIFO_CTL: no memory, which empties it, and the newest 32 samples.
const FIFO_CONTROL: u8 = 0x38;
const BYPASS: u8 = 0;
const STREAM: u8 = 0b10 << 6;
/// FIFO_STATUS: its bits with the number of samples. One more than 32 is possible: the output
/// filter may hold it.
const FIFO_STATUS: u8 = 0x39;
const ENTRIES: u8 = 0x3f;
const MAX_ENTRIES: u8 = 33;

/// Maximum number of bits of a sample that are 1024 units for the whole range.
const COARSE_BITS: u8 = 10;

/// The chip, all three axes to +-16 g.
#[derive(Debug)]
pub struct Adxl345<S> {
    spi: S,
    is_full: bool,
}

impl<S: SpiDevice> Adxl345<S> {
    /// A chip on a bus. Nothing is sent.
    pub const fn new(spi: S) -> Self {
        Self { spi, is_full: true }
    }

    fn read(&mut self, register: u8) -> Result<u8, AccelerometerFault> {
        let mut frame = [READ | register, 0];
        self.spi.transfer_in_place(&mut frame).map_err(|_| AccelerometerFault::Bus)?;
        let [_, value] = frame;
        Ok(value)
    }

    fn write(&mut self, register: u8, value: u8) -> Result<(), AccelerometerFault> {
        self.spi.write(&[register, value]).map_err(|_| AccelerometerFault::Bus)
    }
}

impl<S: SpiDevice> AccelerometerChip for Adxl345<S> {
    const TYPE: AccelerometerType = TYPE;

    fn check(&mut self) -> Result<(), AccelerometerFault> {
        match self.read(DEVICE_ID)? {
            IDENTITY => Ok(()),
            read => Err(AccelerometerFault::Identity { read, expected: IDENTITY }),
        }
    }

    fn begin(&mut self, rate_hz: u16, resolution_bits: u8) -> Result<(), AccelerometerFault> {
        self.check()?;
        let doublings = TYPE.rates_hz.iter().position(|known| *known >= rate_hz).unwrap_or(TYPE.rates_hz.len() - 1);
        self.is_full = resolution_bits > COARSE_BITS;
        // At rest, as the data sheet advises for a change of settings.
        let settings = [
            (BANDWIDTH_RATE, CODE_OF_25_HZ + doublings as u8),
            (DATA_FORMAT, if self.is_full { FULL_RESOLUTION | RANGE_16_G } else { RANGE_16_G }),
            (FIFO_CONTROL, STREAM),
        ];
        self.write(POWER_CONTROL, STANDBY)?;
        self.write(FIFO_CONTROL, BYPASS)?;
        for (register, value) in settings {
            self.write(register, value)?;
        }
        for (register, value) in settings {
            if self.read(register)? != value {
                return Err(AccelerometerFault::Settings);
            }
        }
        self.write(POWER_CONTROL, MEASURE)
    }

    fn end(&mut self) {
        // Without an answer the host has left.
        let _ = self.write(POWER_CONTROL, STANDBY);
    }

    fn waiting(&mut self) -> Result<WaitingSamples, AccelerometerFault> {
        // The count first: reading samples clears the mark, which must not come between the two.
        let status = self.read(FIFO_STATUS)?;
        let samples = status & ENTRIES;
        if samples > MAX_ENTRIES {
            return Err(AccelerometerFault::Count(samples));
        }
        Ok(WaitingSamples { samples, overflowed: self.read(INTERRUPT_SOURCE)? & OVERRUN != 0 })
    }

    fn take(&mut self) -> Result<[i32; 3], AccelerometerFault> {
        let mut frame = [READ | MANY | DATA, 0, 0, 0, 0, 0, 0];
        self.spi.transfer_in_place(&mut frame).map_err(|_| AccelerometerFault::Bus)?;
        let [_, x0, x1, y0, y1, z0, z1] = frame;
        // A unit is 1/256 g = 3906.25 ug with full resolution, otherwise 1/32 g (*Specifications*,
        // typical). No 16 bits overflow.
        let micro_g = |units: i32| if self.is_full { units * 15_625 / 4 } else { units * 31_250 };
        Ok([[x0, x1], [y0, y1], [z0, z1]].map(|bytes| micro_g(i16::from_le_bytes(bytes).into())))
    }
}
