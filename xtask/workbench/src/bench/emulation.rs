//! The bench image on the virtual mainboard.
//!
//! Its clock counts instructions there: the same on every run and on every machine.

use std::io::BufReader;
use std::path::Path;

use flate2::read::GzDecoder;
use serde_json::Value;

use crate::mainboard::{self, Counter};
use crate::steps::Failure;
use crate::system;

/// The file that it prints: short segments, from `config/profiles/cartesian.toml`'s
/// kind of machine.
const PRINTED: &str = "examples/gyroid.gcode.gz";

/// Name under which the image looks for the file.
const PRINTED_AS: &str = "print.gcode";

/// Runs the bench image; returns its counts.
pub fn count(mainboard: &Path, image: &Path) -> Result<Value, Failure> {
    let folder = system::target_directory().join("bench");
    unpack(&system::root().join(PRINTED), &folder)?;
    let report = mainboard::output_of(&mut mainboard::counting(mainboard, image, Counter::Timer, &folder, "")?)?;
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
