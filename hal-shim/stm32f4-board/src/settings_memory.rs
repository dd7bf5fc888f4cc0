//! The sectors of the chip's flash in which settings are kept.

use ferrostep_stm32f4::sector_flash::{SECTOR_BYTES, SectorFlash};

use crate::board::SETTINGS;
use crate::pac::FLASH;
use crate::volatile::Volatile;

/// Their bytes.
pub const BYTES: u32 = SETTINGS[1];

/// The sectors, as [`start`] gives them.
pub type Sectors = SectorFlash<Volatile>;

/// The sectors at the end of the flash; the image does not reach there (`memory.x`).
pub fn start(_flash: FLASH) -> Sectors {
    // SAFETY: registers of the flash, which are the caller's, and words of sectors that the linker gives to nothing. Besides, the
    // watchdog's reload value, which is set as before when an erasure ends: a task that feeds it meanwhile changes nothing.
    let registers = unsafe { Volatile::new() };
    SectorFlash::new(registers, SETTINGS[0], BYTES / SECTOR_BYTES as u32)
}
