//! Families of chips that start in the same way.

/// A family of chips with the same registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipFamily {
    /// STM32F405 and STM32F407 (RM0090).
    F405,
    /// STM32F446 (RM0390).
    F446,
}
