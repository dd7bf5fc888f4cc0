//! The driver against a register model of the chip that follows the data sheet.
#![allow(clippy::unwrap_used)]

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;

use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use ferrostep_adxl345::Adxl345;
use ferrostep_hal_shim::{AccelerometerChip, AccelerometerFault, WaitingSamples};

/// Change to a byte on the wire.
type Wire = fn(u8) -> u8;

/// Model of the chip after the data sheet's sections *Serial communications*, *Register map* and
/// *FIFO*.
#[derive(Debug)]
struct Chip {
    registers: [u8; 64],
    memory: VecDeque<[i16; 3]>,
    is_filled: bool,
    /// Effect of a loose wire on the bytes sent to the chip, and on those received from it.
    hears: Wire,
    says: Wire,
    frames: usize,
}

impl Chip {
    fn new() -> RefCell<Self> {
        let mut registers = [0; 64];
        registers[0x00] = 0xe5;
        registers[0x2c] = 0x0a;
        let [hears, says]: [Wire; 2] = [|byte| byte; 2];
        RefCell::new(Self { registers, memory: VecDeque::new(), is_filled: false, hears, says, frames: 0 })
    }

    fn measures(&self) -> bool {
        self.registers[0x2d] & 8 != 0
    }

    /// A sample in units of the resolution.
    fn sample(&mut self, units: [i16; 3]) {
        let is_stream = self.registers[0x38] >> 6 == 0b10;
        assert!(self.measures() && is_stream, "it keeps no samples");
        if self.memory.len() == 33 {
            self.memory.pop_front();
        }
        self.memory.push_back(units);
        self.is_filled |= self.memory.len() >= 32;
    }

    fn read(&self, register: usize) -> u8 {
        let oldest = self.memory.front().copied().unwrap_or_default();
        match register {
            0x30 => u8::from(self.is_filled),
            0x32..=0x37 => oldest[(register - 0x32) / 2].to_le_bytes()[register % 2],
            0x39 => self.memory.len() as u8,
            _ => self.registers[register],
        }
    }

    fn frame(&mut self, words: &mut [u8]) {
        self.frames += 1;
        let first = (self.hears)(words[0]);
        let (reads, many, mut register) = (first & 0x80 != 0, first & 0x40 != 0, usize::from(first & 0x3f));
        words[0] = (self.says)(0);
        for word in &mut words[1..] {
            if reads {
                *word = (self.says)(self.read(register));
            } else {
                let value = (self.hears)(*word);
                if register == 0x38 && value >> 6 == 0 {
                    self.memory.clear();
                    self.is_filled = false;
                }
                assert!(register >= 0x1d && !(0x32..=0x37).contains(&register), "{register:#x} is read-only");
                self.registers[register] = value;
            }
            register += usize::from(many);
        }
        if reads && (0x32..=0x37).contains(&usize::from(first & 0x3f)) {
            self.memory.pop_front();
            self.is_filled = false;
        }
    }
}

/// SPI bus with the model attached.
#[derive(Debug)]
struct Bus<'a>(&'a RefCell<Chip>);

impl ErrorType for Bus<'_> {
    type Error = Infallible;
}

impl SpiDevice for Bus<'_> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        let mut chip = self.0.borrow_mut();
        for operation in operations {
            match operation {
                Operation::Write(words) => chip.frame(&mut words.to_vec()),
                Operation::TransferInPlace(words) => chip.frame(words),
                other => panic!("{other:?}"),
            }
        }
        Ok(())
    }
}

#[test]
fn it_is_set_up_at_rest_and_then_measures() {
    for (rate_hz, code) in [(25, 8), (50, 9), (100, 10), (200, 11), (400, 12), (800, 13), (1600, 14), (3200, 15)] {
        for (bits, format) in [(10, 0b0011), (13, 0b1011)] {
            let chip = Chip::new();
            // The chip was measuring before, and its FIFO is not empty.
            (chip.borrow_mut().registers[0x2d], chip.borrow_mut().registers[0x38]) = (8, 0x80);
            chip.borrow_mut().sample([1, 2, 3]);
            let mut driver = Adxl345::new(Bus(&chip));
            driver.begin(rate_hz, bits).unwrap();
            assert_eq!(driver.waiting(), Ok(WaitingSamples::default()), "emptied");
            let registers = chip.borrow().registers;
            assert_eq!((registers[0x2c], registers[0x31], registers[0x38], registers[0x2d]), (code, format, 0x80, 8));
            driver.end();
            assert!(!chip.borrow().measures());
        }
    }
}

#[test]
fn samples_come_oldest_first_in_millionths_of_gravity() {
    let chip = Chip::new();
    let mut driver = Adxl345::new(Bus(&chip));
    driver.begin(800, 13).unwrap();
    chip.borrow_mut().sample([256, -256, 4095]);
    chip.borrow_mut().sample([1, -1, -4096]);
    assert_eq!(driver.waiting(), Ok(WaitingSamples { samples: 2, overflowed: false }));
    assert_eq!(driver.take(), Ok([1_000_000, -1_000_000, 15_996_093]));
    assert_eq!(driver.take(), Ok([3_906, -3_906, -16_000_000]));
    assert_eq!(driver.waiting(), Ok(WaitingSamples::default()));
    driver.begin(800, 10).unwrap();
    chip.borrow_mut().sample([32, -512, 511]);
    assert_eq!(driver.take(), Ok([1_000_000, -16_000_000, 15_968_750]));
    // Random bits from a disturbed bus cause no overflow.
    for bits in [10, 13] {
        driver.begin(800, bits).unwrap();
        chip.borrow_mut().sample([i16::MIN, i16::MAX, -1]);
        driver.take().unwrap();
    }
}

#[test]
fn a_full_memory_is_told_until_it_is_read() {
    let chip = Chip::new();
    let mut driver = Adxl345::new(Bus(&chip));
    driver.begin(3200, 13).unwrap();
    for number in 0..31 {
        chip.borrow_mut().sample([number, 0, 0]);
    }
    assert_eq!(driver.waiting(), Ok(WaitingSamples { samples: 31, overflowed: false }));
    for number in 31..40 {
        chip.borrow_mut().sample([number, 0, 0]);
    }
    assert_eq!(driver.waiting(), Ok(WaitingSamples { samples: 33, overflowed: true }));
    for number in 7..40 {
        assert_eq!(driver.take().unwrap()[0], number * 15_625 / 4);
    }
    assert_eq!(driver.waiting(), Ok(WaitingSamples::default()));
}

#[test]
fn loose_wires_and_other_chips_are_told_apart_from_samples() {
    let identity = |read| AccelerometerFault::Identity { read, expected: 0xe5 };
    let faults: [(Wire, Wire, AccelerometerFault); 4] = [
        // The data line is undriven or shorted.
        (|byte| byte, |_| 0xff, identity(0xff)),
        (|byte| byte, |_| 0x00, identity(0x00)),
        // Another chip's identity number.
        (|byte| byte, |byte| if byte == 0xe5 { 0x44 } else { byte }, identity(0x44)),
        // A bit of the sent bytes is lost, so settings stay unchanged.
        (|byte| byte & !0x08, |byte| byte, AccelerometerFault::Settings),
    ];
    for (hears, says, fault) in faults {
        let chip = Chip::new();
        (chip.borrow_mut().hears, chip.borrow_mut().says) = (hears, says);
        let mut driver = Adxl345::new(Bus(&chip));
        assert_eq!(driver.begin(800, 13), Err(fault));
        assert!(!chip.borrow().measures(), "{fault:?}");
    }
    // The chip is disconnected while it measures.
    let chip = Chip::new();
    let mut driver = Adxl345::new(Bus(&chip));
    driver.begin(800, 13).unwrap();
    chip.borrow_mut().says = |_| 0xff;
    assert_eq!(driver.waiting(), Err(AccelerometerFault::Count(63)));
    assert_eq!(driver.check(), Err(identity(0xff)));
}

/// A bus whose transfers fail.
#[derive(Debug)]
struct Broken;

impl ErrorType for Broken {
    type Error = ErrorKind;
}

impl SpiDevice for Broken {
    fn transaction(&mut self, _: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        Err(ErrorKind::Other)
    }
}

#[test]
fn a_failed_bus_is_told() {
    let mut driver = Adxl345::new(Broken);
    assert_eq!(driver.check(), Err(AccelerometerFault::Bus));
    assert_eq!(driver.begin(25, 10), Err(AccelerometerFault::Bus));
    assert_eq!(driver.waiting(), Err(AccelerometerFault::Bus));
    assert_eq!(driver.take(), Err(AccelerometerFault::Bus));
    driver.end();
}
