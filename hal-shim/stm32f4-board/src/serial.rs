//! USART1, the host's line.

use crate::handlers::complete_stores;
use crate::pac::{RCC, USART1};
use fugit::HertzU32 as Hertz;

/// Maximum number of bytes handed to the transmitter in one interrupt. A real transmitter takes
/// two; QEMU's would take any number.
const BYTES_AT_ONCE: usize = 16;

/// State of the transmitter after a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transmit {
    /// All has been handed over.
    Done,
    /// The transmitter will raise its interrupt when it takes more.
    Waits,
    /// The transmitter would take more right away: call again soon.
    Again,
}

/// The serial port; its interrupt calls [`Self::receive`] and [`Self::transmit`].
pub struct Serial {
    usart: USART1,
}

impl Serial {
    /// Starts the port: 8 bits, no parity, 1 stop bit; the receive interrupt is on. `bus` is the
    /// port's clock.
    pub fn start(usart: USART1, rcc: &RCC, bus: Hertz, baud: u32) -> Self {
        rcc.apb2enr().modify(|_, w| w.usart1en().set_bit());
        // Read back: `Registers::switch_clocks_on` says why.
        let _switched_on = rcc.apb2enr().read();
        // Sixteenths of the divider, rounded, are what BRR holds; 84 MHz / 9600 baud
        // fit its 16 bits.
        let divider = (bus.raw() + baud / 2) / baud.max(1);
        // SAFETY: any value is a divider.
        usart.brr().write(|w| unsafe { w.bits(divider as u16) });
        usart.cr1().write(|w| w.ue().set_bit().te().set_bit().re().set_bit().rxneie().set_bit());
        Self { usart }
    }

    /// Returns the received byte, if any. The line's checksum reveals a byte lost before it
    /// (overrun).
    #[inline]
    pub fn receive(&mut self) -> Option<u8> {
        let status = self.usart.sr().read();
        // Reading status and data clears the overrun, which would otherwise interrupt endlessly.
        let (has_byte, overrun) = (status.rxne().bit_is_set(), status.ore().bit_is_set());
        let byte = (has_byte || overrun).then(|| self.usart.dr().read().dr().bits() as u8);
        byte.filter(|_| has_byte)
    }

    /// Hands bytes from `next` to the transmitter while it takes them. Must be the interrupt's last
    /// action.
    pub fn transmit(&mut self, next: impl FnMut() -> Option<u8>) -> Transmit {
        let outcome = self.hand_over(next);
        complete_stores();
        outcome
    }

    fn hand_over(&mut self, mut next: impl FnMut() -> Option<u8>) -> Transmit {
        for _ in 0..BYTES_AT_ONCE {
            if self.usart.sr().read().txe().bit_is_clear() {
                self.usart.cr1().modify(|_, w| w.txeie().set_bit());
                return Transmit::Waits;
            }
            match next() {
                Some(byte) => self.usart.dr().write(|w| w.dr().set(u16::from(byte))),
                None => {
                    self.usart.cr1().modify(|_, w| w.txeie().clear_bit());
                    return Transmit::Done;
                }
            };
        }
        Transmit::Again
    }
}
