//! A NOR flash in memory: the virtual board's, and one that loses its power in tests.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

use crate::store::NOT_WORKING;

/// Bytes of a word, as an STM32F4 writes it.
const WORD_BYTES: usize = 4;

/// Time of a power cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// Words and erasures completed before the cut.
    pub operations: u32,
    /// If set, the operation during which the power fails is half done, with this seed: of a word
    /// some bits are written; of a sector some words are erased, others in part or not at all, or
    /// are zero, since a chip may write zeros first.
    pub half: Option<u32>,
}

/// The power is off, or the requested words do not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PowerIsOff;

impl NorFlashError for PowerIsOff {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl From<PowerIsOff> for &'static str {
    fn from(_: PowerIsOff) -> Self {
        NOT_WORKING
    }
}

impl From<NorFlashErrorKind> for PowerIsOff {
    fn from(_: NorFlashErrorKind) -> Self {
        Self
    }
}

/// A NOR flash with sectors of `SECTOR` bytes.
#[derive(Clone, Debug)]
pub struct MemoryFlash<B, const SECTOR: usize> {
    bytes: B,
    cut: Option<Cut>,
    operations: u32,
    erasures: u32,
}

impl<B: AsRef<[u8]> + AsMut<[u8]>, const SECTOR: usize> MemoryFlash<B, SECTOR> {
    /// A flash that contains these bytes, 0xff where it is erased.
    pub fn new(bytes: B) -> Self {
        Self { bytes, cut: None, operations: 0, erasures: 0 }
    }

    /// Cuts the power.
    #[must_use]
    pub fn with_cut(self, cut: Cut) -> Self {
        Self { cut: Some(cut), ..self }
    }

    /// Words written and sectors erased so far.
    pub fn operations(&self) -> u32 {
        self.operations
    }

    /// Sectors erased so far.
    pub fn erasures(&self) -> u32 {
        self.erasures
    }

    /// Content of the flash.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.as_ref()
    }

    /// Content of the flash, which is dropped.
    pub fn into_bytes(self) -> B {
        self.bytes
    }

    /// Counts an operation; fails at and after the cut, with the seed of a half-done operation.
    fn operate(&mut self) -> Result<(), Option<u32>> {
        match &mut self.cut {
            Some(Cut { operations: 0, half }) => Err(half.take()),
            Some(Cut { operations, .. }) => {
                *operations -= 1;
                self.operations += 1;
                Ok(())
            }
            None => {
                self.operations = self.operations.saturating_add(1);
                Ok(())
            }
        }
    }
}

/// Next pseudo-random number (Marsaglia 2003, xorshift of 32 bits), for what a cut leaves.
pub fn next_random(seed: &mut u32) -> u32 {
    let mut x = (*seed).max(1);
    x ^= x << 13;
    x ^= x >> 17;
    x ^= x << 5;
    *seed = x;
    x
}

impl<B, const SECTOR: usize> ErrorType for MemoryFlash<B, SECTOR> {
    type Error = PowerIsOff;
}

impl<B: AsRef<[u8]> + AsMut<[u8]>, const SECTOR: usize> ReadNorFlash for MemoryFlash<B, SECTOR> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerIsOff> {
        check_read(self, offset, bytes.len())?;
        let from = self.bytes.as_ref().get(offset as usize..).and_then(|rest| rest.get(..bytes.len()));
        bytes.copy_from_slice(from.ok_or(PowerIsOff)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.as_ref().len()
    }
}

impl<B: AsRef<[u8]> + AsMut<[u8]>, const SECTOR: usize> NorFlash for MemoryFlash<B, SECTOR> {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerIsOff> {
        check_erase(self, from, to)?;
        for sector in (from as usize..to as usize).step_by(SECTOR) {
            let operation = self.operate();
            self.erasures = self.erasures.saturating_add(1);
            let end = sector.saturating_add(SECTOR);
            let bytes = self.bytes.as_mut().get_mut(sector..end).ok_or(PowerIsOff)?;
            match operation {
                Ok(()) => bytes.fill(0xff),
                Err(Some(mut seed)) => {
                    for word in bytes.chunks_mut(WORD_BYTES) {
                        match next_random(&mut seed) >> 8 & 3 {
                            0 => word.fill(0xff),
                            1 => word.fill(0),
                            2 => word.iter_mut().for_each(|cell| *cell |= next_random(&mut seed) as u8),
                            _ => {}
                        }
                    }
                    return Err(PowerIsOff);
                }
                Err(None) => return Err(PowerIsOff),
            }
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerIsOff> {
        check_write(self, offset, bytes.len())?;
        for (at, word) in (offset as usize..).step_by(WORD_BYTES).zip(bytes.chunks(WORD_BYTES)) {
            let operation = self.operate();
            let cells = self.bytes.as_mut().get_mut(at..).and_then(|rest| rest.get_mut(..word.len()));
            let cells = cells.ok_or(PowerIsOff)?;
            // Writing can only change bits from 1 to 0.
            match operation {
                Ok(()) => cells.iter_mut().zip(word).for_each(|(cell, byte)| *cell &= byte),
                Err(Some(mut seed)) => {
                    cells.iter_mut().zip(word).for_each(|(cell, byte)| *cell &= byte | next_random(&mut seed) as u8);
                    return Err(PowerIsOff);
                }
                Err(None) => return Err(PowerIsOff),
            }
        }
        Ok(())
    }
}
