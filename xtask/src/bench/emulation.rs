//! The bench image in the emulator.
//!
//! Its clock counts instructions there: the same on every run and on every machine.

use std::io::BufReader;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use flate2::read::GzDecoder;
use serde_json::Value;

use crate::emulator;
use crate::steps::Failure;
use crate::system;

/// The bench takes some ten seconds; an image that never ends is not waited for.
const LONGEST: Duration = Duration::from_secs(300);

/// The file that it prints: short segments, from `profiles/cartesian.toml`'s kind of machine.
const PRINTED: &str = "examples/gyroid.gcode.gz";

/// The name under which it looks for it, in its working folder.
const PRINTED_AS: &str = "print.gcode";

/// Runs the bench image; what it counted.
pub fn count(image: &Path) -> Result<Value, Failure> {
    let folder = system::target_directory().join("bench");
    unpack(&system::root().join(PRINTED), &folder)?;
    let report = emulator::output_of(emulator_command(image).current_dir(&folder), LONGEST)?;
    match serde_json::from_str(&report) {
        Ok(counts @ Value::Object(_)) => Ok(counts),
        Ok(_) => Err(format!("the bench printed no JSON object: {report}")),
        Err(error) => Err(format!("the bench printed no JSON object: {error}: {report}")),
    }
}

fn unpack(packed: &Path, folder: &Path) -> Result<(), Failure> {
    let open = || {
        std::fs::create_dir_all(folder)?;
        let mut reader = GzDecoder::new(BufReader::new(std::fs::File::open(packed)?));
        std::io::copy(&mut reader, &mut std::fs::File::create(folder.join(PRINTED_AS))?)
    };
    open().map(|_| ()).map_err(|error| format!("{} cannot be unpacked: {error}", packed.display()))
}

fn emulator_command(image: &Path) -> Command {
    let mut command = emulator::counting();
    command.args(["-semihosting-config", "enable=on,target=native", "-kernel"]).arg(image);
    command
}
