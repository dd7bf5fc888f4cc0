//! `ferrostep send`.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::ExitCode;

use ferrostep::input::Input;
use ferrostep::send::{self, Patience, SendError};
use ferrostep::serial_line::SerialLine;
use ferrostep::terminal::{self, tell};
use ferrostep_gpre::transfer::{Sender, Word, without_thumbnail};
use indicatif::{ProgressBar, ProgressStyle};

/// Sends a job; where the board refuses it, and there is one, the G-code instead.
pub fn run(file: &Path, port: &Path, baud: u32, fallback: Option<&Path>) -> Result<ExitCode, String> {
    let name = terminal::name(file);
    let mut input = Input::open(file).map_err(|error| format!("{name}: {error}"))?;
    if !input.is_prepared() {
        return Err(format!("{name}: it is G-code, expected a prepared job (`ferrostep preprocess` makes one)"));
    }
    let mut job = Vec::new();
    input.read_to_end(&mut job).map_err(|error| format!("{name}: {error}"))?;
    let job = without_thumbnail(job).map_err(|error| format!("{name}: {error}"))?;
    // Opened before anything is sent, so that a name that is wrong is not found out late.
    let fallback = match fallback {
        Some(path) => Some(open_gcode(path)?),
        None => None,
    };
    let mut line = SerialLine::open(port, baud).map_err(|error| format!("{}: {error}", terminal::name(port)))?;
    let mut sender = Sender::new(job);
    let bar = ProgressBar::new(sender.size() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {bytes} of {total_bytes}  {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    let say = |text: &str| {
        // An `ok` says nothing to a person.
        if text != "ok" && !text.is_empty() {
            bar.suspend(|| tell(text));
        }
    };
    let show = |sender: &Sender| {
        bar.set_position(sender.arrived() as u64);
        if sender.repeats() > 0 {
            bar.set_message(format!("{} times sent again", sender.repeats()));
        }
    };
    let end = send::send(&mut line, &mut sender, Patience::DEFAULT, show, say);
    bar.finish_and_clear();
    let end = match end {
        Ok(end) => end,
        Err(error) => return Ok(failed(&error)),
    };
    tell(send::describe(&end));
    if end.word == Word::Refused
        && let Some(gcode) = fallback
    {
        tell("the G-code is sent instead");
        let mut lines = BufReader::new(gcode).split(b'\n');
        return match send::send_lines(&mut line, || lines.next(), Patience::DEFAULT, say) {
            Ok(count) => {
                tell(format_args!("{count} lines sent"));
                Ok(ExitCode::SUCCESS)
            }
            Err(error) => Ok(failed(&error)),
        };
    }
    Ok(if end.word == Word::Done { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Opens G-code, plain or packed.
fn open_gcode(path: &Path) -> Result<Input, String> {
    let name = terminal::name(path);
    let input = Input::open(path).map_err(|error| format!("{name}: {error}"))?;
    if input.is_prepared() {
        return Err(format!("{name}: it is a prepared job, expected G-code"));
    }
    Ok(input)
}

/// Says why a job that had been begun was not sent to its end.
fn failed(error: &SendError) -> ExitCode {
    tell(format_args!("error: {error}"));
    ExitCode::from(1)
}
