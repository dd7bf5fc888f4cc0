//! Puts the machine's profile where the crate includes it.
//!
//! The profile is the TOML that the desk reads too, checked by the same code and held
//! against the board.

use std::path::PathBuf;
use std::{env, fs};

use ferrostep_boards::chosen;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (_, profile) = chosen::machine()?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    // The derived `Debug` of plain data is an expression of Rust, which `src/lib.rs` compiles with
    // the names in scope.
    fs::write(out.join("profile.rs"), format!("{profile:?}"))?;
    // How the step interrupt makes a step, as a type: it is compiled for that one kind.
    let signals = if profile.driver.both_edges { "BothEdges" } else { "Pulses" };
    let signals =
        format!("/// Step signals of the drivers.\npub type StepSignals = ferrostep_step_player::{signals};\n");
    fs::write(out.join("step_signals.rs"), signals)?;
    Ok(())
}
