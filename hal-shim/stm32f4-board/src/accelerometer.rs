//! The bus to an accelerometer, by software.

use ferrostep_stm32f4::{BusPace, SoftwareSpi, SpiPins};

use crate::board::CORE_HZ;
use crate::volatile::Volatile;

/// The bus.
pub type Bus = SoftwareSpi<Volatile, Pace>;

/// Half of a clock's period: with it and the stores around it the clock is below 1.5 MHz, which wires of a metre carry, and at which
/// an ADXL345 needs no pause from one sample to the next.
#[derive(Debug)]
pub struct Pace(());

const HALF_PERIOD_CYCLES: u32 = (CORE_HZ / 1_000_000 * Pace::HALF_PERIOD_NS).div_ceil(1000);

impl BusPace for Pace {
    const HALF_PERIOD_NS: u32 = 334;

    #[inline]
    fn half_period(&mut self) {
        cortex_m::asm::delay(HALF_PERIOD_CYCLES);
    }
}

/// The bus at these pins, those of the board's file, after [`BoardPins::new`](crate::board::BoardPins::new).
pub fn start(pins: SpiPins) -> Bus {
    // SAFETY: of the ports it reads one pin's input, and sets pins that the board's file gives to this bus alone, one store
    // for each.
    let registers = unsafe { Volatile::new() };
    SoftwareSpi::new(registers, pins, Pace(()))
}
