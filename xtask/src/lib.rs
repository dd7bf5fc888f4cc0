//! Build, test, bench, flash: the same commands for CI and for a person.
//!
//! Each command is a list of steps that run one after the other; the first that fails ends the run. Commands that need Ferrostep's own
//! crates are in a program of their own, the [`workbench`], which uses this library for steps and for other programs.
#![forbid(unsafe_code)]

pub mod core_library;
pub mod generated;
pub mod hosts;
pub mod images;
pub mod mutants;
pub mod no_std;
pub mod policy;
pub mod seed;
pub mod slicers;
pub mod steps;
pub mod system;
pub mod workbench;

/// Environment variable that tells the tests where the firmware image is.
pub const FIRMWARE_VARIABLE: &str = "FERROSTEP_FIRMWARE";

/// Environment variable that tells the tests where the hosts are.
pub const HOSTS_VARIABLE: &str = "FERROSTEP_HOSTS";

/// All packages but those that only the board's processor can build.
pub const DESK: [&str; 11] = [
    "--workspace",
    "--exclude",
    "ferrostep-firmware",
    "--exclude",
    "ferrostep-bench",
    "--exclude",
    "ferrostep-stm32f4-board",
    "--exclude",
    "ferrostep-stm32f4-usb",
    "--exclude",
    "ferrostep-step-interrupt",
];
