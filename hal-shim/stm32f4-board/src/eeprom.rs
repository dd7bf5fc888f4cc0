//! The bus to an EEPROM, by software.

use ferrostep_stm32f4::{I2cPins, SoftwareI2c};

use crate::core_pace::CorePace;
use crate::volatile::Volatile;

/// The bus.
pub type Bus = SoftwareI2c<Volatile, Pace>;

/// Half of a clock's period: with it and the stores around it the clock is just below 100 kHz,
/// which every 24C32 knows at 3.3 V, and whose edges weak resistors carry.
type Pace = CorePace<5_000>;

/// The bus at these pins, those of the board's file, after
/// [`BoardPins::new`](crate::board::BoardPins::new). For one task.
pub fn start(pins: I2cPins) -> Bus {
    // SAFETY: of the ports it reads two pins' inputs, and sets those pins, which the board's file
    // gives to this bus alone, by one store for each.
    let registers = unsafe { Volatile::new() };
    SoftwareI2c::new(registers, pins, CorePace)
}
