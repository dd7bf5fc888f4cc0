//! Sectors of the chip's own flash as a memory that is written while the program runs.
//!
//! The chip has one bank: while it erases or writes, every fetch of an instruction waits, so the
//! processor is stopped, interrupts included. A word takes 16 us, at most 100 us; a sector of 128
//! KiB 1 s, at most 2 s (DS8626, flash memory, program parallelism of 32 bits, which the supply
//! allows: [`crate::brown_out`]). The watchdog waits longer meanwhile. The caller sees to it that
//! nothing moves and nothing heats.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

use ferrostep_register_address::register;

use crate::registers::Registers;
use crate::watchdog;

/// Length of the sectors that may be used, bytes: all but the first five of a chip
/// (RM0090, table 5).
pub const SECTOR_BYTES: usize = 128 * 1024;

/// First address of flash.
const FLASH: u32 = 0x0800_0000;

// RM0090, 3.9.
const ACR: u32 = register!(FLASH.acr);
const KEYR: u32 = register!(FLASH.keyr);
const SR: u32 = register!(FLASH.sr);
const CR: u32 = register!(FLASH.cr);
const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
const CACHES_ON: u32 = 1 << 9 | 1 << 10;
const CACHES_EMPTY: u32 = 1 << 11 | 1 << 12;
const BUSY: u32 = 1 << 16;
/// Operation, protection, alignment, parallelism, sequence; a one clears each.
const ERRORS: u32 = 1 << 1 | 0b1111 << 4;
const PG: u32 = 1 << 0;
const SER: u32 = 1 << 1;
const SECTOR_SHIFT: u32 = 3;
const WORDS: u32 = 0b10 << 8;
const STRT: u32 = 1 << 16;
const LOCK: u32 = 1 << 31;

/// Maximum number of looks at the flag: some seconds, during most of which the core is stopped.
const MAX_LOOKS: u32 = 50_000_000;

/// The flash has not executed a request, or would not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashError;

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl From<FlashError> for &'static str {
    fn from(_: FlashError) -> Self {
        "the memory for settings does not work"
    }
}

impl From<NorFlashErrorKind> for FlashError {
    fn from(_: NorFlashErrorKind) -> Self {
        Self
    }
}

/// `SECTORS` sectors of 128 KiB, addressed from the start of the first: `OFFSET` bytes from the
/// start of the flash, a multiple of [`SECTOR_BYTES`] above 0.
#[derive(Debug)]
pub struct SectorFlash<R, const OFFSET: u32, const SECTORS: usize> {
    registers: R,
}

impl<R: Registers, const OFFSET: u32, const SECTORS: usize> SectorFlash<R, OFFSET, SECTORS> {
    const IS_POSSIBLE: () = assert!(OFFSET > 0 && OFFSET.is_multiple_of(SECTOR_BYTES as u32));

    /// The sectors, by these registers.
    pub const fn new(registers: R) -> Self {
        let () = Self::IS_POSSIBLE;
        Self { registers }
    }

    fn address(offset: u32) -> u32 {
        (FLASH + OFFSET).wrapping_add(offset)
    }

    /// Unlocks the flash, acts, and locks it again. An error if the flash is busy, stays
    /// locked or reports one.
    fn unlocked(&mut self, act: impl FnOnce(&mut R) -> bool) -> Result<(), FlashError> {
        let registers = &mut self.registers;
        if !registers.comes_to(SR, BUSY, false, MAX_LOOKS) {
            return Err(FlashError);
        }
        if registers.read(CR) & LOCK != 0 {
            for key in KEYS {
                registers.write(KEYR, key);
            }
        }
        // Still locked: stores would have no effect.
        if registers.read(CR) & LOCK != 0 {
            return Err(FlashError);
        }
        registers.write(SR, ERRORS);
        let is_done = act(registers);
        let is_right = registers.read(SR) & ERRORS == 0;
        registers.write(CR, LOCK);
        // The caches may hold earlier contents (RM0090, 3.5.4: data cache). They are emptied
        // while they are off.
        let caches = registers.read(ACR) & CACHES_ON;
        registers.modify(ACR, CACHES_ON, 0);
        registers.modify(ACR, 0, CACHES_EMPTY);
        registers.modify(ACR, CACHES_EMPTY, 0);
        registers.modify(ACR, 0, caches);
        if is_done && is_right { Ok(()) } else { Err(FlashError) }
    }
}

impl<R, const OFFSET: u32, const SECTORS: usize> ErrorType for SectorFlash<R, OFFSET, SECTORS> {
    type Error = FlashError;
}

impl<R: Registers, const OFFSET: u32, const SECTORS: usize> ReadNorFlash for SectorFlash<R, OFFSET, SECTORS> {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check_read(self, offset, bytes.len())?;
        for (address, word) in (Self::address(offset)..).step_by(4).zip(bytes.chunks_mut(4)) {
            let read = self.registers.read(address).to_le_bytes();
            word.iter_mut().zip(read).for_each(|(byte, read)| *byte = read);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        SECTOR_BYTES * SECTORS
    }
}

impl<R: Registers, const OFFSET: u32, const SECTORS: usize> NorFlash for SectorFlash<R, OFFSET, SECTORS> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check_erase(self, from, to)?;
        for start in (from..to).step_by(SECTOR_BYTES) {
            // Sectors 0 to 4 have 128 KiB together.
            let number = OFFSET.wrapping_add(start) / SECTOR_BYTES as u32 + 4;
            self.unlocked(|registers| {
                watchdog::wait_longer(registers);
                let erase = SER | WORDS | number << SECTOR_SHIFT;
                registers.write(CR, erase);
                registers.write(CR, erase | STRT);
                let is_done = registers.comes_to(SR, BUSY, false, MAX_LOOKS);
                watchdog::wait_as_usual(registers);
                is_done
            })?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len())?;
        let address = Self::address(offset);
        self.unlocked(|registers| {
            registers.write(CR, PG | WORDS);
            let words = (address..).step_by(4).zip(bytes.as_chunks::<4>().0);
            let mut is_done = true;
            for (address, word) in words {
                registers.write(address, u32::from_le_bytes(*word));
                is_done &= registers.comes_to(SR, BUSY, false, MAX_LOOKS);
            }
            is_done
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::collections::BTreeMap;

    use super::*;
    use crate::registers::recorder::Recorder;

    const SECTOR_10: u32 = 0xc_0000;

    /// A flash with its lock and its caches, and a watchdog; `looks` until it is no longer busy.
    #[derive(Default)]
    struct Chip {
        recorder: Recorder,
        cells: BTreeMap<u32, u32>,
        keys: Vec<u32>,
        looks: u32,
        erased: Vec<u32>,
        /// True while a cache would return old contents.
        stale: bool,
        is_dead: bool,
        reload_in_erasure: Vec<u32>,
    }

    impl Registers for Chip {
        fn read(&mut self, address: u32) -> u32 {
            match address {
                FLASH..0x0810_0000 => {
                    assert!(!self.stale, "{address:#x} is read through a cache that has older content");
                    self.cells.get(&address).copied().unwrap_or(u32::MAX)
                }
                SR if self.looks > 0 => {
                    self.looks -= 1;
                    BUSY
                }
                CR if self.keys != KEYS => LOCK,
                _ => self.recorder.read(address),
            }
        }

        fn write(&mut self, address: u32, value: u32) {
            let control = self.recorder.value(CR);
            match address {
                KEYR if !self.is_dead => {
                    self.keys.push(value);
                    if self.keys == KEYS {
                        self.recorder.write(CR, control & !LOCK);
                    }
                }
                KEYR => {}
                CR if self.keys != KEYS => {}
                CR => {
                    if value & LOCK != 0 {
                        self.keys.clear();
                    }
                    if value & STRT != 0 {
                        assert_eq!(control, value & !STRT, "the sector is chosen before the start");
                        let sector = value >> SECTOR_SHIFT & 0xf;
                        self.erased.push(sector);
                        let start = FLASH + (sector - 4) * SECTOR_BYTES as u32;
                        self.cells.retain(|cell, _| !(start..start + SECTOR_BYTES as u32).contains(cell));
                        self.looks = 1000;
                        self.stale = true;
                        self.reload_in_erasure.push(self.recorder.value(0x4000_3008));
                    }
                    self.recorder.write(address, value & !STRT);
                }
                FLASH..0x0810_0000 => {
                    assert_eq!(control & (PG | WORDS), PG | WORDS, "{address:#x}");
                    assert_eq!(self.looks, 0, "the flash is busy");
                    *self.cells.entry(address).or_insert(u32::MAX) &= value;
                    self.looks = 20;
                    self.stale = true;
                }
                ACR => {
                    if value & (CACHES_EMPTY | CACHES_ON) == CACHES_EMPTY {
                        self.stale = false;
                    }
                    self.recorder.write(address, value);
                }
                SR => {}
                _ => self.recorder.write(address, value),
            }
        }
    }

    fn flash() -> SectorFlash<Chip, SECTOR_10, 2> {
        let recorder = Recorder::default().with(ACR, 5 | 1 << 8 | CACHES_ON);
        SectorFlash::new(Chip { recorder, ..Chip::default() })
    }

    #[test]
    fn what_is_written_is_read_and_the_flash_is_locked_again() {
        let mut flash = flash();
        flash.erase(0, SECTOR_BYTES as u32).unwrap();
        flash.erase(SECTOR_BYTES as u32, 2 * SECTOR_BYTES as u32).unwrap();
        assert_eq!(flash.registers.erased, [10, 11]);
        flash.write(0x2_0400, &[1, 2, 3, 4, 5, 6, 7, 8]).unwrap();
        assert_eq!(flash.registers.cells, BTreeMap::from([(0x080e_0400, 0x0403_0201), (0x080e_0404, 0x0807_0605)]));
        let mut read = [0; 12];
        flash.read(0x2_03fc, &mut read).unwrap();
        assert_eq!(read, [255, 255, 255, 255, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(flash.registers.recorder.value(CR), LOCK);
        assert_eq!(flash.registers.recorder.value(ACR), 5 | 1 << 8 | CACHES_ON, "wait states and caches as before");
        flash.erase(0, 2 * SECTOR_BYTES as u32).unwrap();
        assert!(flash.registers.cells.is_empty());
    }

    /// An erasure takes longer than the watchdog waits as a rule.
    #[test]
    fn the_watchdog_waits_longer_while_a_sector_is_erased() {
        let mut flash = flash();
        flash.erase(0, SECTOR_BYTES as u32).unwrap();
        let reload = flash.registers.reload_in_erasure[0];
        assert!((reload + 1) * 64 / 47 >= 4000, "at least 4 s, with the fastest oscillator");
        assert_eq!(flash.registers.recorder.value(0x4000_3008), 499);
        assert_eq!(flash.registers.recorder.stored(0x4000_3000).last(), Some(&0xaaaa));
    }

    #[test]
    fn a_flash_that_refuses_is_an_error_and_stays_locked() {
        let mut dead = flash();
        dead.registers.is_dead = true;
        assert_eq!(dead.erase(0, SECTOR_BYTES as u32), Err(FlashError));
        assert_eq!(dead.write(0, &[0; 4]), Err(FlashError));
        assert!(dead.registers.erased.is_empty() && dead.registers.cells.is_empty());
        let mut protected = flash();
        protected.registers.recorder.fix(SR, 1 << 4);
        assert_eq!(protected.write(0, &[0; 4]), Err(FlashError));
        assert_eq!(protected.registers.recorder.value(CR), LOCK);
    }

    /// The program is never erased or written, whatever is asked.
    #[test]
    fn nothing_outside_the_sectors_is_touched() {
        let mut flash = flash();
        let sector = SECTOR_BYTES as u32;
        for (from, to) in [(0, 3 * sector), (2 * sector, 3 * sector), (4, sector), (sector, 0), (0, u32::MAX)] {
            assert_eq!(flash.erase(from, to), Err(FlashError), "{from:#x} to {to:#x}");
        }
        for (offset, length) in [(2 * sector, 4), (2 * sector - 4, 8), (2, 4), (0, 3), (u32::MAX - 3, 8)] {
            assert_eq!(flash.write(offset, &vec![0; length]), Err(FlashError), "{offset:#x}");
            assert_eq!(flash.read(offset, &mut vec![0; length]), Err(FlashError), "{offset:#x}");
        }
        assert!(flash.registers.erased.is_empty() && flash.registers.cells.is_empty());
    }
}
