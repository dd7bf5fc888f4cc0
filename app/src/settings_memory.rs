//! The memory for settings, on a board that has one.

#[cfg(eeprom)]
mod eeprom;
#[cfg(not(eeprom))]
mod sectors;

#[cfg(eeprom)]
pub use eeprom::MEMORY;
#[cfg(not(eeprom))]
pub use sectors::MEMORY;
