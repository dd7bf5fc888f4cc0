//! Heater control: thermometers, one loop per heater, by PID or by model, and the checks that
//! switch everything off.
//!
//! A hundred times a second, [`HeatControl::update`] reads every thermometer, has [`safety`] check
//! every heater, and sets the power of every heater and fan. Nothing else sets a power.

mod channel;
pub(crate) mod control;
pub(crate) mod fans;
mod filament_speed;
pub(crate) mod gains;
pub(crate) mod model;
mod modelled;
mod pid;
pub(crate) mod relay;
pub(crate) mod report;
pub mod safety;
pub(crate) mod sample_time;
pub(crate) mod step_response;
mod thermometer;
pub(crate) mod timeout;
pub(crate) mod tuning_rule;

pub use control::HeatControl;
pub use gains::PidGains;
pub use model::HeaterModel;
pub use relay::{RelayFindings, RelayProgress};
pub use report::{FanStatus, HeatFault, HeaterStatus};
pub use sample_time::SAMPLE_MS;
pub use step_response::{StepProgress, hottest_start};
pub use tuning_rule::gains_by_relay;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
