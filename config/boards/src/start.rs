//! The first stores of an image: they restore the chip's state after reset, whatever a boot
//! loader has changed.
//!
//! Addresses: RM0090 7.3 (RCC), 12.3 (EXTI), 2.3; RM0390 6.3, 10.3, 2.2. The clock's own registers
//! follow in `init` (`hal-shim/stm32f4/src/clock_setup.rs`), for they are waited for; so does the
//! power control, which must not be reset while a loader's PLL runs. The backup domain and the
//! flags that say why the chip was reset are left alone.

use ferrostep_stm32f4::rcc::RCC;

use crate::chip::Chip;
use crate::store::Store;

/// AHB1, AHB2, AHB3, APB1, APB2: each register of a kind has one for each of them.
const BUS_OFFSETS: [u32; 5] = [0x00, 0x04, 0x08, 0x10, 0x14];

/// Resets of the buses' parts, their clocks, and their clocks while the core sleeps.
const RSTR: u32 = RCC + 0x10;
const ENR: u32 = RCC + 0x30;
const LPENR: u32 = RCC + 0x50;

/// Clock of the core-coupled memory (bit 20 of RCC_AHB1ENR), on after reset.
const AHB1ENR_AT_RESET: u32 = 1 << 20;

const EXTI: u32 = 0x4001_3c00;
/// IMR, EMR, RTSR, FTSR.
const EXTI_SETTINGS: [u32; 4] = [0x00, 0x04, 0x08, 0x0c];
const EXTI_PR: u32 = EXTI + 0x14;
/// Lines 0 to 22.
const EXTI_LINES: u32 = 0x007f_ffff;

/// All parts but the ports and the power control as after reset, and the ports' clocks on
/// (`ports`, a mask).
pub fn as_after_reset(chip: Chip, ports: u32) -> Vec<Store> {
    let mut stores = Vec::new();
    for (offset, parts) in BUS_OFFSETS.into_iter().zip(chip.buses.parts) {
        stores.extend([parts, 0].map(|word| Store::word(RSTR + offset, word)));
    }
    let clocks = [AHB1ENR_AT_RESET | ports, 0, 0, 0, 0];
    for ((offset, clocks), in_sleep) in BUS_OFFSETS.into_iter().zip(clocks).zip(chip.buses.in_sleep) {
        stores.push(Store::word(ENR + offset, clocks));
        stores.push(Store::word(LPENR + offset, in_sleep));
    }
    // No bit of the RCC resets these registers.
    stores.extend(EXTI_SETTINGS.map(|offset| Store::word(EXTI + offset, 0)));
    stores.push(Store::word(EXTI_PR, EXTI_LINES));
    stores
}
