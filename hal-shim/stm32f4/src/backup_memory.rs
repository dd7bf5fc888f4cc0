//! The backup SRAM: 4 KiB that no reset clears (RM0090 5.1.2, RM0390 5.1.2). Without supply it
//! keeps its contents only where a battery is at VBAT.

use ferrostep_register_address::register;

use crate::rcc::{POWER_CLOCK, RCC_AHB1ENR, RCC_APB1ENR};
use crate::registers::Registers;

/// First address (RM0090 2.3, table 1); the register description names no memory.
pub const BACKUP_MEMORY: u32 = 0x4002_4000;

/// The memory's clock, in RCC_AHB1ENR (RM0090 7.3.10).
const BACKUP_MEMORY_CLOCK: u32 = 1 << 18;

// RM0090, 5.4.1 and 5.4.2.
const PWR_CR: u32 = register!(PWR.cr);
const PWR_CSR: u32 = register!(PWR.csr);
/// DBP: the backup domain may be written to.
const UNLOCK: u32 = 1 << 8;
/// BRE: the regulator by which a battery keeps the contents.
const REGULATOR: u32 = 1 << 9;

/// Switches it on, and lets it be written to; with a battery it keeps its contents from now on.
/// After the clock tree has been set up, which stores a whole PWR_CR.
pub fn start(registers: &mut impl Registers) {
    registers.switch_clocks_on(RCC_APB1ENR, POWER_CLOCK);
    registers.modify(PWR_CR, 0, UNLOCK);
    // Its ready flag is not waited for: it matters to a battery only.
    registers.modify(PWR_CSR, 0, REGULATOR);
    registers.switch_clocks_on(RCC_AHB1ENR, BACKUP_MEMORY_CLOCK);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    #[test]
    fn the_rest_of_each_register_stays() {
        let before = [(0x4002_3840, 1), (0x4000_7000, 0xc000), (0x4000_7004, 0), (0x4002_3830, 0x10_001f)];
        let mut registers = before.into_iter().fold(Recorder::default(), |all, (at, value)| all.with(at, value));
        start(&mut registers);
        let after = [(0x4002_3840, 1 | 1 << 28), (0x4000_7000, 0xc100), (0x4000_7004, 0x200), (0x4002_3830, 0x14_001f)];
        for (address, value) in after {
            assert_eq!(registers.value(address), value, "{address:#x}");
        }
    }
}
