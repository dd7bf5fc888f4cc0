//! SPI by software, on any four pins: for a part that is asked seldom, so that neither a peripheral
//! nor its alternate functions are used up.
//!
//! Mode 3: the clock rests high, data change when it falls and are taken when it rises. It knows
//! the ports' registers (RM0090 8.4): levels are set by BSRR, one store for one pin, so that a task
//! that is interrupted inside a frame changes no other pin.

use core::convert::Infallible;

use embedded_hal::spi::{ErrorType, Operation, SpiDevice};

use crate::bus_pace::BusPace;
use crate::gpio::{self, BSRR, IDR};
use crate::registers::Registers;

/// The pins of a bus with one part on it: port, 0 for A, and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpiPins {
    /// The clock.
    pub sck: (u8, u8),
    /// Data from the part.
    pub miso: (u8, u8),
    /// Data to the part.
    pub mosi: (u8, u8),
    /// Low while the part is asked.
    pub cs: (u8, u8),
}

/// The bus. The caller has set its pins up: `miso` an input, the others outputs,
/// `cs` and `sck` high.
#[derive(Debug)]
pub struct SoftwareSpi<R, P> {
    registers: R,
    pins: SpiPins,
    pace: P,
}

impl<R: Registers, P: BusPace> SoftwareSpi<R, P> {
    /// A bus.
    pub const fn new(registers: R, pins: SpiPins, pace: P) -> Self {
        Self { registers, pins, pace }
    }

    fn set(&mut self, (port, number): (u8, u8), high: bool) {
        let bit = 1 << (number & 15);
        self.registers.write(gpio::port(port) + BSRR, if high { bit } else { bit << 16 });
    }

    /// Sends a byte, the highest bit first, and returns the one that came meanwhile.
    #[inline(never)]
    fn exchange(&mut self, sent: u8) -> u8 {
        let SpiPins { sck, miso: (port, number), mosi, .. } = self.pins;
        (0..8).rev().fold(0, |received, place| {
            self.set(sck, false);
            self.set(mosi, sent >> place & 1 == 1);
            self.pace.half_period();
            self.set(sck, true);
            let bit = self.registers.read(gpio::port(port) + IDR) >> (number & 15) & 1;
            self.pace.half_period();
            received << 1 | bit as u8
        })
    }

    fn operate(&mut self, operation: &mut Operation<'_, u8>) {
        match operation {
            Operation::Read(words) => words.iter_mut().for_each(|word| *word = self.exchange(0)),
            Operation::Write(words) => words.iter().for_each(|word| {
                self.exchange(*word);
            }),
            Operation::Transfer(read, write) => {
                for place in 0..read.len().max(write.len()) {
                    let received = self.exchange(write.get(place).copied().unwrap_or(0));
                    if let Some(word) = read.get_mut(place) {
                        *word = received;
                    }
                }
            }
            Operation::TransferInPlace(words) => words.iter_mut().for_each(|word| *word = self.exchange(*word)),
            Operation::DelayNs(ns) => {
                let halves = ns.div_ceil(P::HALF_PERIOD_NS);
                (0..halves).for_each(|_| self.pace.half_period());
            }
        }
    }
}

impl<R, P> ErrorType for SoftwareSpi<R, P> {
    type Error = Infallible;
}

impl<R: Registers, P: BusPace> SpiDevice for SoftwareSpi<R, P> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        self.set(self.pins.cs, false);
        self.pace.half_period();
        operations.iter_mut().for_each(|operation| self.operate(operation));
        self.set(self.pins.cs, true);
        // A part wants some time between two frames.
        self.pace.half_period();
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::cell::{Cell, RefCell};

    use super::*;
    use crate::gpio::{GPIO, GPIO_STRIDE};

    /// The Octopus's: three pins of port B, one of A.
    const PINS: SpiPins = SpiPins { sck: (1, 3), miso: (1, 4), mosi: (1, 5), cs: (0, 15) };

    /// Ports with a part on the bus that answers each byte with the byte before, plus one.
    #[derive(Default)]
    struct Part {
        outputs: [u32; 2],
        shift: u8,
        answer: u8,
        says: bool,
        bits: u32,
        /// Edges in their order, each with the halves of a period that had passed.
        edges: Vec<(char, bool, u32)>,
        bytes: Vec<u8>,
    }

    struct Wires<'a> {
        part: &'a RefCell<Part>,
        halves: &'a Cell<u32>,
    }

    impl Registers for Wires<'_> {
        fn read(&mut self, address: u32) -> u32 {
            assert_eq!(address, 0x4002_0410, "port B's inputs");
            // The other inputs are high.
            if self.part.borrow().says { u32::MAX } else { !(1 << 4) }
        }

        fn write(&mut self, address: u32, value: u32) {
            let port = ((address - GPIO) / GPIO_STRIDE) as usize;
            assert_eq!(address % GPIO_STRIDE, BSRR);
            assert_eq!(value.count_ones(), 1, "one pin alone");
            let mut part = self.part.borrow_mut();
            let before = part.outputs;
            part.outputs[port] = part.outputs[port] & !(value >> 16) | value & 0xffff;
            let level = |outputs: [u32; 2], (port, number): (u8, u8)| outputs[usize::from(port)] >> number & 1 == 1;
            for (name, pin) in [('c', PINS.sck), ('s', PINS.cs)] {
                let is_high = level(part.outputs, pin);
                if level(before, pin) == is_high {
                    continue;
                }
                part.edges.push((name, is_high, self.halves.get()));
                match (name, is_high) {
                    ('s', false) => (part.bits, part.answer) = (0, 0),
                    ('c', false) => part.says = part.answer >> (7 - part.bits % 8) & 1 == 1,
                    ('c', true) => {
                        let bit = u8::from(level(part.outputs, PINS.mosi));
                        part.shift = part.shift << 1 | bit;
                        part.bits += 1;
                        if part.bits.is_multiple_of(8) {
                            let heard = part.shift;
                            part.bytes.push(heard);
                            part.answer = heard.wrapping_add(1);
                        }
                    }
                    _ => {}
                }
            }
        }
    }

    /// Counts halves of a period.
    struct Halves<'a>(&'a Cell<u32>);

    impl BusPace for Halves<'_> {
        const HALF_PERIOD_NS: u32 = 300;

        fn half_period(&mut self) {
            self.0.set(self.0.get() + 1);
        }
    }

    /// State of a part after a transaction; the part rests with the clock high.
    fn after(act: impl FnOnce(&mut SoftwareSpi<Wires<'_>, Halves<'_>>)) -> Part {
        let part = RefCell::new(Part { outputs: [1 << 15, 1 << 3], ..Part::default() });
        let halves = Cell::new(0);
        act(&mut SoftwareSpi::new(Wires { part: &part, halves: &halves }, PINS, Halves(&halves)));
        part.into_inner()
    }

    #[test]
    fn bytes_go_both_ways_with_the_highest_bit_first() {
        let part = after(|spi| {
            let mut words = [0x80, 0x0f, 0xa5];
            spi.transfer_in_place(&mut words).unwrap();
            assert_eq!(words, [0x00, 0x81, 0x10]);
            let mut read = [0; 2];
            spi.transaction(&mut [Operation::Write(&[0x31]), Operation::Read(&mut read)]).unwrap();
            assert_eq!(read, [0x32, 0x01]);
            let mut read = [0; 3];
            spi.transfer(&mut read, &[0x7f]).unwrap();
            assert_eq!(read, [0x00, 0x80, 0x01]);
        });
        assert_eq!(part.bytes, [0x80, 0x0f, 0xa5, 0x31, 0, 0, 0x7f, 0, 0]);
    }

    #[test]
    fn the_clock_rests_high_and_each_half_lasts() {
        let part = after(|spi| spi.write(&[0xff]).unwrap());
        let edges = &part.edges;
        assert_eq!((edges.first(), edges.len()), (Some(&('s', false, 0)), 18));
        assert_eq!(edges.last().map(|edge| (edge.0, edge.1)), Some(('s', true)));
        let clocks: Vec<_> = edges.iter().filter(|edge| edge.0 == 'c').collect();
        assert!(clocks.iter().enumerate().all(|(index, edge)| edge.1 == (index % 2 == 1)));
        // Half a period from the select to the first edge, and from each edge to the next.
        assert!(edges.windows(2).all(|pair| pair[1].2 == pair[0].2 + 1), "{edges:?}");
    }

    #[test]
    fn a_pause_lasts_at_least_as_long_as_asked() {
        let part = after(|spi| spi.transaction(&mut [Operation::DelayNs(1000)]).unwrap());
        // Half a period after the select, and 4 times 300 ns.
        assert_eq!(part.edges, [('s', false, 0), ('s', true, 5)]);
    }
}
