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

/// Sends a prepared job; if the board refuses it, the fallback G-code instead.
pub fn run(file: &Path, port: &Path, baud: u32, fallback: Option<&Path>) -> Result<ExitCode, String> {
    let name = terminal::name(file);
    let mut input = Input::open(file).map_err(|error| format!("{name}: {error}"))?;
    if !input.is_prepared() {
        return Err(format!("{name}: this is G-code, and send takes a prepared job: `ferrostep preprocess` makes one"));
    }
    let mut job = Vec::new();
    input.read_to_end(&mut job).map_err(|error| format!("{name}: {error}"))?;
    let job = without_thumbnail(job).map_err(|error| format!("{name}: {error}"))?;
    // Opened before anything is sent: a wrong name must not turn up in mid-print.
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
        // Acknowledgements would fill the screen.
        if text != "ok" && !text.is_empty() {
            bar.suspend(|| tell(text));
        }
    };
    let show = |sender: &Sender| {
        bar.set_position(sender.arrived() as u64);
        if sender.repeats() > 0 {
            bar.set_message(format!("{} resends", sender.repeats()));
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
        tell("sending the G-code instead");
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
        return Err(format!("{name}: this is a prepared job, and --fallback takes G-code"));
    }
    Ok(input)
}

/// Reports why a transfer ended early; exit status 1.
fn failed(error: &SendError) -> ExitCode {
    tell(format_args!("error: {error}"));
    ExitCode::from(1)
}
