//! USART2 on one wire: the line to drivers that share it, as on the Prusa MINI's board (PD5).
//!
//! In half-duplex the receiver is at the transmitter's pin (RM0090, section 30.3.10), so that sent
//! bytes come back. Addresses and bits: RM0090 2.3 (memory map), 7.3.13 (RCC_APB1ENR), 8.4 (GPIO),
//! 30.6 (USART); RM0390 is the same.

use ferrostep_register_address::register;

use crate::gpio::{self, AFRL, ALTERNATE, MODER, OTYPER, PULL_UP, PUPDR};
use crate::rcc::{RCC_AHB1ENR, RCC_APB1ENR};
use crate::registers::Registers;
use ferrostep_tmc2209::{LineBusy, LineBytes, SingleWireUart};

const USART2_CLOCK: u32 = 1 << 17;
const USART2_SR: u32 = register!(USART2.sr);
const USART2_DR: u32 = register!(USART2.dr);
const USART2_BRR: u32 = register!(USART2.brr);
const USART2_CR1: u32 = register!(USART2.cr1);
const USART2_CR3: u32 = register!(USART2.cr3);

const OVERRUN: u32 = 1 << 3;
const RECEIVED: u32 = 1 << 5;
const SENT: u32 = 1 << 6;
const TAKES_ONE: u32 = 1 << 7;
/// CR1: enable, transmitter, receiver, interrupt at a received byte; and the one at an
/// empty transmitter.
const ENABLED: u32 = 1 << 13 | 1 << 3 | 1 << 2 | 1 << 5;
const ASKS_FOR_MORE: u32 = 1 << 7;
/// CR3: half-duplex.
const HALF_DUPLEX: u32 = 1 << 3;
/// USART2 on PD5 and PA2.
const ALTERNATE_FUNCTION: u32 = 7;

/// The line, number 0; its interrupt calls [`Self::interrupt`].
#[derive(Debug)]
pub struct HalfDuplexLine<R> {
    registers: R,
    bytes: LineBytes,
}

impl<R: Registers> HalfDuplexLine<R> {
    /// Starts the port at a pin (port, 0 for A, and number) that carries USART2's transmitter: open
    /// drain with a pull-up, 8 bits, no parity, 1 stop bit; the receive interrupt is on. `bus_hz`
    /// is the clock of APB1.
    pub fn start(mut registers: R, pin: (u8, u8), bus_hz: u32, baud: u32) -> Self {
        let (port, number) = (gpio::port(pin.0), u32::from(pin.1 & 15));
        registers.switch_clocks_on(RCC_AHB1ENR, 1 << pin.0);
        registers.switch_clocks_on(RCC_APB1ENR, USART2_CLOCK);
        // Sixteenths of the divider, rounded, are what BRR holds; 42 MHz / 9600 baud
        // fit its 16 bits.
        let divider = (bus_hz + baud / 2) / baud.max(1);
        registers.write(USART2_BRR, divider.min(0xffff));
        registers.write(USART2_CR3, HALF_DUPLEX);
        registers.write(USART2_CR1, ENABLED);
        // The pin last: until then the pull-ups of board and drivers hold the line high.
        registers.modify(port + OTYPER, 0, 1 << number);
        registers.modify(port + PUPDR, 0b11 << (2 * number), PULL_UP << (2 * number));
        let place = number % 8 * 4;
        registers.modify(port + AFRL + number / 8 * 4, 0xf << place, ALTERNATE_FUNCTION << place);
        registers.modify(port + MODER, 0b11 << (2 * number), ALTERNATE << (2 * number));
        Self { registers, bytes: LineBytes::new() }
    }

    /// A byte has arrived, or the transmitter takes one. Must run before the second byte after it:
    /// 174 us at 115,200 baud. One that is lost, or damaged, shows in the datagram's checksum.
    pub fn interrupt(&mut self) {
        let status = self.registers.read(USART2_SR);
        // Reading status and data clears the overrun, which would otherwise interrupt endlessly.
        if status & (RECEIVED | OVERRUN) != 0 {
            self.bytes.keep(self.registers.read(USART2_DR) as u8);
        }
        // A real transmitter takes two at once; an emulator's all of them, and never asks for more.
        while self.registers.read(USART2_SR) & TAKES_ONE != 0 {
            let Some(byte) = self.bytes.to_send() else { return self.registers.write(USART2_CR1, ENABLED) };
            self.registers.write(USART2_DR, byte.into());
            self.bytes.has_sent();
        }
    }
}

impl<R: Registers> SingleWireUart for HalfDuplexLine<R> {
    fn send(&mut self, _line: u8, bytes: &[u8], _now_ticks: u32) -> Result<(), LineBusy> {
        if self.bytes.has_more() || self.registers.read(USART2_SR) & SENT == 0 {
            return Err(LineBusy);
        }
        self.bytes.begin(bytes);
        self.registers.write(USART2_CR1, ENABLED | ASKS_FOR_MORE);
        Ok(())
    }

    fn receive(&mut self, _now_ticks: u32) -> Option<u8> {
        self.bytes.take()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::cell::RefCell;
    use std::collections::VecDeque;

    use super::*;
    use crate::mini_drivers::{MINI, MINI_WIRING};
    use crate::registers::recorder::Recorder;
    use ferrostep_tmc2209::{DriverBank, DriverState, LineTiming};
    use ferrostep_virtual_board::DriverChip;

    #[test]
    fn the_port_is_set_up_register_by_register() {
        let line = HalfDuplexLine::start(Recorder::default().with(0x4002_0c20, 0xf << 20), (3, 5), 42_000_000, 115_200);
        let registers = line.registers;
        let [port, uart] = [0x4002_0c00, 0x4000_4400];
        assert_eq!(registers.value(RCC_AHB1ENR), 1 << 3);
        assert_eq!(registers.value(0x4002_3840), 1 << 17);
        // 42 MHz / 115,200 = 364.6; 0.1 % off.
        assert_eq!(registers.value(uart + 0x08), 365);
        // Half-duplex; UE, TE, RE, RXNEIE alone.
        assert_eq!((registers.value(uart + 0x14), registers.value(uart + 0x0c)), (1 << 3, 0x202c));
        // PD5: open drain, pull-up, function 7, and last of all no longer an input.
        assert_eq!(registers.value(port + 0x04), 1 << 5);
        assert_eq!(registers.value(port + 0x0c), 0b01 << 10);
        assert_eq!(registers.value(port + 0x20), 7 << 20);
        assert_eq!(registers.stores.last(), Some(&(port, 0b10 << 10)));
    }

    #[test]
    fn the_other_clock_and_a_pin_of_the_upper_half() {
        let line = HalfDuplexLine::start(Recorder::default(), (0, 9), 16_000_000, 115_200);
        assert_eq!(line.registers.value(USART2_BRR), 139);
        assert_eq!(line.registers.value(0x4002_0024), 7 << 4);
    }

    /// A port with chips on its wire: sent bytes come back, and a chip's reply after them.
    #[derive(Default)]
    struct Port {
        recorder: Recorder,
        chips: Vec<DriverChip>,
        heard: Vec<u8>,
        coming: VecDeque<u8>,
        /// Every byte on the wire.
        wire: Vec<u8>,
    }

    impl Port {
        fn is_called(&self) -> bool {
            !self.coming.is_empty() || self.recorder.value(USART2_CR1) & ASKS_FOR_MORE != 0
        }
    }

    impl Registers for &RefCell<Port> {
        fn read(&mut self, address: u32) -> u32 {
            let mut port = self.borrow_mut();
            match address {
                USART2_SR => SENT | TAKES_ONE | if port.coming.is_empty() { 0 } else { RECEIVED },
                USART2_DR => port.coming.pop_front().map_or(0, u32::from),
                _ => port.recorder.read(address),
            }
        }

        fn write(&mut self, address: u32, value: u32) {
            let mut port = self.borrow_mut();
            port.recorder.write(address, value);
            if address != USART2_DR {
                return;
            }
            port.wire.push(value as u8);
            port.coming.push_back(value as u8);
            port.heard.push(value as u8);
            // A read's request has 4 bytes, a write 8, which its third byte tells.
            let length = if port.heard.get(2).is_some_and(|register| register & 0x80 != 0) { 8 } else { 4 };
            if port.heard.len() == length {
                let datagram = std::mem::take(&mut port.heard);
                let replies: Vec<u8> =
                    port.chips.iter_mut().filter_map(|chip| chip.hear(&datagram)).flatten().collect();
                port.wire.extend(&replies);
                port.coming.extend(replies);
            }
        }
    }

    #[test]
    fn four_drivers_are_set_up_over_it() {
        let port = RefCell::new(Port { chips: (0..4).map(DriverChip::new).collect(), ..Port::default() });
        let mut line = HalfDuplexLine::start(&port, (3, 5), 42_000_000, 115_200);
        let drivers = MINI_WIRING.map(|wiring| Some((MINI, wiring)));
        let mut bank = DriverBank::new(drivers, LineTiming::new(1_000_000, 115_200), 0);
        for now in 0..400_000 {
            bank.poll(&mut line, now);
            if port.borrow().is_called() {
                line.interrupt();
            }
        }
        assert_eq!([0, 1, 2, 3].map(|motor| bank.state(motor)), [Some(DriverState::Confirmed); 4]);
        // NODECONF of the first: sync, address, register to be written, value, checksum.
        let first = &port.borrow().wire[..8];
        assert_eq!(
            first,
            ferrostep_tmc2209::write_request(MINI_WIRING[0].address, ferrostep_tmc2209::Register::NodeConf, 0x200)
        );
    }
}
