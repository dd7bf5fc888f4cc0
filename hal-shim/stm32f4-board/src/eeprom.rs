//! The bit-banged bus to an EEPROM.

use ferrostep_stm32f4::{I2cPins, SoftwareI2c};

use crate::core_pace::CorePace;
use crate::volatile::Volatile;

/// Bit-banged I2C bus.
pub type Bus = SoftwareI2c<Volatile, Pace>;

/// Half a clock period: with the stores around it the clock is just below 100 kHz, which every
/// 24C32 supports at 3.3 V, and at which weak pull-ups still give usable edges.
type Pace = CorePace<5_000>;

/// Creates the bus at the pins of the board file. Call after
/// [`BoardPins::new`](crate::board::BoardPins::new). For one task.
pub fn start(pins: I2cPins) -> Bus {
    // SAFETY: of the ports it reads two pins' inputs, and sets those pins, which the board's file
    // gives to this bus alone, by one store for each.
    let registers = unsafe { Volatile::new() };
    SoftwareI2c::new(registers, pins, CorePace)
}
