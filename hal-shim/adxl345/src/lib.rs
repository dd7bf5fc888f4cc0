//! Driver for the ADXL345 accelerometer over SPI: identity check, rate, resolution, and the samples
//! in the FIFO.
//!
//! Registers and bits are those of the ADXL345 data sheet, revision G: *Register map*, *Register
//! definitions*, *FIFO*. The bus is any four-wire [`SpiDevice`] in mode 3, clocked at no more than
//! 1.6 MHz: up to that clock, sending a sample's address takes the 5 us that the FIFO needs between
//! two samples (*Retrieving data from FIFO*).
#![cfg_attr(not(test), no_std)]

use embedded_hal::spi::SpiDevice;
use ferrostep_hal_shim::{AccelerometerChip, AccelerometerFault, AccelerometerType, WaitingSamples};

/// Sensor type: the chip's faster rates, and its two resolutions at +-16 g.
pub const TYPE: AccelerometerType = AccelerometerType {
    name: "ADXL345",
    rates_hz: &[25, 50, 100, 200, 400, 800, 1600, 3200],
    resolution_bits: &[10, 13],
};

/// Fastest clock at which samples can be read without a pause between them, Hz.
pub const MAX_CLOCK_HZ: u32 = 1_600_000;

/// Flags in the first byte of a frame: read the register (`READ`), and continue with the registers
/// after it (`MANY`).
const READ: u8 = 0x80;
const MANY: u8 = 0x40;

/// DEVID register and its expected value.
const DEVICE_ID: u8 = 0x00;
const IDENTITY: u8 = 0xe5;
/// BW_RATE register, and the code of 25 Hz; each following code doubles the rate.
const BANDWIDTH_RATE: u8 = 0x2c;
const CODE_OF_25_HZ: u8 = 0b1000;
/// POWER_CTL register: standby and measuring.
const POWER_CONTROL: u8 = 0x2d;
const STANDBY: u8 = 0;
const MEASURE: u8 = 1 << 3;
/// INT_SOURCE register: the flag of a FIFO overrun.
const INTERRUPT_SOURCE: u8 = 0x30;
const OVERRUN: u8 = 1;
/// DATA_FORMAT register: +-16 g; full resolution has 256 units per g instead of 1024 units for the
/// whole range.
const DATA_FORMAT: u8 = 0x31;
const RANGE_16_G: u8 = 0b11;
const FULL_RESOLUTION: u8 = 1 << 3;
/// DATAX0, the first of the six data registers.
const DATA: u8 = 0x32;
/// FIFO_CTL register: bypass, which empties the FIFO, and streaming of the newest 32 samples.
const FIFO_CONTROL: u8 = 0x38;
const BYPASS: u8 = 0;
const STREAM: u8 = 0b10 << 6;
/// FIFO_STATUS register and the bits that hold the number of samples. The count may exceed 32 by
/// one: the output filter can hold another sample.
const FIFO_STATUS: u8 = 0x39;
const ENTRIES: u8 = 0x3f;
const MAX_ENTRIES: u8 = 33;

/// Maximum resolution, in bits, at which the whole range is 1024 units.
const COARSE_BITS: u8 = 10;

/// An ADXL345 with all three axes set to +-16 g.
#[derive(Debug)]
pub struct Adxl345<S> {
    spi: S,
    is_full: bool,
}

impl<S: SpiDevice> Adxl345<S> {
    /// Creates the driver without any transfer on the bus.
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
        // Standby first: the data sheet advises it before settings change.
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
        // Without an answer the chip is disconnected: there is nothing to end.
        let _ = self.write(POWER_CONTROL, STANDBY);
    }

    fn waiting(&mut self) -> Result<WaitingSamples, AccelerometerFault> {
        // Count first: reading samples clears the overrun flag, so nothing may be read in between.
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
        // A unit is 1/256 g = 3906.25 ug at full resolution, otherwise 1/32 g (*Specifications*,
        // typical). No 16-bit value overflows.
        let micro_g = |units: i32| if self.is_full { units * 15_625 / 4 } else { units * 31_250 };
        Ok([[x0, x1], [y0, y1], [z0, z1]].map(|bytes| micro_g(i16::from_le_bytes(bytes).into())))
    }
}
