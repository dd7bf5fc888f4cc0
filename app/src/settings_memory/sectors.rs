//! Settings in the chip's own flash.

use core::fmt;

use ferrostep_printer::SettingsMemory;
use ferrostep_settings::{Slot, Store, StoreError};
use ferrostep_stm32f4_board::settings_memory::sectors;

/// The sectors of the chip's flash, for the printer task.
pub static MEMORY: BoardSettings = BoardSettings(());

/// Settings memory, see [`MEMORY`]. The value takes no RAM.
pub struct BoardSettings(());

impl fmt::Debug for BoardSettings {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardSettings")
    }
}

impl SettingsMemory for BoardSettings {
    fn load<'s>(&self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError> {
        Store::new(sectors())?.load(slot)
    }

    fn save(&self, record: &[u8]) -> Result<(), StoreError> {
        Store::new(sectors())?.save(record)
    }

    fn stalls(&self) -> bool {
        true
    }
}
