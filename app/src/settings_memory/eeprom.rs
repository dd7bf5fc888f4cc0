//! Settings in an EEPROM on the board.

use core::fmt;

use ferrostep_eeprom::Eeprom;
use ferrostep_printer::SettingsMemory;
use ferrostep_settings::{Slot, Store, StoreError};
use ferrostep_stm32f4_board::board::EEPROM;
use ferrostep_stm32f4_board::eeprom::{self, Bus};

/// The EEPROM, for the printer task.
pub static MEMORY: BoardSettings = BoardSettings(());

/// Settings memory, see [`MEMORY`]. The value takes no RAM.
pub struct BoardSettings(());

impl fmt::Debug for BoardSettings {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BoardSettings")
    }
}

fn store() -> Result<Store<Eeprom<Bus>>, StoreError> {
    // The build compiles this only for boards with an EEPROM.
    let (pins, address) = EEPROM.ok_or(StoreError::Sectors)?;
    Store::new(Eeprom::new(eeprom::start(pins), address))
}

impl SettingsMemory for BoardSettings {
    fn load<'s>(&self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError> {
        store()?.load(slot)
    }

    fn save(&self, record: &[u8]) -> Result<(), StoreError> {
        store()?.save(record)
    }

    /// Returns false: any task above the printer's runs during a write.
    fn stalls(&self) -> bool {
        false
    }
}
