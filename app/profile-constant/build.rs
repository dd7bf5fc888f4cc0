//! Generates the machine's profile for inclusion in the crate.
//!
//! The profile is the same TOML file that the desktop tool reads, checked by the same code and
//! against the board.

use std::path::PathBuf;
use std::{env, fs};

use ferrostep_boards::chosen;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (_, profile) = chosen::machine()?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    // The derived `Debug` output of plain data is a Rust expression, which `src/lib.rs` compiles
    // with the names in scope.
    fs::write(out.join("profile.rs"), format!("{profile:?}"))?;
    // The kind of step signal, as a type: the step interrupt is compiled for that kind only.
    let signals = if profile.driver.both_edges { "BothEdges" } else { "Pulses" };
    let signals =
        format!("/// Step signals of the drivers.\npub type StepSignals = ferrostep_step_player::{signals};\n");
    fs::write(out.join("step_signals.rs"), signals)?;
    Ok(())
}
