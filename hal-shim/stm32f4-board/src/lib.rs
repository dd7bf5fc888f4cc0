//! STM32F4 implementation of hal-shim's traits: clock, step timer, serial line, safe state, and the
//! board that the image is built for.
//!
//! The crate has unsafe code for register fields that the register description leaves unchecked
//! ("any value may be written here"), a counter that many tasks read, the panic and fault handlers,
//! which must reach every port, critical sections, the table of interrupt handlers, and registers
//! that hal-shim's adapters reach by address. Each use states its reason.
#![no_std]
#![deny(clippy::undocumented_unsafe_blocks)]

pub mod accelerometer;
pub mod black_box;
pub mod board;
pub mod card;
pub mod clock;
mod core_pace;
pub mod driver_line;
pub mod eeprom;
pub mod fault;
mod first_stores;
pub mod handlers;
pub mod identifier;
pub mod measured;
pub mod motion_clock;
mod motor_ports;
mod motor_stop;
pub mod safe_state;
pub mod serial;
pub mod servo;
pub mod settings_memory;
pub mod step_timer;
mod stores;
pub mod supervision;
pub mod thermal;
pub mod usb_guard;
pub mod vector_table;
mod volatile;

pub use stm32f4xx_hal::pac;
pub use stm32f4xx_hal::rcc::Rcc;
