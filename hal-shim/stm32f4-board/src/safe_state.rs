//! The safe state: the end of a program after a panic or a fault.

use core::fmt;

use ferrostep_stm32f4::clock_setup;

use crate::board::{CORE_HZ, INTERNAL_HZ};
use crate::pac::USART1;
use crate::volatile::Volatile;
use crate::{board, servo, supervision};

/// Maximum number of polls of the transmitter for one byte: longer than a byte takes at 9600 baud
/// and 168 MHz.
const MAX_LOOKS: u32 = 200_000;

/// Cycles between two feedings of the watchdog in the safe state, if no servo pulse takes that
/// long: 20 ms, or 0.2 s on the internal oscillator; the watchdog allows a second.
const REST_CYCLES: u32 = CORE_HZ / 50;

/// Stops all interrupts and switches heaters, then motors off, by their registers; then the fans
/// full on, and the USB port off the bus, so that its host ends as well.
// Inlined, so that the test of interrupt masking sees each caller.
#[inline(always)]
pub fn enter() {
    cortex_m::interrupt::disable();
    board::all_off();
}

/// Returns true if the crystal has stopped; the core then takes the non-maskable interrupt. The
/// chip has switched to its internal oscillator by itself, with the bus dividers unchanged; in that
/// case the host line gets its speed back. After [`enter`] only.
pub fn crystal_has_stopped() -> bool {
    // SAFETY: a register is only read.
    let has_stopped = clock_setup::crystal_has_stopped(&mut unsafe { Volatile::new() });
    if has_stopped {
        // SAFETY: interrupts are off for good, so that no other code writes to the port.
        let usart = unsafe { &*USART1::ptr() };
        let divider = clock_setup::divider_without_crystal(usart.brr().read().bits(), CORE_HZ, INTERNAL_HZ);
        // SAFETY: any value is a divider.
        usart.brr().write(|w| unsafe { w.bits(divider) });
    }
    has_stopped
}

/// Stores a text that survives the reset, and then sends it to the host, which takes a thousand
/// times as long. After [`enter`] only.
#[inline(never)]
pub fn tell(end: fmt::Arguments<'_>, kept: fmt::Arguments<'_>) {
    supervision::keep_last_words(kept);
    // The line cannot fail, and no task is left to report to.
    let _ = fmt::write(&mut LastWords, format_args!("\nError:{end}, printer halted. kill() called!\n"));
}

/// Rests until the board is reset: a machine that restarts on its own might start heating, or
/// continue a print from a wrong position. The watchdog, which would reset the board, is fed. A
/// probe's pin is retracted, again and again.
pub fn rest() -> ! {
    loop {
        supervision::feed_at_the_end();
        if !servo::pin_in_at_the_end() {
            cortex_m::asm::delay(REST_CYCLES);
        }
    }
}

/// Writer of a last line to the host that bypasses all queues. After [`enter`] only.
pub struct LastWords;

impl fmt::Write for LastWords {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        // SAFETY: interrupts are off for good, so that no other code writes to the port.
        let usart = unsafe { &*USART1::ptr() };
        for byte in text.bytes() {
            let _ready = (0..MAX_LOOKS).any(|_| usart.sr().read().txe().bit_is_set());
            usart.dr().write(|w| w.dr().set(u16::from(byte)));
        }
        Ok(())
    }
}
