//! The built-in profiles, the refusal of everything that is not a profile, and the heaters' gains.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod bed_screws;
mod bltouch;
mod book;
mod builtin;
mod error_budget;
mod fans;
mod filament_sensors;
mod heater_keys;
mod heaters;
mod input_shaper;
mod macros;
mod mesh;
mod mini_heat;
mod motor_drivers;
mod nozzle_refusals;
mod path_tolerance;
mod pauses;
mod pressure_advance;
mod refusals;
mod robustness;
mod safe_homing;
mod z_motors;
