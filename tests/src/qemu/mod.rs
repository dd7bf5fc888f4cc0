//! The firmware image in an emulator: started, talked to as a host does, its pins read back.
//!
//! [`Machine`] is `qemu-system-arm` with the image, [`Host`] the host on its serial line, [`Noise`] what may happen to
//! lines on the way, [`PinLog`] what the image did to its step and direction pins and [`PortWrite`] to any pin, and
//! [`Debugger`] what a stray jump or a stack that has run over would do to it.

mod debugger;
mod drivers;
mod host;
mod machine;
mod noise;
mod pin_log;
mod port_log;

pub use debugger::{Debugger, Register};
pub use host::{Host, HostError, Port, with_checksum};
pub use machine::{EMULATOR, Machine, Sleep};
pub use noise::Noise;
pub use pin_log::{PinEvent, PinLog, Pins};
pub use port_log::{BSRR, MODER, Pin, PortState, PortWrite};
