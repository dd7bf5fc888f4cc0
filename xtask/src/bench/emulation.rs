//! The bench image in the emulator.
//!
//! The emulator's clock runs one nanosecond an instruction and its timer at 1 GHz, so the timer that the bench image
//! reads counts instructions: the same on every run and on every machine.

use std::io::{BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

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
    let report = output_of(emulator_command(image).current_dir(&folder), LONGEST)?;
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
    let mut command = Command::new(emulator::PROGRAM);
    command.args(["-machine", "netduinoplus2", "-icount", "shift=0", "-display", "none", "-monitor", "none"]);
    command.args(["-serial", "none", "-semihosting-config", "enable=on,target=native", "-kernel"]);
    command.arg(image);
    command
}

/// Standard output of a command that must end by itself within a time, and in success.
fn output_of(command: &mut Command, longest: Duration) -> Result<String, Failure> {
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| format!("cannot run {:?}: {error}", command.get_program()))?;
    let reader = child.stdout.take().map(|mut output| {
        std::thread::spawn(move || {
            let mut text = String::new();
            output.read_to_string(&mut text).map(|_| text)
        })
    });
    let ended = wait(&mut child, longest);
    if ended.is_err() {
        // It may have ended just now; either way it is gone afterwards.
        let _ = child.kill();
        let _ = child.wait();
    }
    let text = match reader.map(std::thread::JoinHandle::join) {
        Some(Ok(Ok(text))) => text,
        _ => return Err("the output of the bench cannot be read".to_owned()),
    };
    ended.map(|()| text.clone()).map_err(|reason| format!("the bench {reason}; its output was: {text}"))
}

fn wait(child: &mut Child, longest: Duration) -> Result<(), Failure> {
    let start = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => return Err(format!("failed: {status}")),
            Ok(None) if start.elapsed() < longest => std::thread::sleep(Duration::from_millis(10)),
            Ok(None) => return Err(format!("did not end within {} s", longest.as_secs())),
            Err(error) => return Err(error.to_string()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_bench_must_end_by_itself_and_in_success() {
        assert_eq!(output_of(Command::new("echo").arg("{}"), LONGEST).unwrap(), "{}\n");
        assert!(output_of(&mut Command::new("false"), LONGEST).unwrap_err().contains("failed"));
        let error = output_of(Command::new("sleep").arg("60"), Duration::from_millis(50)).unwrap_err();
        assert!(error.contains("did not end"), "{error}");
    }
}
