//! `ferrostep send`.

mod person;
mod port;

use std::io::{BufReader, Read};
use std::path::Path;
use std::process::ExitCode;

use ferrostep_gpre::transfer::{Sender, Word, without_thumbnail};
use ferrostep_host::file_lines::FileLines;
use ferrostep_host::printable;
use ferrostep_host::printer_line::PrinterLine;
use ferrostep_host::send::{self, Frame, Packing, Patience, SendError, Stop, Watch};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input::{self, Input};
use indicatif::ProgressBar;

use crate::arguments::SendArguments;
use crate::progress::{self, Estimate, clock};
use crate::terminal::tell;
use person::Person;

/// Length of the bar of G-code.
const SHARES: u64 = 1000;

/// Sends a file: a prepared job as one (if the board refuses it, the fallback G-code instead),
/// G-code line by line.
///
/// # Errors
/// A file cannot be read, or the port not be opened.
pub fn run(arguments: &SendArguments) -> Result<ExitCode, String> {
    let name = input::name(&arguments.file);
    let mut input = Input::open(&arguments.file).map_err(|error| format!("{name}: {error}"))?;
    // Opened before anything is sent: a wrong name must not show in the middle of a print.
    let fallback = match &arguments.fallback {
        Some(_) if !input.is_prepared() => {
            return Err(format!("{name}: this is G-code, and --fallback is for a prepared job: leave it out"));
        }
        Some(path) => Some(open_gcode(path)?),
        None => None,
    };
    if arguments.meatpack && input.is_prepared() && fallback.is_none() {
        return Err(format!("{name}: this is a prepared job, and --meatpack packs G-code: leave it out"));
    }
    if let Some(card_name) = &arguments.to_card {
        if input.is_prepared() {
            return Err(format!(
                "{name}: this is a prepared job, which lines cannot carry: copy it to the card in a reader"
            ));
        }
        if card_name.is_empty() || card_name.contains(|char: char| char.is_control() || char.is_whitespace()) {
            return Err("--to-card: write a name of 8 characters and 3 after the dot, such as PART.GCO".to_owned());
        }
    }
    let job = match input.is_prepared() {
        true => {
            let mut job = Vec::new();
            input.read_to_end(&mut job).map_err(|error| format!("{name}: {error}"))?;
            Some(without_thumbnail(job).map_err(|error| format!("{name}: {error}"))?)
        }
        false => None,
    };
    let estimate = Estimate::default();
    if let Some(profile) = &arguments.profile {
        let profile = ferrostep_profiles::load(profile).map_err(|error| error.to_string())?;
        let file = if job.is_some() { arguments.fallback.as_ref() } else { Some(&arguments.file) };
        let file =
            file.ok_or_else(|| format!("{name}: this is a prepared job, which knows its time: leave --profile out"))?;
        estimate.begin(file, profile, LOOK_AHEAD_BLOCKS);
    }
    let mut person = Person::new()?;
    let address = arguments.port.clone().map_or_else(port::choose, Ok)?;
    let mut line = PrinterLine::open(&address, arguments.baud).map_err(|error| format!("{address}: {error}"))?;
    let Some(job) = job else {
        return Ok(send_gcode(&mut line, input, person, estimate, arguments.meatpack, arguments.to_card.as_deref()));
    };
    let end = match send_prepared(&mut line, job, &mut person) {
        Ok(end) => end,
        Err(error @ SendError::Asked) => {
            let code = failed(&error);
            person::cool_down(&mut line);
            return Ok(code);
        }
        Err(error) => return Ok(failed(&error)),
    };
    tell(send::describe(&end));
    if end.word == Word::Refused
        && let Some(gcode) = fallback
    {
        tell("sending the G-code instead");
        return Ok(send_gcode(&mut line, gcode, person, estimate, arguments.meatpack, None));
    }
    Ok(if end.word == Word::Done { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn send_prepared(
    line: &mut PrinterLine,
    job: Vec<u8>,
    person: &mut Person,
) -> Result<ferrostep_gpre::transfer::Report, SendError> {
    let mut sender = Sender::new(job);
    let bar = progress::bar(sender.size() as u64, "{bar:20} {percent:>3} %  {bytes} of {total_bytes}  {wide_msg}");
    let show = |sender: &Sender| {
        bar.set_position(sender.arrived() as u64);
        if sender.repeats() > 0 {
            bar.set_message(format!("{} resends", sender.repeats()));
        }
    };
    let watch = PreparedWatch { bar: &bar, person };
    let end = send::send(line, &mut sender, Patience::DEFAULT, show, watch);
    bar.finish_and_clear();
    end
}

/// Shows a board's messages while a prepared job is sent, and asks whether it is to end.
struct PreparedWatch<'a> {
    bar: &'a ProgressBar,
    person: &'a mut Person,
}

impl Watch for PreparedWatch<'_> {
    fn hear(&mut self, line: &str) {
        // Acknowledgements would fill the screen.
        if line != "ok" && !line.is_empty() {
            self.bar.suspend(|| tell(line));
        }
    }

    fn wants_end(&mut self) -> bool {
        let bar = self.bar;
        self.person.wants_end(|question| bar.suspend(|| tell(question)))
    }
}

/// Sends G-code to be printed, or to be written to the card under a name; packed if that is wanted
/// and the printer knows it. Reports how it ended.
fn send_gcode(
    line: &mut PrinterLine,
    input: Input,
    person: Person,
    estimate: Estimate,
    meatpack: bool,
    to_card: Option<&str>,
) -> ExitCode {
    let packing = match choose_packing(line, meatpack) {
        Ok(packing) => packing,
        Err(error) => return failed(&error),
    };
    let (place, has_size) = (input.place(), input.size_bytes() > 0);
    let mut lines = FileLines::new(BufReader::new(input));
    let bar = progress::bar(SHARES, if has_size { "{bar:20} {percent:>3} %  {wide_msg}" } else { "{wide_msg}" });
    let mut show = Show {
        bar,
        person,
        share: move || place.share(),
        line: 0,
        refused: 0,
        temperatures: String::new(),
        left: Left { estimate, slicer_min: None },
    };
    let begin = to_card.map(|name| format!("M28 {name}"));
    let opening = begin.as_deref().map(|begin| [begin]);
    let frame = match &opening {
        Some(opening) => Frame { opening, closing: &["M29"], is_upload: true },
        None if show.bar.is_hidden() => Frame::PLAIN,
        None => Frame::WITH_TEMPERATURES,
    };
    let outcome = send::send_lines(line, packing, || lines.next(), frame, Patience::DEFAULT, &mut show);
    show.bar.finish_and_clear();
    if show.refused > 0 {
        tell(format_args!("the printer refused {} lines", show.refused));
    }
    let outcome = match outcome {
        Ok(outcome) => outcome,
        // The line is gone, or the printer has done it already.
        Err(error) => return failed(&error),
    };
    if let Some(stop @ Stop::NotWriting(..)) = &outcome.stop {
        tell(format_args!("error: {stop}"));
        person::end_upload(line);
        return ExitCode::from(1);
    }
    let Some(stop) = outcome.stop else {
        let packed = if packing == Packing::MeatPack { ", packed" } else { "" };
        let done = to_card.map_or("printed".to_owned(), |name| format!("written to the card as {name}"));
        tell(format_args!("{done}: {} lines sent{packed}, {} of them again", outcome.sent, outcome.resends));
        return ExitCode::SUCCESS;
    };
    tell(format_args!("error: after line {} of the file: {stop}", outcome.file_line));
    end_early(line, to_card);
    ExitCode::from(1)
}

/// Ends the printer's work: its print, or the file that is not complete.
fn end_early(line: &mut PrinterLine, to_card: Option<&str>) {
    match to_card {
        Some(name) => person::delete_upload(line, name),
        None => person::cool_down(line),
    }
}

fn choose_packing(line: &mut PrinterLine, meatpack: bool) -> Result<Packing, SendError> {
    if !meatpack {
        return Ok(Packing::Plain);
    }
    // The answer to M115 would fill the screen.
    let packing = send::begin_packing(line, Patience::DEFAULT, |_| {})?;
    if packing == Packing::Plain {
        tell("note: the printer does not know MeatPack (M115 does not say Cap:MEATPACK:1): sending plain text");
    }
    Ok(packing)
}

/// The display while G-code is sent.
struct Show<S> {
    bar: ProgressBar,
    person: Person,
    share: S,
    line: u32,
    refused: u32,
    temperatures: String,
    left: Left,
}

/// Remaining time of the print: it only falls.
#[derive(Default)]
struct Left {
    estimate: Estimate,
    /// Minutes, by the slicer (M73 R).
    slicer_min: Option<f64>,
}

impl Left {
    /// Takes in what a command says.
    fn hear(&mut self, command: &str) {
        let mut words = command.split_ascii_whitespace();
        if words.next() == Some("M73") {
            let minutes = words.find_map(|word| word.strip_prefix('R')?.parse::<f64>().ok()).filter(|min| *min >= 0.0);
            self.slicer_min =
                minutes.map(|min| self.slicer_min.map_or(min, |before| before.min(min))).or(self.slicer_min);
        }
    }

    /// Returns the remaining time at a line, for a person.
    fn text(&self, line: u32) -> String {
        match (self.estimate.get(), self.slicer_min) {
            (Some(schedule), _) => format!("  left {}", clock(schedule.total_s() - schedule.at_s(line))),
            (None, Some(minutes)) => format!("  {minutes} min left (slicer)"),
            (None, None) => String::new(),
        }
    }
}

impl<S: Fn() -> Option<f64>> Show<S> {
    fn show(&self) {
        // Shares of packed files are estimates: the bar does not go back.
        let position = ((self.share)().unwrap_or(0.0) * SHARES as f64) as u64;
        self.bar.set_position(position.max(self.bar.position()));
        self.bar.set_message(format!("line {}{}  {}", self.line, self.left.text(self.line), self.temperatures));
    }
}

impl<S: Fn() -> Option<f64>> Watch for Show<S> {
    fn hear(&mut self, line: &str) {
        let line = line.trim();
        let temperatures = line.strip_prefix("ok ").unwrap_or(line);
        if temperatures.starts_with("T:") {
            let shown = temperatures.split(" @:").next().unwrap_or(temperatures);
            self.temperatures = printable::one_line(shown).into_owned();
            self.show();
            return;
        }
        // Acknowledgements, signs of life and repeated lines would fill the screen.
        let is_routine = line == "ok" || line.starts_with("echo:busy:") || line.starts_with("Resend:");
        if line.is_empty() || is_routine || send::is_transfer_error(line) {
            return;
        }
        // A word without effect is not a refusal.
        self.refused += u32::from(line.starts_with("echo:line ") && !line.ends_with("(said once a job)"));
        self.bar.suspend(|| tell(printable::one_line(line)));
    }

    fn sent(&mut self, line: u32, command: &str) {
        self.line = line;
        self.left.hear(command);
        self.show();
    }

    fn held(&mut self, is_held: bool) {
        let what = if is_held { "the printer pauses the job" } else { "the job continues" };
        self.bar.suspend(|| tell(what));
    }

    fn wants_end(&mut self) -> bool {
        let bar = &self.bar;
        self.person.wants_end(|question| bar.suspend(|| tell(question)))
    }
}

/// Opens G-code, plain or packed.
fn open_gcode(path: &Path) -> Result<Input, String> {
    let name = input::name(path);
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn what_the_slicer_says_only_falls() {
        let mut left = Left::default();
        assert_eq!(left.text(1), "");
        for (command, expected) in [
            ("M73 P0 R21", "  21 min left (slicer)"),
            ("M73 P10 R23", "  21 min left (slicer)"),
            ("M73 Q5 S30", "  21 min left (slicer)"),
            ("G1 X5 R3", "  21 min left (slicer)"),
            ("M73 R", "  21 min left (slicer)"),
            ("M73 P100 R0", "  0 min left (slicer)"),
        ] {
            left.hear(command);
            assert_eq!(left.text(1), expected, "{command}");
        }
    }

    #[test]
    fn an_estimate_knows_what_is_left_at_each_line() {
        let mut left = Left::default();
        left.hear("M73 R99");
        let cube = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/cube.gcode");
        left.estimate.begin(&cube, ferrostep_profiles::load("cartesian").unwrap(), LOOK_AHEAD_BLOCKS);
        let end = Instant::now() + Duration::from_secs(120);
        while left.estimate.get().is_none() && Instant::now() < end {
            std::thread::yield_now();
        }
        let texts: Vec<String> = (1..8778).map(|line| left.text(line)).collect();
        assert_eq!(texts[0], "  left 23:15");
        let seconds = |text: &String| {
            let (minutes, seconds) = text.trim_start_matches("  left ").split_once(':').unwrap();
            minutes.parse::<u32>().unwrap() * 60 + seconds.parse::<u32>().unwrap()
        };
        assert!(texts.iter().map(seconds).is_sorted_by(|before, after| before >= after), "{texts:?}");
        assert!(seconds(&texts[8776]) < 10, "{}", texts[8776]);
    }
}
