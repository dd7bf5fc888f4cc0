//! The bus to an accelerometer, by software.

use ferrostep_stm32f4::{SoftwareSpi, SpiPins};

use crate::core_pace::CorePace;
use crate::volatile::Volatile;

/// The bus.
pub type Bus = SoftwareSpi<Volatile, Pace>;

/// Half of a clock's period: with it and the stores around it the clock is below 1.5 MHz, which
/// wires of a metre carry, and at which an ADXL345 needs no pause from one sample to the next.
type Pace = CorePace<334>;

/// The bus at these pins, those of the board's file, after
/// [`BoardPins::new`](crate::board::BoardPins::new).
pub fn start(pins: SpiPins) -> Bus {
    // SAFETY: of the ports it reads one pin's input, and sets pins that the board's file gives to
    // this bus alone, one store for each.
    let registers = unsafe { Volatile::new() };
    SoftwareSpi::new(registers, pins, CorePace)
}
