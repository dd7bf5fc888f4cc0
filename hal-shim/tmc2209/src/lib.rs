//! TMC2209 motor drivers over their single-wire serial line.
//!
//! The code has no registers of a microcontroller and no waits: the line is a [`SingleWireUart`],
//! time comes in as ticks, and [`DriverBank::poll`] does the work that is due. All numbers are
//! those of the TMC2209 data sheet, revision 1.09; the comments name its sections and tables.
//!
//! A driver is [confirmed](DriverState::Confirmed) when each register that was written has been
//! counted by the chip (IFCNT) and those that can be read have been read back. Until all are,
//! motion is not allowed.
#![cfg_attr(not(test), no_std)]

mod bank;
mod current;
mod datagram;
mod driver;
mod event;
mod exchange;
mod motors;
mod registers;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod second_opinion;
mod settings;
mod uart;

pub use bank::{DriverBank, LineTiming};
pub use current::{CurrentError, CurrentScale};
pub use datagram::{
    READ_REQUEST_BYTES, REPLY_BYTES, ReplyError, WRITE_BYTES, crc8, parse_reply, read_request, write_request,
};
pub use driver::{DriverReport, DriverState};
pub use event::{DriverEvent, DriverEventKind, Failure};
pub use exchange::ExchangeError;
pub use motors::{MOST_MOTORS, MOTORS, SECOND_EXTRUDER, motor_name};
pub use registers::{
    ChopConf, DriverStatus, GlobalConf, GlobalStatus, HoldRun, MicrostepResolution, Register, VERSION,
};
pub use settings::{
    CLOCK_HZ, DriverSettings, DriverWiring, MAX_THRESHOLD, RegisterImage, STALL_FULL_STEPS_PER_S, SettingsError,
    TSTEP_MICROSTEPS,
};
pub use uart::{LineBusy, LineBytes, SingleWireUart};
