//! The clock's registers, each stated in full: a boot loader may have changed any of them.
//!
//! Addresses and bits: RM0090 3.9 (FLASH_ACR), 5.4 (PWR), 7.3 (RCC); RM0390 3.8, 5.4, 6.3.
//!
//! Left alone are the backup domain (RCC_BDCR: the real-time clock, which the firmware does not
//! use), RCC_CSR, whose flags say why the chip was reset, and the numbers of the PLLs for I2S and
//! SAI, which are switched off.

use ferrostep_register_address::register;

use super::ChipFamily;
use crate::clock_tree::{ClockTree, PllSource};
use crate::rcc::{POWER_CLOCK, RCC, RCC_APB1ENR, RCC_CFGR as CFGR, SWS, is_on_pll};
use crate::registers::Registers;

const CR: u32 = register!(RCC.cr);
const PLLCFGR: u32 = register!(RCC.pllcfgr);
const CIR: u32 = register!(RCC.cir);
const SSCGR: u32 = register!(RCC.sscgr);
/// Prescaler of all timers (TIMPRE), clock gating, and what USB's 48 MHz come from (CK48MSEL):
/// an STM32F446 only (RM0390 6.3.25 to 6.3.27), so that the description that the desk uses lacks
/// them.
const DCKCFGR: u32 = RCC + 0x8c;
const CKGATENR: u32 = RCC + 0x90;
const DCKCFGR2: u32 = RCC + 0x94;
const PWR_CR: u32 = register!(PWR.cr);
const PWR_CSR: u32 = register!(PWR.csr);
const FLASH_ACR: u32 = register!(FLASH.acr);

// CR: switches, each with its ready flag one bit higher.
const HSION: u32 = 1 << 0;
const HSIRDY: u32 = 1 << 1;
/// The trim of the internal oscillator as after reset: 16.
const HSITRIM: u32 = 16 << 3;
const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
const CSSON: u32 = 1 << 19;
const PLLON: u32 = 1 << 24;
const PLLRDY: u32 = 1 << 25;
/// Further switches: the PLLs for I2S (bit 26) and SAI (bit 28, an STM32F446 only).
const OTHERS_ON: u32 = 1 << 26 | 1 << 28;
const OTHERS_READY: u32 = 1 << 27 | 1 << 29;

// CFGR.
const SW: u32 = 0b11;
const SW_PLL: u32 = 0b10;

/// CIR: clears all flags, that of a failed crystal (bit 23) included, and asks for no interrupt.
const CLEAR_FLAGS: u32 = 0xff << 16;

/// PWR_CSR: the regulator has reached the scale's voltage.
const VOSRDY: u32 = 1 << 14;

// FLASH_ACR: prefetch and both caches; the bits that empty the caches while they are off.
const LATENCY: u32 = 0xf;
const PRFTEN: u32 = 1 << 8;
const CACHES_ON: u32 = 1 << 9 | 1 << 10;
const CACHES_EMPTY: u32 = 1 << 11 | 1 << 12;

/// Maximum number of looks at a ready flag. A crystal takes 2 ms, a PLL 0.2 ms; a look takes at
/// least four cycles of 16 MHz, so this waits for 12 ms or longer.
const MAX_LOOKS: u32 = 50_000;

/// A divider takes effect within 16 cycles of the AHB (RM0090 7.3.3); a look takes one at least.
const DIVIDER_LOOKS: u32 = 16;

/// A board's clock settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockSettings {
    /// The chip's.
    pub family: ChipFamily,
    /// RCC_PLLCFGR with the crystal, and with the internal oscillator.
    pub pll: [u32; 2],
    /// Code of RCC_CFGR for the slow bus's divider while the PLL runs.
    pub apb1_code: u8,
    /// The same of the fast bus.
    pub apb2_code: u8,
    /// Wait states of the flash while the PLL runs.
    pub flash_wait_states: u8,
}

impl ClockSettings {
    /// PWR_CR: voltage scale 1 alone (over-drive is off). It is one bit of an STM32F405, two
    /// of an STM32F446.
    const fn scale_1(&self) -> u32 {
        match self.family {
            ChipFamily::F405 => 1 << 14,
            ChipFamily::F446 => 0b11 << 14,
        }
    }

    /// The buses' dividers in CFGR.
    const fn dividers(&self) -> u32 {
        (self.apb1_code as u32 & 0b111) << 10 | (self.apb2_code as u32 & 0b111) << 13
    }
}

/// The registers that make the clock.
#[derive(Debug)]
pub struct ClockRegisters<R> {
    registers: R,
    settings: ClockSettings,
}

impl<R: Registers> ClockRegisters<R> {
    /// The chip on its internal oscillator with everything as reset leaves it, and voltage scale 1
    /// chosen, which the PLL needs at 168 MHz (RM0090 5.1.3, RM0390 5.1.3: it can be chosen while
    /// the PLL is off).
    ///
    /// The order matters: first away from the PLL, which cannot be changed while it is used,
    /// then the dividers.
    pub fn start_internal(registers: R, settings: ClockSettings) -> Self {
        let mut clock = Self { registers, settings };
        clock.use_internal();
        let registers = &mut clock.registers;
        registers.modify(CR, HSEON | CSSON | PLLON | OTHERS_ON, 0);
        let _off = registers.comes_to(CR, HSERDY | PLLRDY | OTHERS_READY, false, MAX_LOOKS);
        // The crystal's bypass can be changed while the crystal is off.
        registers.write(CR, HSION | HSITRIM);
        registers.write(CIR, CLEAR_FLAGS);
        registers.write(SSCGR, 0);
        if settings.family == ChipFamily::F446 {
            for register in [DCKCFGR, CKGATENR, DCKCFGR2] {
                registers.write(register, 0);
            }
        }
        // At 16 MHz flash needs no wait states. A boot loader has written to it: the caches may
        // hold earlier contents.
        for word in [0, CACHES_EMPTY, 0] {
            registers.write(FLASH_ACR, word);
        }
        registers.switch_clocks_on(RCC_APB1ENR, POWER_CLOCK);
        registers.write(PWR_CR, settings.scale_1());
        clock
    }

    /// The internal oscillator, its own frequency on all buses. The dividers follow the switch:
    /// undivided, a fast clock would be too fast for the buses.
    fn use_internal(&mut self) {
        let registers = &mut self.registers;
        registers.modify(CR, 0, HSION);
        let _ready = registers.comes_to(CR, HSIRDY, true, MAX_LOOKS);
        registers.modify(CFGR, SW, 0);
        let _switched = registers.comes_to(CFGR, SWS, false, MAX_LOOKS);
        registers.write(CFGR, 0);
    }

    /// Starts the PLL with these numbers, at the voltage for it. Returns true if it runs.
    fn lock_pll(&mut self, factors: u32) -> bool {
        let registers = &mut self.registers;
        registers.modify(CR, PLLON, 0);
        let _off = registers.comes_to(CR, PLLRDY, false, MAX_LOOKS);
        registers.write(PLLCFGR, factors);
        registers.modify(CR, 0, PLLON);
        registers.comes_to(CR, PLLRDY, true, MAX_LOOKS) && registers.comes_to(PWR_CSR, VOSRDY, true, MAX_LOOKS)
    }

    /// Sets the flash's wait states before the core speeds up, and returns true if they read back
    /// (RM0090 3.5.1, RM0390 3.4.1); caches hide most of them.
    fn slow_flash_down(&mut self) -> bool {
        let wait_states = u32::from(self.settings.flash_wait_states);
        self.registers.write(FLASH_ACR, wait_states | PRFTEN | CACHES_ON);
        (0..MAX_LOOKS).any(|_| self.registers.read(FLASH_ACR) & LATENCY == wait_states)
    }

    /// Makes the PLL the core's clock and returns true if it has become that. A separate store sets
    /// the dividers first: they take effect up to 16 cycles late, and until then the buses would
    /// run at the core's frequency.
    fn use_pll(&mut self) -> bool {
        let dividers = self.settings.dividers();
        let registers = &mut self.registers;
        registers.write(CFGR, dividers);
        (0..DIVIDER_LOOKS).for_each(|_| {
            let _look = registers.read(CFGR);
        });
        registers.modify(CFGR, SW, SW_PLL);
        (0..MAX_LOOKS).any(|_| is_on_pll(registers))
    }
}

impl<R: Registers> ClockTree for ClockRegisters<R> {
    fn start_crystal(&mut self) -> bool {
        self.registers.modify(CR, 0, HSEON);
        self.registers.comes_to(CR, HSERDY, true, MAX_LOOKS)
    }

    fn stop_crystal(&mut self) {
        self.registers.modify(CR, HSEON, 0);
    }

    fn start_pll(&mut self, source: PllSource) -> bool {
        let [with_crystal, with_internal] = self.settings.pll;
        let factors = match source {
            PllSource::Crystal => with_crystal,
            PllSource::Internal => with_internal,
        };
        if !self.lock_pll(factors) || !self.slow_flash_down() {
            self.registers.modify(CR, PLLON, 0);
            return false;
        }
        let switched = self.use_pll();
        if !switched {
            self.use_internal();
        }
        switched
    }

    fn watch_crystal(&mut self) {
        self.registers.modify(CR, 0, CSSON);
    }
}

/// Returns true if the crystal has stopped while it was watched ([`ClockTree::watch_crystal`]): the
/// cause of the non-maskable interrupt. The chip runs on its internal oscillator by then, and PLL
/// and crystal are off.
pub fn crystal_has_stopped(registers: &mut impl Registers) -> bool {
    const CSSF: u32 = 1 << 7;
    registers.read(CIR) & CSSF != 0
}

/// A serial port's divider for the same speed after that: the buses stay divided as they were, and
/// the core has switched from `core_hz` to `internal_hz`. At least 1, and no more than before.
pub const fn divider_without_crystal(divider: u16, core_hz: u32, internal_hz: u32) -> u16 {
    let core_hz = if core_hz == 0 { 1 } else { core_hz } as u64;
    // Rounded; 16 bits times 32 fit.
    let slower = (divider as u64 * internal_hz as u64 + core_hz / 2) / core_hz;
    if slower == 0 {
        1
    } else if slower > divider as u64 {
        divider
    } else {
        slower as u16
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
