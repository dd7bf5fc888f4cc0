//! Addresses of the STM32F4's registers by their names in the register description, as constants.
//!
//! `ferrostep-stm32f4` reaches registers by address, so that the desk can record what it stores;
//! [`register!`] takes that address from the description (`stm32f4`, stm32f4xx-hal's `pac`) when
//! the code is compiled. A name that the chip lacks does not compile.
//!
//! The crate has unsafe code for the distance between a block's first byte and a register: the
//! description names registers by methods, which want a block.
#![no_std]
#![deny(clippy::undocumented_unsafe_blocks)]

// One chip a build: the board's, or on the desk the STM32F407.
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

/// Address of a peripheral's first register, or of a register of the peripheral, as a constant
/// `u32`.
///
/// `register!(IWDG)` is the watchdog's first register, `register!(IWDG.rlr)` its reload value,
/// `register!(DMA2.st[3].cr)` the settings of the fourth stream.
#[macro_export]
macro_rules! register {
    ($peripheral:ident) => {
        <$crate::pac::$peripheral as $crate::Peripheral>::ADDRESS
    };
    ($peripheral:ident $(. $name:ident $([$index:expr])?)+) => {
        const {
            type Block = <$crate::pac::$peripheral as $crate::Peripheral>::Block;
            // SAFETY: a block consists of integers of 8, 16 and 32 bits, for which zeros are a
            // value.
            let block: Block = unsafe { ::core::mem::zeroed() };
            let register = ::core::ptr::from_ref(block $(.$name($($index)?))+);
            // SAFETY: the register is part of the block.
            let offset = unsafe { register.byte_offset_from(&block) };
            $crate::register!($peripheral) + offset as u32
        }
    };
}

#[cfg(test)]
mod tests {
    /// RM0090, 2.3 and the peripherals' register maps.
    #[test]
    fn addresses_are_the_manuals() {
        assert_eq!(register!(GPIOA), 0x4002_0000);
        assert_eq!([register!(IWDG.kr), register!(IWDG.sr)], [0x4000_3000, 0x4000_300c]);
        assert_eq!(register!(DMA2.st[3].cr), 0x4002_6458);
        assert_eq!(register!(DBGMCU.apb1_fz), 0xe004_2008);
    }
}
