//! What differs between the chips as far as their start is concerned.

/// A family of chips with the same registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipFamily {
    /// STM32F405 and STM32F407 (RM0090).
    F405,
    /// STM32F446 (RM0390).
    F446,
}
