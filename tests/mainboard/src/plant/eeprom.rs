//! The EEPROM on its two wires, which resistors pull high.

use serde::{Deserialize, Serialize};

use crate::parts::at24c32::At24c32;

/// A wire to the EEPROM.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum EepromWire {
    Clock,
    Data,
}

/// The EEPROM.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct WiredEeprom {
    /// The chip.
    pub chip: At24c32,
}

impl WiredEeprom {
    /// At rest.
    pub(super) fn new(chip: At24c32) -> Self {
        Self { chip }
    }

    /// Level to which the chip pulls SDA: low, or `None`.
    pub(super) fn sda(&self) -> Option<bool> {
        self.chip.pulls_sda().then_some(false)
    }

    /// The level that a pin asks for; true if the chip's end of SDA changed. The pins are open
    /// drain: high is released.
    pub(super) fn set_wire(&mut self, now_ns: u64, wire: EepromWire, level: Option<bool>) -> bool {
        let before = self.sda();
        match wire {
            EepromWire::Clock => self.chip.set_scl(now_ns, level.unwrap_or(true)),
            EepromWire::Data => self.chip.set_sda(now_ns, level.unwrap_or(true)),
        }
        self.sda() != before
    }
}
