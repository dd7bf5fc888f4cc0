//! The bit-banged bus to an accelerometer.

use ferrostep_stm32f4::{SoftwareSpi, SpiPins};

use crate::core_pace::CorePace;
use crate::volatile::Volatile;

/// Bit-banged SPI bus.
pub type Bus = SoftwareSpi<Volatile, Pace>;

/// Half a clock period: with the stores around it the clock stays below 1.5 MHz, which wires of a
/// metre can carry, and at which an ADXL345 needs no pause between samples.
type Pace = CorePace<334>;

/// Creates the bus at the pins of the board file. Call after
/// [`BoardPins::new`](crate::board::BoardPins::new).
pub fn start(pins: SpiPins) -> Bus {
    // SAFETY: of the ports it reads one pin's input, and sets pins that the board's file gives to
    // this bus alone, one store for each.
    let registers = unsafe { Volatile::new() };
    SoftwareSpi::new(registers, pins, CorePace)
}
