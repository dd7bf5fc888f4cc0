//! The firmware image in an emulator: started, talked to as a host does, its pins read back.
//!
//! [`Machine`] is `qemu-system-arm` with the image, [`Host`] the host on its serial line, [`Noise`] what may happen to
//! lines on the way, and [`PinLog`] what the image did to its step and direction pins.

mod host;
mod machine;
mod noise;
mod pin_log;

pub use host::{Host, HostError, Port, with_checksum};
pub use machine::{EMULATOR, Machine, Sleep};
pub use noise::Noise;
pub use pin_log::{PinEvent, PinLog, Pins};
