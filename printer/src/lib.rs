//! The machine that executes commands: modal state, moves, homing, heat, reports.
//!
//! Generic over what it needs of its surroundings (see [`ports`]); it knows neither registers nor tasks. Commands are
//! asynchronous: a wait is an await, and every wait ends when it is cancelled ([`Signals`]).
#![cfg_attr(not(test), no_std)]

pub mod heat;
pub mod machine;
pub mod packets;
pub mod ports;

mod arc;
mod drivers;
mod entry;
mod error;
mod extrusion;
mod heater_timeout;
mod homing;
mod host;
mod modal;
mod moves;
mod prepared;
mod printer;
mod profile;
mod settings;
mod transfer;
mod waits;
mod z_offset;

pub use drivers::tell_driver_event;
pub use error::{CommandError, Failure};
pub use heater_timeout::{HeaterRest, HeaterTimeout};
pub use host::Host;
pub use modal::Tally;
pub use ports::{
    Equipment, HeaterStatus, Heating, HomingOutcome, Miscount, Motion, MotionError, MotionFault, MotorDrivers, Ports,
    Replies, Signals, Timing,
};
pub use printer::Printer;
pub use profile::{
    AxisHoming, DEFAULT_EVENTS_PER_S, DEFAULT_HEATER_TIMEOUT_S, DEFAULT_MOVES_PER_S, DriverTiming, ExtrusionSettings,
    FirmwareRetraction, HeaterSettings, HeaterWatch, HomeEnd, HomeSensor, Profile, SafeHoming,
};
pub use transfer::{JobLine, JobRequest};
pub use waits::temperatures;

/// Names of the axes, in the order of their index.
pub const AXIS_NAMES: [char; 4] = ['X', 'Y', 'Z', 'E'];
