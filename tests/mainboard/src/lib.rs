//! A virtual mainboard: printer boards around an emulated STM32F4 that run the shipped
//! images unmodified.
//!
//! This crate does not know the firmware. The chip model is rigless, which others wrote from ST's
//! reference manual (RM0090); [`chip`] adds what rigless lacks. [`parts`] holds the parts on the
//! board and the printer's mechanics, from their data sheets. [`wiring`] reads what is connected to
//! each pin from the board's file. [`decode`] turns the pins' edges into steps and compares them
//! with the desk's trace. [`host`] is the computer at the other end of the line.

pub mod chip;
pub mod commands;
pub mod conversation;
pub mod decode;
pub mod faults;
pub mod host;
pub mod machine;
pub mod parts;
pub mod pins;
pub mod plant;
pub mod run;
pub mod wiring;
