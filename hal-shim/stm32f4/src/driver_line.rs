//! USART2 on one wire: the line to motor drivers that share it, as on the Prusa MINI's board (PD5).
//!
//! The pin is the caller's to set up: USART2's transmitter (alternate function 7), open drain, with a pull-up. In
//! half-duplex the receiver listens to the same pin (RM0090, section 30.3.10), so that what is sent comes back.

use ferrostep_hal_shim::tmc2209::{LineBusy, LineBytes, SingleWireUart};

use crate::pac::{RCC, USART2};

/// The line; its interrupt calls [`Self::interrupt`]. There is one, number 0.
pub struct DriverLine {
    usart: USART2,
    bytes: LineBytes,
}

impl DriverLine {
    /// Starts the port: half-duplex, 8 bits, no parity, 1 stop bit; the receive interrupt is on. `bus_hz` is the clock of
    /// APB1.
    pub fn start(usart: USART2, rcc: &RCC, bus_hz: u32, baud: u32) -> Self {
        rcc.apb1enr().modify(|_, w| w.usart2en().set_bit());
        // Sixteenths of the divider, rounded, are what BRR holds; 42 MHz / 9600 baud fit its 16 bits.
        let divider = (bus_hz + baud / 2) / baud.max(1);
        // SAFETY: any value is a divider.
        usart.brr().write(|w| unsafe { w.bits(divider as u16) });
        usart.cr3().modify(|_, w| w.hdsel().set_bit());
        usart.cr1().write(|w| w.ue().set_bit().te().set_bit().re().set_bit().rxneie().set_bit());
        Self { usart, bytes: LineBytes::new() }
    }

    /// A byte has come, or the transmitter takes one. Must come before the next but one byte: 174 us at 115,200 baud. One
    /// that is lost, or damaged, shows in the datagram's check sum.
    #[inline]
    pub fn interrupt(&mut self) {
        let status = self.usart.sr().read();
        // Reading status and data clears the overrun, which would otherwise interrupt for ever.
        if status.rxne().bit_is_set() || status.ore().bit_is_set() {
            self.bytes.keep(self.usart.dr().read().dr().bits() as u8);
        }
        if status.txe().bit_is_set() {
            match self.bytes.to_send() {
                Some(byte) => {
                    self.usart.dr().write(|w| w.dr().set(u16::from(byte)));
                    self.bytes.has_sent();
                }
                None => {
                    self.usart.cr1().modify(|_, w| w.txeie().clear_bit());
                }
            }
        }
    }
}

impl SingleWireUart for DriverLine {
    fn send(&mut self, _line: u8, bytes: &[u8], _now_ticks: u32) -> Result<(), LineBusy> {
        if self.bytes.has_more() || self.usart.sr().read().tc().bit_is_clear() {
            return Err(LineBusy);
        }
        self.bytes.begin(bytes);
        self.usart.cr1().modify(|_, w| w.txeie().set_bit());
        Ok(())
    }

    fn receive(&mut self, _now_ticks: u32) -> Option<u8> {
        self.bytes.take()
    }
}
