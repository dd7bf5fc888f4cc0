//! Generates the image's name, and the board's connections for its machine, for inclusion in the
//! application.

use std::path::{Path, PathBuf};
use std::{env, fs};

use ferrostep_boards::{chosen, constants, fit};
use ferrostep_version::Version;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (board, profile) = chosen::machine()?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let root = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("..");
    fs::write(out.join("identity.rs"), identity(&root, &board.name, profile.name)?)?;
    fs::write(out.join("sensors.rs"), constants::sensors(&board, &profile))?;
    fs::write(out.join("drivers.rs"), constants::drivers(&board, &profile))?;
    // Driver supervision is compiled only for machines with configurable drivers.
    println!("cargo:rustc-check-cfg=cfg(drivers)");
    // The file system is compiled only for boards with a slot.
    println!("cargo:rustc-check-cfg=cfg(card)");
    // Accelerometer records are compiled only for boards with a connector for one.
    println!("cargo:rustc-check-cfg=cfg(accelerometer)");
    if board.accelerometer.is_some() {
        println!("cargo:rustc-cfg=accelerometer");
    }
    // Bed following is compiled only for machines that can measure the bed.
    println!("cargo:rustc-check-cfg=cfg(probe)");
    if profile.mesh.is_some() {
        println!("cargo:rustc-cfg=probe");
    }
    // The servo signal of a probe's pin is compiled only for machines with such a probe.
    println!("cargo:rustc-check-cfg=cfg(servo)");
    if profile.bltouch.is_some() && board.servo.is_some() {
        println!("cargo:rustc-cfg=servo");
    }
    // Settings storage is compiled only for boards with memory for it.
    println!("cargo:rustc-check-cfg=cfg(settings_memory)");
    println!("cargo:rustc-check-cfg=cfg(eeprom)");
    if board.eeprom.is_some() {
        println!("cargo:rustc-cfg=eeprom");
    }
    if board.eeprom.is_some() || board.settings_bytes() > 0 {
        println!("cargo:rustc-cfg=settings_memory");
    }
    if board.card.is_some() {
        println!("cargo:rustc-cfg=card");
    }
    // Tachometers, if any, are polled every millisecond.
    println!("cargo:rustc-check-cfg=cfg(tachometers)");
    if board.fans.iter().any(|fan| fan.tacho.is_some()) {
        println!("cargo:rustc-cfg=tachometers");
    }
    if fit::wiring(&board, &profile).iter().any(Option::is_some) {
        println!("cargo:rustc-cfg=drivers");
    }
    Ok(())
}

/// The text by which an image identifies itself, `ferrostep 0.1.0 (commit abcdef0) prusa-buddy
/// prusa-mini`, and the position of the version in it.
fn identity(root: &Path, board: &str, profile: &str) -> std::io::Result<String> {
    let version = Version::of_package(env!("CARGO_PKG_VERSION"), root, "app")?;
    version.watch();
    let name = "ferrostep ";
    let (from, to) = (name.len(), name.len() + version.text.len());
    // On a separate line among the image's texts.
    let text = format!("{name}{} {board} {profile}\n", version.text);
    Ok(format!("Identity {{ text: {text:?}, version: {from}..{to} }}"))
}
