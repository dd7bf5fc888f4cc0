//! Turns the board's file into the constants of the module `board`.
//!
//! `FERROSTEP_BOARD` names the board, by name or path; the bench if nothing does. The chip is a feature, for it decides
//! which registers there are before this runs; here the two are held against each other.

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-env-changed=FERROSTEP_BOARD");
    let name = env::var("FERROSTEP_BOARD").unwrap_or_else(|_| ferrostep_boards::DEFAULT.to_owned());
    let board = ferrostep_boards::load(&name).map_err(|error| error.to_string())?;
    if Path::new(&name).exists() {
        println!("cargo:rerun-if-changed={name}");
    }
    let feature = board.chip.feature;
    if env::var_os(format!("CARGO_FEATURE_{}", feature.to_uppercase())).is_none() {
        return Err(format!(
            "{name}: chip = \"{}\": expected the feature {feature} to be on and no other chip's; `cargo xtask firmware \
             --board {name}` sees to it",
            board.chip.name
        )
        .into());
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("board.rs"), ferrostep_boards::constants::rust(&board))?;
    Ok(())
}
