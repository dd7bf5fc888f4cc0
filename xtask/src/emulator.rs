//! The emulator that runs the firmware's images.

use std::process::Command;

use crate::steps::Failure;
use crate::system;

/// The program, and Debian's package that holds it.
pub const PROGRAM: &str = "qemu-system-arm";

/// Finds the emulator, or installs it on Debian.
pub fn find() -> Result<(), Failure> {
    if let Some(version) = version() {
        eprintln!("    {version}");
        return Ok(());
    }
    if !system::can_install_debian_packages() {
        return Err(format!(
            "{PROGRAM} is missing, which runs the firmware's image. As root on Debian it would be installed; install \
             it by hand (version 7.2 is known to work)"
        ));
    }
    system::install_debian_packages(&[PROGRAM])?;
    let version = version().ok_or_else(|| format!("{PROGRAM} is installed, but does not start"))?;
    eprintln!("    {version}");
    Ok(())
}

/// The first line of what it says about itself.
fn version() -> Option<String> {
    let text = system::output(Command::new(PROGRAM).arg("--version"))?;
    text.lines().next().map(str::to_owned)
}
