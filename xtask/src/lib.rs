//! Build, test, bench, flash: the same commands for CI and for a person.
//!
//! Each command is a list of steps that run one after the other; the first that fails ends the run.
//! Commands that need Ferrostep's own crates are in a separate program, the [`workbench`], which
//! uses this library for steps and for other programs.
#![forbid(unsafe_code)]

pub mod budget;
pub mod check;
pub mod core_library;
pub mod cost;
pub mod generated;
pub mod hosts;
pub mod images;
pub mod mutants;
pub mod policy;
pub mod programs;
pub mod prose;
pub mod seed;
pub mod share;
pub mod steps;
pub mod system;
pub mod tools;
pub mod turns;
pub mod workbench;

/// Environment variable with the path of the firmware image, for the tests.
pub const FIRMWARE_VARIABLE: &str = "FERROSTEP_FIRMWARE";

/// Environment variable with the folder of the hosts, for the tests.
pub const HOSTS_VARIABLE: &str = "FERROSTEP_HOSTS";

/// All packages but those that only the board's processor can build, and the log's, which uses
/// shared packages with other features.
pub const DESK: [&str; 13] = [
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
    "--exclude",
    "ferrostep-mainboard-log",
];
