//! A 24C32 EEPROM presented as a flash of four sectors, so that settings records are stored in it
//! as in a microcontroller's own flash.
//!
//! 4 KiB in pages of 32 bytes. After a page the EEPROM writes for up to 10 ms (AT24C32 at 2.7 V; 5
//! ms: AT24C32E, 24LC32A, M24C32) and does not acknowledge its address meanwhile; the driver polls
//! it until it does. Erasing a sector writes 0xff to its 32 pages. Nothing depends on how long a
//! write takes, so any task may interrupt this one. Each page lasts 1,000,000 writes (the same data
//! sheets, endurance).
//!
//! A power cut during a page write leaves arbitrary data in the 32 bytes of that page; all other
//! pages keep their contents.
#![cfg_attr(not(test), no_std)]

use embedded_hal::i2c::{Error, ErrorKind, I2c, NoAcknowledgeSource, Operation};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

/// Size of the memory, bytes.
pub const BYTES: usize = 4096;

/// Size of a page, bytes: a single write cannot cross its end.
pub const PAGE_BYTES: usize = 32;

/// Size of a sector, the unit of erasing, bytes: room for one record.
pub const SECTOR_BYTES: usize = 1024;

/// Bus clock, Hz: the slowest for which `MAX_ASKED` is chosen, and the fastest that every 24C32
/// supports at 3.3 V.
pub const BUS_HZ: u32 = 100_000;

/// Maximum number of address polls while the EEPROM does not acknowledge. Each takes at least 10
/// clocks, so together they take twice the time of the longest write.
const MAX_ASKED: u32 = 200;

/// A fault of the EEPROM or of its bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EepromFault {
    /// The EEPROM has not acknowledged its address for longer than a write takes.
    Silent,
    /// The EEPROM does not acknowledge data.
    Protected,
    /// Bus fault: one of the lines stays low.
    Bus,
    /// The address range is outside the memory.
    Place,
}

impl NorFlashError for EepromFault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl From<NorFlashErrorKind> for EepromFault {
    fn from(_: NorFlashErrorKind) -> Self {
        Self::Place
    }
}

impl From<EepromFault> for &'static str {
    fn from(fault: EepromFault) -> Self {
        match fault {
            EepromFault::Silent => "the EEPROM does not answer",
            EepromFault::Protected => "the EEPROM refuses to be written (write-protected?)",
            EepromFault::Bus => "a line of the EEPROM (SCL or SDA) stays low",
            EepromFault::Place => "the EEPROM is too small",
        }
    }
}

/// Driver for the EEPROM.
#[derive(Debug)]
pub struct Eeprom<B> {
    bus: B,
    address: u8,
}

impl<B: I2c> Eeprom<B> {
    /// Creates the driver for an EEPROM at an address from 0x50 to 0x57, on a bus of [`BUS_HZ`] at
    /// most, without any transfer.
    pub const fn new(bus: B, address: u8) -> Self {
        Self { bus, address }
    }

    /// Selects a memory address and runs an operation there; repeats the request until the chip has
    /// finished its last write.
    #[inline(never)]
    fn at(&mut self, place: u32, operation: Operation<'_>) -> Result<(), EepromFault> {
        let [.., high, low] = place.to_be_bytes();
        let place = [high, low];
        let mut operations = [Operation::Write(&place), operation];
        for _ in 0..MAX_ASKED {
            match self.bus.transaction(self.address, &mut operations).map_err(|error| error.kind()) {
                Ok(()) => return Ok(()),
                Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data)) => return Err(EepromFault::Protected),
                Err(ErrorKind::NoAcknowledge(_)) => {}
                Err(_) => return Err(EepromFault::Bus),
            }
        }
        Err(EepromFault::Silent)
    }
}

impl<B> ErrorType for Eeprom<B> {
    type Error = EepromFault;
}

impl<B: I2c> ReadNorFlash for Eeprom<B> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), EepromFault> {
        check_read(self, offset, bytes.len())?;
        if bytes.is_empty() { Ok(()) } else { self.at(offset, Operation::Read(bytes)) }
    }

    fn capacity(&self) -> usize {
        BYTES
    }
}

impl<B: I2c> NorFlash for Eeprom<B> {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), EepromFault> {
        check_erase(self, from, to)?;
        let mut page = from;
        while page < to {
            self.at(page, Operation::Write(&[0xff; PAGE_BYTES]))?;
            page = page.saturating_add(PAGE_BYTES as u32);
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), EepromFault> {
        check_write(self, offset, bytes.len())?;
        let (mut place, mut rest) = (offset, bytes);
        // Page by page; the first part may begin in the middle of a page.
        while !rest.is_empty() {
            let room = PAGE_BYTES - place as usize % PAGE_BYTES;
            let (page, others) = rest.split_at(room.min(rest.len()));
            self.at(place, Operation::Write(page))?;
            place = place.saturating_add(room as u32);
            rest = others;
        }
        Ok(())
    }
}
