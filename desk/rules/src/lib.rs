//! Other firmwares' planning rules: the speeds that Klipper, Marlin and RepRapFirmware give each
//! move of a print.
//!
//! A [`Planner`] takes [`Move`]s one by one, as the firmware sees them after it has read a line
//! of G-code: displacements, the speed asked for, the settings in force. It releases
//! [`PlannedMove`]s in the same order as soon as that firmware's look-ahead would: three speeds,
//! three phases, and what [limits](Limit) each. Its memory is that of the firmware's queue,
//! whatever the length of the file.
//!
//! The rules are written from the firmwares' documents and read against their sources; each module
//! names them. Steps, rounding to them and single precision are left out: positions and speeds are
//! f64 in mm and mm/s. This crate uses no code of the firmware.
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
