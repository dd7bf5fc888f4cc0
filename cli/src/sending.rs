//! `ferrostep send`.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::ExitCode;

use ferrostep::input::Input;
use ferrostep::send::{self, Patience};
use ferrostep::serial_line::SerialLine;
use ferrostep_gpre::transfer::{Sender, Word, without_thumbnail};
use indicatif::{ProgressBar, ProgressStyle};

/// Sends a job; where the board refuses it, and there is one, the G-code instead.
pub fn run(file: &Path, port: &Path, baud: u32, fallback: Option<&Path>) -> Result<ExitCode, String> {
    let name = file.display();
    let mut input = Input::open(file).map_err(|error| format!("{name}: {error}"))?;
    if !input.is_prepared() {
        return Err(format!("{name}: it is G-code, expected a prepared job (`ferrostep preprocess` makes one)"));
    }
    let mut job = Vec::new();
    input.read_to_end(&mut job).map_err(|error| format!("{name}: {error}"))?;
    let job = without_thumbnail(job).map_err(|error| format!("{name}: {error}"))?;
    // Opened before anything is sent, so that a name that is wrong is not found out late.
    let fallback = match fallback {
        Some(path) => Some(File::open(path).map_err(|error| format!("{}: {error}", path.display()))?),
        None => None,
    };
    let mut line = SerialLine::open(port, baud).map_err(|error| format!("{}: {error}", port.display()))?;
    let mut sender = Sender::new(job);
    let bar = ProgressBar::new(sender.size() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {bytes} of {total_bytes}  {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    let say = |text: &str| {
        // An `ok` says nothing to a person.
        if text != "ok" && !text.is_empty() {
            bar.suspend(|| eprintln!("{text}"));
        }
    };
    let show = |sender: &Sender| {
        bar.set_position(sender.arrived() as u64);
        if sender.repeats() > 0 {
            bar.set_message(format!("{} times sent again", sender.repeats()));
        }
    };
    let end = send::send(&mut line, &mut sender, Patience::DEFAULT, show, say).map_err(|error| error.to_string())?;
    bar.finish_and_clear();
    eprintln!("{}", send::describe(&end));
    if end.word == Word::Refused
        && let Some(gcode) = fallback
    {
        eprintln!("the G-code is sent instead");
        let mut lines = BufReader::new(gcode).lines();
        return match send::send_lines(&mut line, || lines.next(), Patience::DEFAULT, say) {
            Ok(count) => {
                eprintln!("{count} lines sent");
                Ok(ExitCode::SUCCESS)
            }
            Err(error) => Err(error.to_string()),
        };
    }
    Ok(if end.word == Word::Done { ExitCode::SUCCESS } else { ExitCode::from(1) })
}
