//! I2C by software, on any two pins: for a part that is asked seldom.
//!
//! The waits of stm32f4xx-hal's I2C have no bound, so that a line that stays low would block the
//! task endlessly. Here every wait has one. The lines are open drain: a pin pulls low or releases,
//! and resistors pull high. Levels are set by BSRR, one store for one pin, so that a task that is
//! interrupted inside a byte changes no other pin; a clock that pauses meanwhile does no harm. From
//! the bus's specification (NXP UM10204, 3.1): conditions, bytes and acknowledges 3.1.4 to 3.1.6, a
//! part that holds the clock 3.1.9, a stuck bus 3.1.16.

use embedded_hal::i2c::{Error, ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};

use crate::bus_pace::BusPace;
use crate::gpio::{self, BSRR, IDR};
use crate::registers::Registers;

/// The pins of a bus: port, 0 for A, and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct I2cPins {
    /// The clock.
    pub scl: (u8, u8),
    /// Data.
    pub sda: (u8, u8),
}

/// Reason why a transfer has ended early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum I2cFault {
    /// A line that this bus has released stays low.
    Stuck,
    /// A part does not acknowledge.
    NoAcknowledge(NoAcknowledgeSource),
}

impl Error for I2cFault {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Stuck => ErrorKind::Bus,
            Self::NoAcknowledge(source) => ErrorKind::NoAcknowledge(*source),
        }
    }
}

/// Halves of a period that the clock may be held low by a part: 1 ms at 100 kHz.
const MAX_HELD: u32 = 200;

/// Clocks after which a part that was interrupted inside a byte has released SDA: eight bits and
/// the acknowledge.
const FREEING_CLOCKS: u32 = 9;

/// The bus. The caller has set its pins up: open drain, released.
#[derive(Debug)]
pub struct SoftwareI2c<R, P> {
    registers: R,
    pins: I2cPins,
    pace: P,
    /// The clock stayed low: the rest of a transfer does not wait for it.
    is_stuck: bool,
}

impl<R: Registers, P: BusPace> SoftwareI2c<R, P> {
    /// A bus.
    pub const fn new(registers: R, pins: I2cPins, pace: P) -> Self {
        Self { registers, pins, pace, is_stuck: false }
    }

    fn set(&mut self, (port, number): (u8, u8), released: bool) {
        let bit = 1 << (number & 15);
        self.registers.write(gpio::port(port) + BSRR, if released { bit } else { bit << 16 });
    }

    fn is_high(&mut self, (port, number): (u8, u8)) -> bool {
        self.registers.read(gpio::port(port) + IDR) >> (number & 15) & 1 == 1
    }

    fn pull_clock(&mut self) {
        self.set(self.pins.scl, false);
    }

    /// Sets SDA, lets half of a period pass, releases the clock, waits until it is high, and half
    /// of a period more.
    #[inline(never)]
    fn raise_clock(&mut self, sda: bool) {
        self.set(self.pins.sda, sda);
        self.pace.half_period();
        self.set(self.pins.scl, true);
        let mut looks = if self.is_stuck { 0 } else { MAX_HELD };
        while looks > 0 && !self.is_high(self.pins.scl) {
            self.pace.half_period();
            looks -= 1;
        }
        self.is_stuck |= looks == 0;
        self.pace.half_period();
    }

    /// Sends a bit and returns the level on the line: another's, if this one is 1. The clock is low
    /// before and after.
    #[inline(never)]
    fn bit(&mut self, bit: bool) -> bool {
        self.raise_clock(bit);
        let level = self.is_high(self.pins.sda);
        self.pull_clock();
        level
    }

    /// A start, or a repeated one. The clock is low afterwards.
    fn start(&mut self) {
        self.raise_clock(true);
        self.set(self.pins.sda, false);
        self.pace.half_period();
        self.pull_clock();
    }

    /// A stop, after which the bus is free.
    #[inline(never)]
    fn stop(&mut self) {
        self.pull_clock();
        self.raise_clock(false);
        self.set(self.pins.sda, true);
        self.pace.half_period();
    }

    /// Sees that both lines are high. A part that was reading when this chip was reset still sends
    /// its byte: it gets clocks until SDA is high, and then, before the clock falls and its next
    /// bit may be low, a start, which ends its transfer.
    fn free(&mut self) -> bool {
        self.is_stuck = false;
        self.raise_clock(true);
        let mut clocks = 0;
        while clocks < FREEING_CLOCKS && !self.is_high(self.pins.sda) {
            self.pull_clock();
            self.raise_clock(true);
            clocks += 1;
        }
        if clocks > 0 {
            self.set(self.pins.sda, false);
            self.pace.half_period();
            self.stop();
        }
        !self.is_stuck && self.is_high(self.pins.sda)
    }

    /// Exchanges a byte, the highest bit first, and the acknowledge after it; returns both. Ones
    /// leave the line to a part.
    #[inline(never)]
    fn byte(&mut self, sent: u8, acknowledge: bool) -> (u8, bool) {
        let mut received = 0;
        for place in (0..8).rev() {
            received = received << 1 | u8::from(self.bit(sent >> place & 1 == 1));
        }
        (received, !self.bit(!acknowledge))
    }

    /// Sends a byte; `false` without an acknowledge.
    fn send(&mut self, byte: u8) -> bool {
        self.byte(byte, false).1
    }

    fn operate(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), NoAcknowledgeSource> {
        let mut direction = None;
        let mut operations = operations.iter_mut().peekable();
        while let Some(operation) = operations.next() {
            let reads = matches!(operation, Operation::Read(_));
            if direction != Some(reads) {
                direction = Some(reads);
                self.start();
                if !self.send(address << 1 | u8::from(reads)) {
                    return Err(NoAcknowledgeSource::Address);
                }
            }
            let goes_on = matches!(operations.peek(), Some(Operation::Read(_)));
            match operation {
                Operation::Read(bytes) => {
                    let mut left = bytes.len();
                    for byte in bytes.iter_mut() {
                        left = left.saturating_sub(1);
                        (*byte, _) = self.byte(0xff, goes_on || left > 0);
                    }
                }
                Operation::Write(bytes) => {
                    if !bytes.iter().all(|byte| self.send(*byte)) {
                        return Err(NoAcknowledgeSource::Data);
                    }
                }
            }
        }
        Ok(())
    }
}

impl<R, P> ErrorType for SoftwareI2c<R, P> {
    type Error = I2cFault;
}

impl<R: Registers, P: BusPace> I2c for SoftwareI2c<R, P> {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), I2cFault> {
        if !self.free() {
            return Err(I2cFault::Stuck);
        }
        let operated = self.operate(address, operations);
        self.stop();
        if self.is_stuck { Err(I2cFault::Stuck) } else { operated.map_err(I2cFault::NoAcknowledge) }
    }
}

#[cfg(test)]
mod tests;
