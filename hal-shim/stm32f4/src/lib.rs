//! Peripherals of the STM32F4 as sequences of loads and stores, and the firmware's
//! aids around them.
//!
//! The code knows registers by address, which [`ferrostep_register_address`] takes from the chip's
//! register description, and reaches them through [`Registers`](registers::Registers). Tests on the
//! desk read what it stores and expect the addresses of the manuals (RM0090, RM0390: the same in
//! everything that is used here); on the board the stores are volatile ones
//! (`hal-shim/stm32f4-board/src/volatile.rs`), so that this crate needs no unsafe code.
#![cfg_attr(not(test), no_std)]

pub mod backup_memory;
pub mod brown_out;
mod bus_pace;
pub mod clock_setup;
pub mod clock_tree;
mod converter;
pub mod crash_message;
mod family;
pub mod gpio;
mod half_duplex;
mod heaters;
pub mod histogram;
#[cfg(test)]
mod late_clocks;
pub mod life_signs;
#[cfg(test)]
mod mini_drivers;
mod pin_lines;
mod pwm;
pub mod rcc;
pub mod registers;
mod reset_cause;
pub mod sdio;
pub mod sector_flash;
pub mod sensor_lines;
pub mod servo_line;
mod software_i2c;
mod software_pwm;
pub mod software_serial;
mod software_spi;
pub mod tachometers;
pub mod usb_controller;
pub mod watchdog;

pub use brown_out::{BrownOut, set_brown_out_level};
pub use bus_pace::BusPace;
pub use clock_setup::{ClockRegisters, ClockSettings};
pub use converter::{CONVERSIONS, Converter, ConverterNumber};
pub use family::ChipFamily;
pub use half_duplex::HalfDuplexLine;
pub use heaters::{BoardHeaters, FanPins, SupplyPin, ThermalPins};
pub use pin_lines::PinLines;
pub use pwm::{FAN_HZ, HEATER_HZ, OutputPin, PwmClocks, PwmOutput, TimerChannel};
pub use reset_cause::ResetCause;
pub use servo_line::ServoLine;
pub use software_i2c::{I2cFault, I2cPins, SoftwareI2c};
pub use software_pwm::{SOFTWARE_PERIOD_TICKS, SoftwarePwm};
pub use software_spi::{SoftwareSpi, SpiPins};
pub use watchdog::{FASTEST_TIMEOUT_MS, SLOWEST_TIMEOUT_MS, UnderDebugger, Watchdog};
