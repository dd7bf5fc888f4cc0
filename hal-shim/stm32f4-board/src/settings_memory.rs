//! The flash sectors in which settings are kept, on boards that have some.

use ferrostep_stm32f4::sector_flash::{SECTOR_BYTES, SectorFlash};

use crate::board::SETTINGS;
use crate::pac::FLASH;
use crate::volatile::Volatile;

/// The sectors at the end of the flash.
pub type Sectors = SectorFlash<Volatile, { SETTINGS[0] }, { SETTINGS[1] as usize / SECTOR_BYTES }>;

/// Takes the registers of the flash for [`sectors`], when the clock and the options are set.
pub fn start(_flash: FLASH) {}

/// The sectors, which no image reaches (`memory.x`). For one task.
pub fn sectors() -> Sectors {
    // SAFETY: registers of the flash, which `start` has taken, so that no other code has them, and
    // words of sectors that the linker leaves free. Besides, the watchdog's reload value, which is
    // as before when an erasure ends: a task that feeds it meanwhile does not change it.
    SectorFlash::new(unsafe { Volatile::new() })
}
