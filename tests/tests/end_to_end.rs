//! The whole machine at work: the `ferrostep` command and its library, compared with the
//! independent reference (`ferrostep-oracle`).
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod accelerations;
mod against_klipper;
mod backlash;
mod bad_input;
mod bad_words;
mod bltouch;
mod calibration;
mod chamber;
mod command;
mod command_meaning;
mod core_xz;
mod desk;
mod drivers;
mod entries;
mod estimates;
mod exactness;
mod extrusion;
mod fans;
mod fault_matrix;
mod filament_motion;
mod first_use;
mod hazards;
mod heater_faults;
mod homing_places;
mod hostile;
mod hosts;
mod idle_heaters;
mod import_cases;
mod import_parts;
mod import_refusals;
mod import_running;
mod import_tools;
mod import_z_motors;
mod imports;
mod inputs;
mod interruptions;
mod job_remarks;
mod json_output;
mod klipper_files;
mod klipper_times;
mod methods;
mod odd_lines;
mod on_the_way;
#[cfg(unix)]
mod outputs;
mod overflow;
mod packed;
mod papers;
mod pause_times;
mod pauses;
#[cfg(unix)]
mod post_process;
mod prepared;
mod prints;
mod programs;
#[cfg(unix)]
mod progress_bar;
mod protocol;
#[cfg(unix)]
mod pty_board;
mod refusals;
mod refusals_page;
mod repeats;
mod reports;
mod rules;
#[cfg(unix)]
mod sending;
mod shaping;
mod simulations;
mod skew;
mod slaved_extruder;
mod sliced_3mf;
mod sliced_for;
mod slicer_printers;
mod slicer_profiles;
mod slicers_today;
mod stall;
mod summary_schema;
mod supply;
mod sweeps;
mod tools;
mod towers;
mod waits;
mod waveform;
