//! Puts the linker's memory map and the machine's profile where the firmware's build finds them.
//!
//! The memories are those of the board that `FERROSTEP_BOARD` names, by name or path; the bench's without it.
//! `FERROSTEP_BOOT_OFFSET` moves the image to another place of its flash. The profile is the TOML that the desk reads too,
//! checked by the same code and held against the board; it enters the image as a constant. `FERROSTEP_PROFILE` names another
//! profile than the board's, by name or path.

use std::path::{Path, PathBuf};
use std::{env, fs};

use ferrostep_printer::DriverTiming;
use ferrostep_version::Version;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let root = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("..");
    let memory = root.join("memory.x");
    fs::copy(&memory, out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed={}", memory.display());
    // The tests' names and places, for a runner over a debug probe.
    println!("cargo:rustc-link-arg-bin=on-target=-Tembedded-test.x");

    let board_name = env::var("FERROSTEP_BOARD").unwrap_or_else(|_| ferrostep_boards::DEFAULT.to_owned());
    let board = ferrostep_boards::load(&board_name).map_err(|error| error.to_string())?;
    let board = match env::var("FERROSTEP_BOOT_OFFSET") {
        Ok(text) => {
            board.at_boot_offset(text.parse().map_err(|_| format!("FERROSTEP_BOOT_OFFSET={text}: expected bytes"))?)?
        }
        Err(_) => board,
    };
    println!("cargo:rerun-if-env-changed=FERROSTEP_BOOT_OFFSET");
    fs::write(out.join("memories.x"), ferrostep_boards::constants::memories(&board))?;
    println!("cargo:rerun-if-env-changed=FERROSTEP_BOARD");

    let name = env::var("FERROSTEP_PROFILE").unwrap_or_else(|_| board.profile.clone());
    let profile = ferrostep_profiles::load(&name).map_err(|error| error.to_string())?;
    ferrostep_boards::fit::check(&board, &profile, &name).map_err(|error| error.to_string())?;
    // The derived `Debug` of plain data is an expression of Rust, which `src/profile.rs` compiles with the names in scope.
    fs::write(out.join("profile.rs"), format!("{profile:?}"))?;
    fs::write(out.join("identity.rs"), identity(&root, &board.name, profile.name))?;
    // Code that looks after drivers is compiled only for machines with drivers that can be set.
    println!("cargo:rustc-check-cfg=cfg(drivers)");
    if ferrostep_boards::fit::wiring(&board, &profile).iter().any(Option::is_some) {
        println!("cargo:rustc-cfg=drivers");
    }
    fs::write(out.join("drivers.rs"), ferrostep_boards::constants::drivers(&board, &profile))?;
    fs::write(out.join("sensors.rs"), ferrostep_boards::constants::sensors(&board, &profile))?;
    fs::write(out.join("step_signals.rs"), step_signals(&profile.driver))?;
    println!("cargo:rerun-if-env-changed=FERROSTEP_PROFILE");
    for file in [board_name, name] {
        if Path::new(&file).exists() {
            println!("cargo:rerun-if-changed={file}");
        }
    }
    Ok(())
}

/// Folders and files that an image is made from.
const SOURCES: [&str; 15] = [
    "Cargo.lock",
    "Cargo.toml",
    "memory.x",
    "app",
    "boards",
    "checked-toml",
    "gcode",
    "gpre",
    "hal-shim",
    "planner",
    "printer",
    "profiles",
    "square-root",
    "usb",
    "version",
];

/// The text by which an image names itself, `ferrostep 0.1.0 (commit abcdef0) prusa-buddy prusa-mini`, and the version's place
/// in it.
fn identity(root: &Path, board: &str, profile: &str) -> String {
    let version = Version::of(env!("CARGO_PKG_VERSION"), root, &SOURCES);
    version.watch();
    let name = "ferrostep ";
    let (from, to) = (name.len(), name.len() + version.text.len());
    // A line of its own among the image's texts.
    let text = format!("{name}{} {board} {profile}\n", version.text);
    format!("Identity {{ text: {text:?}, version: {from}..{to} }}")
}

/// How the step interrupt makes a step, as a type: it is compiled for that one kind.
fn step_signals(driver: &DriverTiming) -> String {
    let name = if driver.both_edges { "BothEdges" } else { "Pulses" };
    format!("/// What the drivers take for a step.\npub type StepSignals = ferrostep_step_player::{name};\n")
}
