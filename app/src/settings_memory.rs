//! The memory for settings, on a board that has one.

use core::cell::RefCell;
use core::fmt;

use ferrostep_printer::SettingsMemory;
use ferrostep_settings::{Slot, Store, StoreError};
use ferrostep_stm32f4_board::pac::FLASH;
use ferrostep_stm32f4_board::settings_memory::sectors;

/// The sectors of the chip's flash.
pub struct BoardSettings(pub RefCell<FLASH>);

impl fmt::Debug for BoardSettings {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardSettings")
    }
}

impl SettingsMemory for BoardSettings {
    fn load<'s>(&self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError> {
        Store::new(sectors(&mut self.0.borrow_mut()))?.load(slot)
    }

    fn save(&self, record: &[u8]) -> Result<(), StoreError> {
        Store::new(sectors(&mut self.0.borrow_mut()))?.save(record)
    }

    fn stalls(&self) -> bool {
        true
    }
}
