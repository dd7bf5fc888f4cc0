//! The first stores of an image: they restore the chip's state after reset, whatever a boot
//! loader has changed.
//!
//! Addresses: RM0090 7.3 (RCC), 12.3 (EXTI), 2.3; RM0390 6.3, 10.3, 2.2. The clock's own registers
//! follow in `init` (`hal-shim/stm32f4/src/clock_setup.rs`), for they are waited for; so does the
//! power control, which must not be reset while a loader's PLL runs. The backup domain and the
//! flags that say why the chip was reset are left alone.

use ferrostep_register_address::register;

use crate::chip::Chip;
use crate::store::Store;

/// Resets of the parts of AHB1, AHB2, AHB3, APB1 and APB2.
const RESETS: [u32; 5] = [
    register!(RCC.ahb1rstr),
    register!(RCC.ahb2rstr),
    register!(RCC.ahb3rstr),
    register!(RCC.apb1rstr),
    register!(RCC.apb2rstr),
];

/// Clocks of the same buses' parts.
const CLOCKS: [u32; 5] = [
    register!(RCC.ahb1enr),
    register!(RCC.ahb2enr),
    register!(RCC.ahb3enr),
    register!(RCC.apb1enr),
    register!(RCC.apb2enr),
];

/// Clocks of the same buses' parts while the core sleeps.
const CLOCKS_IN_SLEEP: [u32; 5] = [
    register!(RCC.ahb1lpenr),
    register!(RCC.ahb2lpenr),
    register!(RCC.ahb3lpenr),
    register!(RCC.apb1lpenr),
    register!(RCC.apb2lpenr),
];

/// Clock of the core-coupled memory (bit 20 of RCC_AHB1ENR), on after reset.
const AHB1ENR_AT_RESET: u32 = 1 << 20;

const EXTI_SETTINGS: [u32; 4] = [register!(EXTI.imr), register!(EXTI.emr), register!(EXTI.rtsr), register!(EXTI.ftsr)];
const EXTI_PR: u32 = register!(EXTI.pr);
/// Lines 0 to 22.
const EXTI_LINES: u32 = 0x007f_ffff;

/// All parts but the ports and the power control as after reset, and the ports' clocks on
/// (`ports`, a mask).
pub fn as_after_reset(chip: Chip, ports: u32) -> Vec<Store> {
    let mut stores = Vec::new();
    for (reset, parts) in RESETS.into_iter().zip(chip.buses.parts) {
        stores.extend([parts, 0].map(|word| Store::word(reset, word)));
    }
    let on = [AHB1ENR_AT_RESET | ports, 0, 0, 0, 0];
    let clocks = CLOCKS.into_iter().zip(on);
    for ((clocks, on), (in_sleep, parts)) in clocks.zip(CLOCKS_IN_SLEEP.into_iter().zip(chip.buses.in_sleep)) {
        stores.push(Store::word(clocks, on));
        stores.push(Store::word(in_sleep, parts));
    }
    // No bit of the RCC resets these registers.
    stores.extend(EXTI_SETTINGS.map(|setting| Store::word(setting, 0)));
    stores.push(Store::word(EXTI_PR, EXTI_LINES));
    stores
}
