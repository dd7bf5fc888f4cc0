//! The check that the firmware's crates build for the board's processor, without std.

use std::process::Command;

use crate::core_library::{self, FailedCheck};
use crate::steps::{Failure, Run};
use crate::system::{self, cargo};

/// The crates that the firmware is made of.
const PACKAGES: [&str; 16] = [
    "ferrostep-adxl345",
    "ferrostep-binary-gcode",
    "ferrostep-black-box",
    "ferrostep-card",
    "ferrostep-eeprom",
    "ferrostep-gcode",
    "ferrostep-hal-shim",
    "ferrostep-planner",
    "ferrostep-printer",
    "ferrostep-settings",
    "ferrostep-step-player",
    "ferrostep-stm32f4",
    "ferrostep-thermistor",
    "ferrostep-tmc2209",
    "ferrostep-usb",
    "ferrostep-virtual-board",
];

/// Checks [`PACKAGES`] for the target, after installing what is needed.
pub fn check(run: &mut Run) -> Result<(), Failure> {
    run.step("source of the core library", core_library::require_source)?;
    run.step("no_std check", || system::run(&mut check_command()))
}

/// The check itself, with the profile and in the folder of the images, whose core library has been checked there by their lints.
fn check_command() -> Command {
    let mut command = cargo();
    command.args(["check", "--target-dir"]);
    command.arg(system::target_directory().join("firmware"));
    core_library::apply(&mut command, FailedCheck::Traps);
    for package in PACKAGES {
        command.args(["--package", package]);
    }
    command
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    use crate::core_library::TARGET;

    #[test]
    fn every_package_is_checked_for_the_target() {
        let command = check_command();
        let words: Vec<&str> = command.get_args().map(|word| word.to_str().unwrap()).collect();
        let target = words.iter().position(|word| *word == "--target").unwrap();
        assert_eq!(words[target + 1], TARGET);
        for package in PACKAGES {
            assert!(words.contains(&package), "{package} in {words:?}");
        }
    }
}
