//! Serial lines to motor drivers: none, USART2 on one wire, or one pin each with TIM7. Their logic
//! is in `ferrostep_stm32f4`.

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

/// Peripheral of a board's driver lines. Its interrupt is that of USART2 or TIM7.
pub trait DriverLine: SingleWireUart {
    /// Baud rate of the lines.
    const BAUD: u32;
    /// Interrupt to pend when a datagram begins, for an emulated port that does not raise it by
    /// itself.
    const PENDED: Option<Interrupt> = None;
    /// Starts the lines at these pins (port, 0 for A, and number): the shared line's first, or one
    /// for each motor.
    fn start(peripherals: (USART2, TIM7), clock: &Clock, pins: &[(u8, u8)]) -> Self;
    /// Handles the interrupt.
    fn interrupt(&mut self);
}

/// A single line shared by all drivers, on USART2.
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

/// One line per driver, on any pin.
pub type OwnLines<const N: usize> = PinLines<Volatile, N>;

impl<const N: usize> DriverLine for OwnLines<N> {
    /// The fastest rate that a timer interrupt can sample without taking much processor time:
    /// 76,800 interrupts per second while a line is in use.
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

/// No lines: the drivers cannot be configured, or the profile has no settings for them.
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
