//! What hangs on which pin, read from the board's file as a maker reads a wiring plan, and what the machine around it is
//! like, read from the profile.
//!
//! The firmware's build reads the same files with code of its own, which this module does not use: a pin that the build
//! misreads is wired right here, and the printer then does not move.
//!
//! | File | Read by | Refused |
//! |---|---|---|
//! | `boards/*.toml` | [`Board`] | unknown keys, and what the chip's data sheet rules out |
//! | `profiles/*.toml` | [`Printer`] | values that no machine has; keys that do not concern the wiring are not read |
//! | an image (ELF) | [`check_image`] | an image for another chip, boot offset or memory |

mod board;
mod check;
mod chip;
mod functions;
mod image;
mod printer;
mod refusal;

pub use board::{Board, Driver, DriverLine, Fan, Heater, Input, Motor, Serial, Thermistor, Usb};
pub use chip::Chip;
pub use functions::{Adc, TimerChannel};
pub use image::{Image, check_image};
pub use printer::{
    AxisHoming, DriverSettings, DriverSignals, End, HeaterModel, HeaterSettings, Homing, HomingSensor, Kinematics,
    NamedThermistor, Printer, ThermistorKind,
};
pub use refusal::Refusal;

#[cfg(test)]
mod tests;
