//! The commands: what each does with the printer, by subject.
//!
//! Each module extends [`Printer`](crate::Printer); only `dispatch` knows which command is where.
//! The state that the commands change is in modules that do not depend on them.

mod accelerometer;
mod answer;
mod backlash;
mod bed;
mod black_box;
mod bltouch;
pub(crate) mod card;
mod change_macros;
mod dispatch;
pub(crate) mod drivers;
mod entailed;
mod entry;
mod execute;
mod extruder_steps;
pub(crate) mod fans;
mod filament;
pub(crate) mod gcode_state;
mod heater_model;
mod home_offset;
pub(crate) mod host;
mod intended;
mod motors;
mod moves;
mod pause;
mod power_loss;
mod prepared;
mod pressure_advance;
mod print_clock;
mod reports;
mod settings;
mod shapers;
mod skew;
mod stored;
mod supply;
mod temperatures;
mod tools;
mod tower;
pub(crate) mod transfer;
pub(crate) mod tuning;
mod waits;
pub(crate) mod z_offset;
