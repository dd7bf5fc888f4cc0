//! Turns the board's file into the constants of the module `board`, and into the
//! linker's memory map.
//!
//! The chip is also a feature, since it selects the registers before this runs; this checks
//! that the two agree.

use std::path::PathBuf;
use std::{env, fs};

use ferrostep_boards::{chosen, constants};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The machine's profile says which level of a pin switches its supply off: the safe state needs
    // that without the application.
    let (board, profile) = chosen::machine()?;
    // The step queue's user follows the filament only for a sensor that sees it move.
    println!("cargo:rustc-check-cfg=cfg(follows_filament)");
    if profile.filament_sensor.is_some_and(|sensor| sensor.detection_10nm().is_some()) {
        println!("cargo:rustc-cfg=follows_filament");
    }
    println!("cargo:rustc-check-cfg=cfg(filament_switch)");
    if profile.filament_switch.is_some() {
        println!("cargo:rustc-cfg=filament_switch");
    }
    let board = board.for_machine(&profile);
    let feature = board.chip.feature;
    if env::var_os(format!("CARGO_FEATURE_{}", feature.to_uppercase())).is_none() {
        return Err(format!(
            "board {}: chip = \"{}\": expected the feature {feature} to be on and no other chip's; `cargo xtask firmware \
             --board {}` sees to it",
            board.name, board.chip.name, board.name
        )
        .into());
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("board.rs"), constants::rust(&board))?;
    // Cargo lets the linker of an image look here, as in the folder in which
    // cortex-m-rt puts link.x.
    fs::copy("../../memory.x", out.join("memory.x"))?;
    let measures = env::var_os("CARGO_FEATURE_MEASURING_STACK").is_some();
    let stack_kib = if measures { constants::MEASURING_STACK_KIB } else { constants::STACK_KIB };
    fs::write(out.join("memories.x"), constants::memories(&board, stack_kib))?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=../../memory.x");
    Ok(())
}
