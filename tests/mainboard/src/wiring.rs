//! Reads what is connected to each pin from the board's file, and the printer around the board
//! from the profile.
//!
//! The firmware's build reads the same files with its own code, which this module does not use: if
//! the build misreads a pin, this module still wires it correctly and the printer does not move.
//!
//! | File | Read by | Refused |
//! |---|---|---|
//! | `config/boards/*.toml` | [`Board`] | unknown keys, and wiring that the chip's data sheet excludes |
//! | `config/profiles/*.toml` | [`Printer`] | values that no machine has; keys outside the wiring are ignored |
//! | an image (ELF) | [`check_image`] | an image for another chip, boot offset or memory |

mod board;
mod board_file;
mod check;
mod chip;
mod functions;
mod image;
mod printer;
mod printer_check;
mod printer_file;
mod refusal;
mod z_motors;

pub use board::{
    Accelerometer, Board, CardSlot, Driver, DriverLine, Eeprom, Fan, Heater, Input, Motor, Serial, Thermistor, Usb,
};
pub use chip::Chip;
pub use functions::{Adc, TimerChannel};
pub use image::{Image, check_image};
pub use printer::{
    AxisHoming, DriverSettings, DriverSignals, End, FrameMode, HeaterModel, HeaterSettings, Homing, HomingSensor,
    Kinematics, NamedThermistor, Printer, ThermistorKind,
};
pub use refusal::Refusal;
pub use z_motors::ZMotor;

#[cfg(test)]
mod tests;
