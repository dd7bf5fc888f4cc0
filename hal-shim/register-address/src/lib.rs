//! Addresses of the STM32F4's registers as constants, taken by name from the register description.
//!
//! `ferrostep-stm32f4` reaches registers by address, so that a PC can record what it stores;
//! [`register!`] takes that address from the description (`stm32f4`, stm32f4xx-hal's `pac`) at
//! compile time. A name that the chip lacks does not compile.
//!
//! The crate needs unsafe code to compute the offset of a register within its block: the
//! description names registers by methods, which need a block.
#![no_std]
#![deny(clippy::undocumented_unsafe_blocks)]

// One chip per build: the board's, or on a PC the STM32F407.
#[cfg(all(target_os = "none", feature = "stm32f405"))]
#[doc(hidden)]
pub use stm32f4::stm32f405 as pac;
#[cfg(any(not(target_os = "none"), feature = "stm32f407"))]
#[doc(hidden)]
pub use stm32f4::stm32f407 as pac;
#[cfg(all(target_os = "none", feature = "stm32f446"))]
#[doc(hidden)]
pub use stm32f4::stm32f446 as pac;

/// A peripheral of the register description.
#[doc(hidden)]
pub trait Peripheral {
    /// The peripheral's registers.
    type Block;
    /// Address of the first register.
    const ADDRESS: u32;
}

impl<Block, const ADDRESS: usize> Peripheral for stm32f4::Periph<Block, ADDRESS> {
    type Block = Block;
    // The STM32F4 has addresses of 32 bits.
    const ADDRESS: u32 = ADDRESS as u32;
}

/// Yields the address of a peripheral's first register, or of one of its registers, as a constant
/// `u32`.
///
/// `register!(IWDG)` is the watchdog's first register, `register!(IWDG.rlr)` its reload register,
/// `register!(DMA2.st[3].cr)` the configuration register of stream 3.
#[macro_export]
macro_rules! register {
    ($peripheral:ident) => {
        <$crate::pac::$peripheral as $crate::Peripheral>::ADDRESS
    };
    ($peripheral:ident $(. $name:ident $([$index:expr])?)+) => {
        const {
            type Block = <$crate::pac::$peripheral as $crate::Peripheral>::Block;
            // SAFETY: a block consists of integers of 8, 16 and 32 bits, for which all zeros is a
            // valid value.
            let block: Block = unsafe { ::core::mem::zeroed() };
            let register = ::core::ptr::from_ref(block $(.$name($($index)?))+);
            // SAFETY: the register is part of the block.
            let offset = unsafe { register.byte_offset_from(&block) };
            $crate::register!($peripheral) + offset as u32
        }
    };
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    extern crate std;

    use std::fs;
    use std::path::{Path, PathBuf};
    use std::string::String;
    use std::vec::Vec;

    /// Files that may contain a literal address, with the number of such lines: the backup SRAM is
    /// not a register, and the core's registers are not the chip's.
    const TYPED: [(&str, usize); 2] =
        [("config/boards/src/registers.rs", 7), ("hal-shim/stm32f4/src/backup_memory.rs", 1)];

    /// Files that consist of tests only.
    const TESTS: [&str; 3] = ["tests.rs", "late_clocks.rs", "mini_drivers.rs"];

    /// Folders whose code reaches registers.
    const FOLDERS: [&str; 5] =
        ["app", "config/boards/src", "hal-shim/stm32f4/src", "hal-shim/stm32f4-board/src", "hal-shim/stm32f4-usb/src"];

    /// Collects the sources of a folder, except test files.
    fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                sources(&path, found);
            } else if path.extension().is_some_and(|kind| kind == "rs")
                && !TESTS.iter().any(|name| path.ends_with(name))
            {
                found.push(path);
            }
        }
    }

    /// Lines of a file without its test module; a mere declaration, `mod tests;`, ends nothing.
    fn product(text: &str) -> impl Iterator<Item = &str> {
        let is_named = |part: &str| part.lines().next().is_some_and(|line| line.ends_with(';'));
        text.split("#[cfg(test)]\n")
            .enumerate()
            .take_while(move |(place, part)| *place == 0 || is_named(part))
            .map(|(_, part)| part)
    }

    /// Returns true if a line contains an address of the chip's or the core's registers (RM0090
    /// 2.3: 0x400x_xxxx, 0x500x_xxxx and 0xe00x_xxxx).
    fn has_address(line: &str) -> bool {
        line.split("0x").skip(1).any(|after| {
            let digits: String = after.chars().filter(|letter| *letter != '_').take(8).collect();
            let Ok(number) = u32::from_str_radix(&digits, 16) else { return false };
            digits.len() == 8 && matches!(number >> 20, 0x400 | 0x500 | 0xe00)
        })
    }

    /// Tests deliberately contain literal addresses from RM0090; all other code uses names.
    #[test]
    fn no_register_is_typed_by_hand() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap();
        let mut found = Vec::new();
        for folder in FOLDERS {
            sources(&root.join(folder), &mut found);
        }
        assert!(found.len() > 60, "{} files", found.len());
        let mut typed = Vec::new();
        for path in found {
            let text = fs::read_to_string(&path).unwrap();
            let product = product(&text);
            let lines = product
                .flat_map(str::lines)
                .filter(|line| !line.trim_start().starts_with("//") && has_address(line))
                .count();
            if lines > 0 {
                let name = path.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/");
                typed.push((name, lines));
            }
        }
        typed.sort();
        assert_eq!(typed, TYPED.map(|(name, lines)| (String::from(name), lines)));
    }

    #[test]
    fn addresses_are_told_from_other_numbers() {
        assert!(has_address("const KR: u32 = 0x4000_3000;"));
        assert!(has_address("(0xe000_ed04, 1)"));
        assert!(!has_address("const KEYS: [u32; 2] = [0x0819_2a3b, 0xcdef_89ab];"));
        assert!(!has_address("const LINES: u32 = 0x5555;"));
    }

    /// Addresses match RM0090, 2.3 and the peripherals' register maps.
    #[test]
    fn addresses_are_the_manuals() {
        assert_eq!(register!(GPIOA), 0x4002_0000);
        assert_eq!([register!(IWDG.kr), register!(IWDG.sr)], [0x4000_3000, 0x4000_300c]);
        assert_eq!(register!(DMA2.st[3].cr), 0x4002_6458);
        assert_eq!(register!(DBGMCU.apb1_fz), 0xe004_2008);
    }
}
