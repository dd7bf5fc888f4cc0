//! Planning rules of other firmwares: the speeds that Klipper, Marlin and RepRapFirmware give each
//! move of a print.
//!
//! A [`Planner`] takes [`Move`]s one by one, as the firmware sees them after reading a line of
//! G-code: displacements, the requested speed, the settings in force. It releases [`PlannedMove`]s
//! in the same order, as soon as that firmware's look-ahead would: three speeds, three phases, and
//! the [limit](Limit) of each. Its memory use is that of the firmware's queue, however long the
//! file is.
//!
//! The rules are written from the firmwares' documentation and checked against their sources; each
//! module names them. Steps, rounding to steps and single precision are left out: positions and
//! speeds are f64 in mm and mm/s. This crate uses no code of the firmware.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod arcs;
pub mod change;
pub mod klipper;
pub mod marlin;
mod motion;
mod planner;
mod retraction;
pub mod rrf;
mod setting;
mod window;

pub use change::{Change, Effect, VelocityLimit, Words};
pub use motion::{ArcHint, Axis, Limit, Move, MoveError, PlannedMove};
pub use planner::{Planner, Rules, UnknownRules};
pub use retraction::FirmwareRetraction;
pub use setting::SettingError;
