//! Peripherals of the STM32F4 that are plain sequences of stores: the clock, thermistors by ADC and DMA, heaters and fans by timers,
//! watchdog, cause of the last reset, brown-out level.
//!
//! They know registers by address (RM0090, RM0390: the same in all that is used here) and reach them through
//! [`Registers`](crate::registers::Registers), so that tests on the desk read what they store. On the board the stores
//! are volatile ones (`hal-shim/stm32f4/src/volatile.rs`).

pub mod brown_out;
pub mod clock_setup;
mod converter;
mod family;
mod heaters;
#[cfg(test)]
mod late_clocks;
mod pwm;
mod reset_cause;
mod software_pwm;
pub mod watchdog;

pub use brown_out::{BrownOut, set_brown_out_level};
pub use clock_setup::{ClockRegisters, ClockSettings};
pub use converter::{CONVERSIONS, Converter, ConverterNumber};
pub use family::ChipFamily;
pub use heaters::{BoardHeaters, ThermalPins};
pub use pwm::{FAN_HZ, HEATER_HZ, OutputPin, PwmClocks, PwmOutput, TimerChannel};
pub use reset_cause::ResetCause;
pub use software_pwm::{SOFTWARE_PERIOD_TICKS, SoftwarePwm};
pub use watchdog::{FASTEST_TIMEOUT_MS, SLOWEST_TIMEOUT_MS, UnderDebugger, Watchdog};
