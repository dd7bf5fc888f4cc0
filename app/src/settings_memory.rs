//! Memory for settings, on boards that have one.

#[cfg(eeprom)]
mod eeprom;
#[cfg(not(eeprom))]
mod sectors;

#[cfg(eeprom)]
pub use eeprom::MEMORY;
#[cfg(not(eeprom))]
pub use sectors::MEMORY;
