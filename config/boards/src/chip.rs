//! The chips: memories, pins, limits of their clocks.

use ferrostep_stm32f4::ChipFamily;

use crate::pin::Pin;

/// A chip that the firmware can be built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chip {
    /// The chip's name.
    pub name: &'static str,
    /// The chip's package.
    pub package: &'static str,
    /// The firmware's feature for its registers.
    pub feature: &'static str,
    /// The chip's name in probe-rs.
    pub probe_name: &'static str,
    /// Flash, KiB.
    pub flash_kib: u32,
    /// RAM that everything can reach, KiB.
    pub ram_kib: u32,
    /// Core-coupled memory, which DMA cannot reach, KiB.
    pub ccm_kib: u32,
    /// Highest frequency of the core without over-drive, Hz.
    pub max_core_hz: u32,
    /// Highest frequency of the slow bus (APB1), Hz.
    pub max_apb1_hz: u32,
    /// Highest frequency of the fast bus (APB2), Hz.
    pub max_apb2_hz: u32,
    /// Family of the chip, by its registers.
    pub family: ChipFamily,
    /// Peripherals on its buses.
    pub buses: Buses,
    /// Words of 32 interrupts that its interrupt controller has.
    pub interrupt_words: u32,
    /// Pins of the ports A, B ... as masks.
    ports: [u16; 7],
}

/// Peripherals on a chip's buses, as masks of the registers of AHB1, AHB2, AHB3, APB1 and APB2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Buses {
    /// Parts that are reset: all but the ports, whose pins hold heaters and motors off, and the
    /// power control (bit 28 of RCC_APB1RSTR).
    pub parts: [u32; 5],
    /// Clocks that keep running while the core sleeps, as after reset. Without its timer's clock
    /// the steps would end with the first `wfi`.
    pub in_sleep: [u32; 5],
}

impl Buses {
    /// STM32F405 and STM32F407 (RM0090 7.3.5 to 7.3.9 and 7.3.15 to 7.3.19). The bits
    /// of peripherals that an STM32F405 lacks (Ethernet, camera) are reserved there:
    /// writes have no effect.
    pub const F405: Self = Self {
        parts: [0x2260_1000, 0x0000_00f1, 0x1, 0x26fe_c9ff, 0x0007_5933],
        in_sleep: [0x7e67_91ff, 0x0000_00f1, 0x1, 0x36fe_c9ff, 0x0007_5f33],
    };

    /// STM32F446 (RM0390 6.3.5 to 6.3.9 and 6.3.15 to 6.3.19).
    pub const F446: Self = Self {
        parts: [0x2060_1000, 0x0000_0081, 0x3, 0x2fff_c9ff, 0x00c7_7933],
        in_sleep: [0x6067_90ff, 0x0000_0081, 0x3, 0x3fff_c9ff, 0x00c7_7f33],
    };
}

const F405RG: Chip = Chip {
    name: "STM32F405RG",
    package: "LQFP64",
    feature: "stm32f405",
    probe_name: "STM32F405RGTx",
    flash_kib: 1024,
    ram_kib: 128,
    ccm_kib: 64,
    max_core_hz: 168_000_000,
    max_apb1_hz: 42_000_000,
    max_apb2_hz: 84_000_000,
    family: ChipFamily::F405,
    buses: Buses::F405,
    interrupt_words: 3,
    ports: [0xffff, 0xffff, 0xffff, 1 << 2, 0, 0, 0],
};

/// All chips.
///
/// Pins: DS8626, table 7 (LQFP64, LQFP100), and DS10693, table 10 (LQFP144). PH0 and PH1 are left
/// out: they carry the crystal. Clocks: RM0090 7.2 and DS8626, table 14; RM0390 5.1.4 and 6.2: 168
/// MHz without over-drive.
const CHIPS: [Chip; 3] = [
    F405RG,
    // The same die with more pins.
    Chip {
        name: "STM32F407VG",
        package: "LQFP100",
        feature: "stm32f407",
        probe_name: "STM32F407VGTx",
        ports: [0xffff, 0xffff, 0xffff, 0xffff, 0xffff, 0, 0],
        ..F405RG
    },
    Chip {
        name: "STM32F446ZE",
        package: "LQFP144",
        feature: "stm32f446",
        probe_name: "STM32F446ZETx",
        flash_kib: 512,
        ram_kib: 128,
        ccm_kib: 0,
        max_core_hz: 168_000_000,
        max_apb1_hz: 45_000_000,
        max_apb2_hz: 90_000_000,
        family: ChipFamily::F446,
        buses: Buses::F446,
        interrupt_words: 4,
        ports: [0xffff; 7],
    },
];

impl Chip {
    /// All chips.
    pub(crate) const ALL: [Self; 3] = CHIPS;

    /// Returns true if the package brings this pin out, for other uses than the crystal.
    pub fn has(self, pin: Pin) -> bool {
        self.ports.get(usize::from(pin.port)).is_some_and(|pins| pins >> pin.number & 1 == 1)
    }

    /// Returns true if a flash sector begins at `offset`, bytes from the start: four of 16 KiB, one
    /// of 64 KiB, the rest of 128 KiB (RM0090 table 5, RM0390 table 4).
    pub fn is_sector_boundary(self, offset: u32) -> bool {
        const KIB: u32 = 1024;
        let step = if offset <= 64 * KIB { 16 * KIB } else { 128 * KIB };
        offset.is_multiple_of(step) && offset < self.flash_kib * KIB
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_grow() {
        for chip in CHIPS {
            let boundaries: Vec<u32> = (0..2048).filter(|kib| chip.is_sector_boundary(kib * 1024)).collect();
            assert_eq!(boundaries[..7], [0, 16, 32, 48, 64, 128, 256]);
            assert_eq!(boundaries.last().copied(), Some(chip.flash_kib - 128));
            assert!(!chip.is_sector_boundary(1));
        }
    }
}
