//! The supply voltage below which the chip resets itself: an option that is kept in
//! flash, set once.

use core::fmt;

use ferrostep_register_address::register;

use crate::rcc::{POWER_CLOCK, RCC_APB1ENR};
use crate::registers::Registers;

// RM0090, 3.9: option bytes.
const FLASH_OPTKEYR: u32 = register!(FLASH.optkeyr);
const FLASH_SR: u32 = register!(FLASH.sr);
const FLASH_OPTCR: u32 = register!(FLASH.optcr);
const KEYS: [u32; 2] = [0x0819_2a3b, 0x4c5d_6e7f];
const BUSY: u32 = 1 << 16;
const LOCK: u32 = 1 << 0;
const STRT: u32 = 1 << 1;
/// Two bits: 0 is level 3, 2.7 V (DS8626, embedded reset and power control block).
const LEVEL: u32 = 0b11 << 2;

// RM0090, 5.4: the supply's comparator.
const PWR_CR: u32 = register!(PWR.cr);
const PWR_CSR: u32 = register!(PWR.csr);
const PVDE: u32 = 1 << 4;
/// Highest level of the brown-out reset, 2.9 V.
const PLS: u32 = 0b111 << 5;
/// The supply is below that.
const PVDO: u32 = 1 << 2;

/// Looks while the comparator wakes up.
const COMPARATOR_LOOKS: u32 = 10_000;

/// Looks at the flash's flag: some seconds. Erasing and writing the options takes up to 2 s
/// (DS8626, flash memory).
const MAX_LOOKS: u32 = 50_000_000;

/// The state of the level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BrownOut {
    /// The level was set before.
    WasSet,
    /// The level has been written, and takes effect at the next reset.
    Written,
    /// The supply is so low that writing might go wrong.
    LowSupply,
    /// The chip does not take it.
    Refused,
}

impl fmt::Display for BrownOut {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::WasSet => "2.7 V",
            Self::Written => "2.7 V from the next reset on",
            Self::LowSupply => "not set, the supply is below 2.9 V",
            Self::Refused => "not set, the chip refuses it",
        })
    }
}

/// Sets level 3: below 2.7 V the chip is in reset and its pins float, before a misread flash could
/// make the program heat. The other options, among them the one that locks the chip, are written as
/// they are. To be called before any task runs: the core stalls while the flash is busy.
pub fn set_brown_out_level(registers: &mut impl Registers) -> BrownOut {
    set_within(MAX_LOOKS, registers)
}

fn set_within(max_looks: u32, registers: &mut impl Registers) -> BrownOut {
    if registers.read(FLASH_OPTCR) & LEVEL == 0 {
        return BrownOut::WasSet;
    }
    if !supply_is_good(registers) {
        return BrownOut::LowSupply;
    }
    // Someone writes to it, this early.
    if registers.read(FLASH_SR) & BUSY != 0 {
        return BrownOut::Refused;
    }
    if registers.read(FLASH_OPTCR) & LOCK != 0 {
        for key in KEYS {
            registers.write(FLASH_OPTKEYR, key);
        }
    }
    // Still locked: stores would have no effect.
    if registers.read(FLASH_OPTCR) & LOCK != 0 {
        return BrownOut::Refused;
    }
    registers.modify(FLASH_OPTCR, LEVEL | STRT, 0);
    registers.modify(FLASH_OPTCR, 0, STRT);
    let done = registers.comes_to(FLASH_SR, BUSY, false, max_looks);
    registers.modify(FLASH_OPTCR, STRT, LOCK);
    let is_set = registers.read(FLASH_OPTCR) & LEVEL == 0;
    if done && is_set { BrownOut::Written } else { BrownOut::Refused }
}

/// Asks the comparator, and switches it off again.
fn supply_is_good(registers: &mut impl Registers) -> bool {
    registers.switch_clocks_on(RCC_APB1ENR, POWER_CLOCK);
    registers.modify(PWR_CR, PLS, PLS);
    registers.modify(PWR_CR, 0, PVDE);
    let good = (0..COMPARATOR_LOOKS).fold(true, |_, _| registers.read(PWR_CSR) & PVDO == 0);
    registers.modify(PWR_CR, PVDE, 0);
    good
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    /// Options after reset: all sectors writable, no protection, watchdog by software, brown-out
    /// reset off; locked.
    const FACTORY: u32 = 0x0fff_aaed;

    /// A flash whose lock is a lock.
    #[derive(Default)]
    struct Flash {
        recorder: Recorder,
        keys: Vec<u32>,
        written: Vec<u32>,
        is_dead: bool,
        is_slow: bool,
    }

    impl Flash {
        fn with(options: u32) -> Self {
            Self { recorder: Recorder::default().with(FLASH_OPTCR, options), ..Self::default() }
        }
    }

    impl Registers for Flash {
        fn read(&mut self, address: u32) -> u32 {
            self.recorder.read(address)
        }

        fn write(&mut self, address: u32, value: u32) {
            let locked = self.recorder.value(FLASH_OPTCR) & LOCK != 0;
            match address {
                FLASH_OPTKEYR => {
                    self.keys.push(value);
                    if self.keys == KEYS && !self.is_dead {
                        let options = self.recorder.value(FLASH_OPTCR);
                        self.recorder.write(FLASH_OPTCR, options & !LOCK);
                    }
                }
                FLASH_OPTCR if locked => {}
                FLASH_OPTCR => {
                    if value & STRT != 0 {
                        self.written.push(value & !STRT);
                        self.recorder.write(FLASH_SR, if self.is_slow { BUSY } else { 0 });
                    }
                    self.recorder.write(FLASH_OPTCR, value);
                }
                _ => self.recorder.write(address, value),
            }
        }
    }

    #[test]
    fn only_the_level_is_changed_and_the_options_are_locked_again() {
        for level in 1..=3 {
            let options = FACTORY & !LEVEL | level << 2;
            let mut flash = Flash::with(options);
            assert_eq!(set_brown_out_level(&mut flash), BrownOut::Written);
            assert_eq!(flash.keys, [0x0819_2a3b, 0x4c5d_6e7f]);
            assert_eq!(flash.written, [options & !LEVEL & !LOCK]);
            assert_eq!(flash.recorder.value(FLASH_OPTCR), options & !LEVEL);
            assert_eq!(flash.recorder.value(PWR_CR) & PVDE, 0, "the comparator is off again");
            // The next start finds it.
            let stores = flash.recorder.stores.len();
            assert_eq!(set_brown_out_level(&mut flash), BrownOut::WasSet);
            assert_eq!(flash.recorder.stores.len(), stores);
        }
    }

    #[test]
    fn nothing_is_written_while_the_supply_is_low() {
        let mut flash = Flash::with(FACTORY);
        flash.recorder.fix(PWR_CSR, PVDO);
        assert_eq!(set_brown_out_level(&mut flash), BrownOut::LowSupply);
        assert!(flash.keys.is_empty() && flash.written.is_empty());
        // The comparator was asked at its highest level.
        assert!(flash.recorder.stored(PWR_CR).contains(&(PVDE | PLS)));
    }

    #[test]
    fn a_flash_that_does_not_answer_ends_in_bounded_time() {
        let mut locked = Flash { is_dead: true, ..Flash::with(FACTORY) };
        assert_eq!(set_brown_out_level(&mut locked), BrownOut::Refused);
        assert!(locked.written.is_empty());
        let mut busy = Recorder::default().with(FLASH_OPTCR, FACTORY);
        busy.fix(FLASH_SR, BUSY);
        assert_eq!(set_brown_out_level(&mut busy), BrownOut::Refused);
        assert!(busy.stored(FLASH_OPTCR).is_empty());
        let mut never_done = Flash { is_slow: true, ..Flash::with(FACTORY) };
        assert_eq!(set_within(100, &mut never_done), BrownOut::Refused);
        assert_eq!(never_done.recorder.value(FLASH_OPTCR) & LOCK, LOCK);
    }
}
