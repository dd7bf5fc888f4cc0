//! Counts the target's instructions for the parts of a print.
//!
//! The emulator's clock runs one nanosecond an instruction and its timer at 1 GHz, so the timer that the bench image
//! reads counts instructions: the same on every run and on every machine.

use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::emulator;
use crate::firmware::{self, Program};
use crate::steps::{Failure, Run};

/// The bench takes about a second; an image that never ends is not waited for.
const LONGEST: Duration = Duration::from_secs(120);

/// Builds the bench, runs it and prints what it counted.
pub fn run(run: &mut Run, json: bool) -> Result<(), Failure> {
    run.step("emulator", emulator::find)?;
    let image = firmware::build(run, Program::Bench)?;
    let report = run.step("bench", || output_of(&mut emulator_command(&image), LONGEST))?;
    let counts = counts(&report)?;
    if json {
        println!("{}", report.trim());
        return Ok(());
    }
    println!("{:<44} {:>12}", "instructions", "each");
    for (name, count) in counts {
        println!("{name:<44} {count:>12.1}");
    }
    Ok(())
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

/// Names and numbers of a flat JSON object, by name.
fn counts(report: &str) -> Result<Vec<(String, f64)>, Failure> {
    let object: serde_json::Map<String, serde_json::Value> =
        serde_json::from_str(report).map_err(|error| format!("the bench printed no JSON object: {error}: {report}"))?;
    if object.is_empty() {
        return Err("the bench counted nothing".to_owned());
    }
    object
        .into_iter()
        .map(|(name, value)| match value.as_f64() {
            Some(count) => Ok((name, count)),
            None => Err(format!("the bench printed {name}: {value}, expected a number")),
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_numbers_by_name() {
        let report = "{\"target.parse_line\": 812, \"target.step_event\": 40.5}\n";
        let expected = [("target.parse_line".to_owned(), 812.0), ("target.step_event".to_owned(), 40.5)];
        assert_eq!(counts(report).unwrap(), expected);
        for broken in ["", "{}", "[1]", "{\"a\": \"b\"}", "panicked"] {
            assert!(counts(broken).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn a_bench_must_end_by_itself_and_in_success() {
        assert_eq!(output_of(Command::new("echo").arg("{}"), LONGEST).unwrap(), "{}\n");
        assert!(output_of(&mut Command::new("false"), LONGEST).unwrap_err().contains("failed"));
        let error = output_of(Command::new("sleep").arg("60"), Duration::from_millis(50)).unwrap_err();
        assert!(error.contains("did not end"), "{error}");
    }
}
