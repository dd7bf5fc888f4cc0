//! A board in memory, in virtual time: motors that count, end stops, heaters with a
//! thermal model, a fan.
//!
//! Time passes only when the caller plays step entries or waits.
#![cfg_attr(not(test), no_std)]

mod card;
mod clock;
mod driver_chip;
mod driver_lines;
mod end_stop_failure;
mod event_rate;
mod heater_failure;
mod heaters;
mod identifier;
mod mechanics;
mod modelled_sensors;
mod motors;
mod pin;
mod port;
mod probe;
mod stall;
mod thermal_model;

pub use card::{CardFault, VirtualCard};
pub use clock::{VirtualClock, VirtualDelay};
pub use driver_chip::DriverChip;
pub use driver_lines::{VIRTUAL_WIRING, VirtualDriverLines};
pub use end_stop_failure::EndStopFailure;
pub use event_rate::EventRate;
pub use ferrostep_step_player::{CYCLES_A_TICK, VirtualUpdateTimer};
pub use heater_failure::HeaterFailure;
pub use heaters::VirtualHeaters;
pub use identifier::IDENTIFIER;
pub use mechanics::{BOUNCE_10NM, Mechanics, STALL_LAG_10NM, SensorFault, SensorPlace, VirtualSensor};
pub use modelled_sensors::ModelledSensors;
pub use motors::{START_10NM, VirtualEndStop, VirtualMotors};
pub use port::VirtualPort;
pub use probe::{SheetShape, VirtualProbe};
pub use stall::StallSignal;
pub use thermal_model::{HeatedMass, ThermalModel};
