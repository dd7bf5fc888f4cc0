//! The modelled chips and their packages.
//!
//! Sources: data sheets of the STM32F405xx/F407xx (DS8626, table 2 and the pin table 7) and of the
//! STM32F446xC/E (DS10693, table 2 and the pin table 10).

use crate::pins::Pin;

/// A chip with its package: the last two letters of its name are pins and flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Chip {
    /// STM32F405RG: LQFP64, 1 MiB.
    F405,
    /// STM32F407VG: LQFP100, 1 MiB.
    F407,
    /// STM32F446ZE: LQFP144, 512 KiB.
    F446,
}

impl Chip {
    /// All modelled chips.
    pub const ALL: [Self; 3] = [Self::F405, Self::F407, Self::F446];

    /// The name in a board's file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::F405 => "STM32F405RG",
            Self::F407 => "STM32F407VG",
            Self::F446 => "STM32F446ZE",
        }
    }

    /// The package.
    #[must_use]
    pub fn package(self) -> &'static str {
        match self {
            Self::F405 => "LQFP64",
            Self::F407 => "LQFP100",
            Self::F446 => "LQFP144",
        }
    }

    /// Flash, KiB.
    #[must_use]
    pub fn flash_kib(self) -> u32 {
        match self {
            Self::F405 | Self::F407 => 1024,
            Self::F446 => 512,
        }
    }

    /// SRAM1 and SRAM2 together, from 0x2000_0000 on, KiB.
    #[must_use]
    pub fn ram_kib(self) -> u32 {
        128
    }

    /// Core coupled memory from 0x1000_0000 on, KiB; 0 on the F446.
    #[must_use]
    pub fn ccm_kib(self) -> u32 {
        match self {
            Self::F405 | Self::F407 => 64,
            Self::F446 => 0,
        }
    }

    /// True if the package has this pin. Every package has PH0 and PH1, which carry the crystal.
    #[must_use]
    pub fn has_pin(self, pin: Pin) -> bool {
        match (char::from(b'A'.saturating_add(pin.port)), self) {
            ('A' | 'B' | 'C', _) => pin.number <= 15,
            ('D', Self::F405) => pin.number == 2,
            ('D' | 'E', Self::F407 | Self::F446) | ('F' | 'G', Self::F446) => pin.number <= 15,
            ('H', _) => pin.number <= 1,
            _ => false,
        }
    }
}
