//! The serial lines to motor drivers: none, USART2 on one wire, or a pin each with TIM7. Their
//! logic is `ferrostep_stm32f4`'s.

use core::sync::atomic::AtomicU8;

use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4::{HalfDuplexLine, PinLines};
use ferrostep_tmc2209::{LineBusy, SingleWireUart};

use crate::handlers::complete_stores;
use crate::pac::{Interrupt, TIM7, USART2};
use crate::volatile::Volatile;

/// Mask of the motors whose drivers are set up. In RAM and by this name, so that a debugger, or a
/// change of the image, can take drivers away where there is no motor supply; the board's tests do
/// so in an emulator.
#[used]
#[unsafe(no_mangle)]
pub static FERROSTEP_DRIVERS: AtomicU8 = AtomicU8::new(0b1111_1111);

/// The peripheral of a board's driver lines. Its interrupt is USART2's or TIM7's.
pub trait DriverLine: SingleWireUart {
    /// Speed of the lines.
    const BAUD: u32;
    /// The interrupt to be called when a datagram begins, for an emulator's port that does
    /// not do so itself.
    const PENDED: Option<Interrupt> = None;
    /// Starts them at pins (port, 0 for A, and number): that of the shared line first,
    /// or each motor's.
    fn start(peripherals: (USART2, TIM7), clock: &Clock, pins: &[(u8, u8)]) -> Self;
    /// The interrupt.
    fn interrupt(&mut self);
}

/// A line that all drivers share, on USART2.
pub type SharedLine = HalfDuplexLine<Volatile>;

impl DriverLine for SharedLine {
    const BAUD: u32 = 115_200;
    const PENDED: Option<Interrupt> = Some(Interrupt::USART2);

    fn start(_: (USART2, TIM7), clock: &Clock, pins: &[(u8, u8)]) -> Self {
        let pin = pins.first().copied().unwrap_or_default();
        // SAFETY: USART2 was given up to this; the pin is the line's by the board's file.
        let registers = unsafe { Volatile::new() };
        Self::start(registers, pin, clock.slow_bus.raw(), Self::BAUD)
    }

    #[inline]
    fn interrupt(&mut self) {
        Self::interrupt(self);
        complete_stores();
    }
}

/// A line for each driver, on any pin.
pub type OwnLines<const N: usize> = PinLines<Volatile, N>;

impl<const N: usize> DriverLine for OwnLines<N> {
    /// The fastest rate that a timer's interrupt can sample without much of the processor's time:
    /// 76,800 interrupts a second while a line is in use.
    const BAUD: u32 = 19_200;

    fn start(_: (USART2, TIM7), clock: &Clock, pins: &[(u8, u8)]) -> Self {
        // SAFETY: TIM7 was given up to this; the pins are the lines' by the board's file. After the
        // start only code that this cannot interrupt changes their ports' modes.
        let registers = unsafe { Volatile::new() };
        let pins = core::array::from_fn(|motor| pins.get(motor).copied().unwrap_or_default());
        Self::start(registers, pins, clock.slow_timers.raw(), Self::BAUD)
    }

    #[inline]
    fn interrupt(&mut self) {
        Self::interrupt(self);
        complete_stores();
    }
}

/// No lines: the drivers cannot be set, or the profile does not say to what.
#[derive(Debug)]
pub struct NoLine;

impl DriverLine for NoLine {
    const BAUD: u32 = 1;

    fn start(_: (USART2, TIM7), _: &Clock, _: &[(u8, u8)]) -> Self {
        Self
    }

    fn interrupt(&mut self) {}
}

impl SingleWireUart for NoLine {
    fn send(&mut self, _: u8, _: &[u8], _: u32) -> Result<(), LineBusy> {
        Err(LineBusy)
    }

    fn receive(&mut self, _: u32) -> Option<u8> {
        None
    }
}
