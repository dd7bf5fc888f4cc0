//! Events of drivers, as text.

use core::fmt;

use super::exchange::ExchangeError;
use super::motors::{MOTORS, SECOND_EXTRUDER, Z, motor_name};
use super::registers::{DriverStatus, Register, VERSION};
use super::settings::SettingsError;

/// Reason why a driver is not confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// Datagrams fail.
    Line(ExchangeError),
    /// Another chip answers.
    Version(u8),
    /// The chip does not count a write.
    NotAccepted(Register),
    /// A register does not hold the written value.
    ReadBack {
        /// The register.
        register: Register,
        /// The value written.
        written: u32,
        /// The value read.
        found: u32,
    },
    /// The chip counts more writes than were made, or is reset again and again.
    Unsteady,
    /// The settings cannot be made with this board's sense resistors.
    Settings(SettingsError),
}

impl fmt::Display for Failure {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // The board's own bytes come back by the same line, whether or not a driver listens.
            Self::Line(ExchangeError::GarbledEcho) => out.write_str(
                "does not answer: what is sent comes back garbled on its serial line, or not at all; is the line shorted, or its pin another?",
            ),
            Self::Line(error) => write!(out, "does not answer: {error}; is the motor supply on?"),
            Self::Version(version) => {
                write!(out, "is not a TMC2209: version 0x{version:02x}, expected 0x{VERSION:02x}")
            }
            Self::NotAccepted(register) => write!(out, "does not accept {register}"),
            Self::ReadBack { register, written, found } => {
                write!(out, "does not keep {register}: 0x{found:08x}, expected 0x{written:08x}")
            }
            Self::Unsteady => out.write_str("is reset again and again while it is set up"),
            Self::Settings(error) => write!(out, "cannot be set up: {error}"),
        }
    }
}

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriverEventKind {
    /// The driver is set up, and has confirmed it.
    Confirmed,
    /// The driver could not be set up. Later failures to do so are not reported.
    Failed(Failure),
    /// The driver was set up, and does not answer any more.
    Lost(ExchangeError),
    /// The driver has been reset (by its supply), and is set up anew; the motor may have moved.
    Reset,
    /// The driver has switched the motor off: over-temperature or a short.
    SwitchedOff(DriverStatus),
    /// The charge pump has too little voltage, and the motor is off until it recovers.
    ChargePumpLow,
    /// A warning, reported once for as long as it lasts.
    Warning(DriverStatus),
}

/// An event of a driver. As text: `driver X has been reset, ...`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriverEvent {
    /// The motor's number.
    pub motor: usize,
    /// Kind of the event.
    pub kind: DriverEventKind,
}

impl DriverEvent {
    /// Returns true if the motor's position may differ from its steps, so that motion must stop.
    #[must_use]
    pub const fn stops_motion(&self) -> bool {
        !matches!(self.kind, DriverEventKind::Confirmed | DriverEventKind::Warning(_))
    }

    /// The motor of 0 to 3 with which it moves: Z for the further ones of Z, E for the
    /// second extruder's.
    #[must_use]
    pub const fn axis(&self) -> usize {
        match self.motor {
            SECOND_EXTRUDER => MOTORS - 1,
            motor if motor < MOTORS => motor,
            _ => Z,
        }
    }

    /// Returns true if a person should be informed.
    #[must_use]
    pub const fn is_notable(&self) -> bool {
        !matches!(self.kind, DriverEventKind::Confirmed)
    }
}

impl fmt::Display for DriverEvent {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "driver {} ", motor_name(self.motor))?;
        match self.kind {
            DriverEventKind::Confirmed => out.write_str("is set up"),
            DriverEventKind::Failed(failure) => fmt::Display::fmt(&failure, out),
            DriverEventKind::Lost(error) => write!(out, "does not answer any more: {error}"),
            DriverEventKind::Reset => out.write_str("has been reset, its motor may have moved"),
            DriverEventKind::SwitchedOff(status) => write!(out, "has switched its motor off: {status}"),
            DriverEventKind::ChargePumpLow => out.write_str("has too little supply voltage, its motor is off"),
            DriverEventKind::Warning(status) => write!(out, "warns: {status}"),
        }
    }
}
