//! The conversation with the printer.

use std::io;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use ferrostep_host::printer_line::PrinterLine;
use ferrostep_host::send::{self, Frame, HALTED, Outcome, Packing, Patience, Port, SendError, Stop};
use ferrostep_web::Speaker;
use tempfile::NamedTempFile;

use super::job_lines::JobLines;
use super::readings::Readings;
use super::shared::{PageHost, Phase, Wishes};
use super::watching::Watching;

/// Interval between looks at the wishes while nothing is printed.
const LOOK: Duration = Duration::from_millis(20);

/// Looks between two attempts to open a closed line.
const LOOKS_UNTIL_RETRY: u32 = 100;

/// A person's line without an answer for this long has lost it. A wait for heat may take as long
/// without a sign of life.
const ANSWER: Duration = Duration::from_secs(300);

/// Longest wait for the last answer.
const LAST_ANSWER: Duration = Duration::from_secs(2);

/// Reports of a board that is asked: temperatures every two seconds, and the position.
const REPORTS: &[u8] = b"M155 S2\nM114\n";

/// Commands that switch these reports off: another host may not want them.
const NO_REPORTS: &[u8] = b"M155 S0\n";

/// Talks with the printer until `ends`: opens the line, and again when it is lost. A job under
/// way is ended first.
pub fn run(host: &PageHost, mut connect: impl FnMut() -> Result<PrinterLine, String>, ends: impl Fn() -> bool) {
    while !ends() {
        let lost = match connect() {
            Ok(mut line) => {
                let outcome = prepare(host, &mut line).and_then(|()| talk(host, &mut line, &ends));
                match outcome {
                    Ok(()) => return,
                    Err(error) => format!(
                        "the line to the printer is lost ({error}); a job on it is over, and a Ferrostep board switches its heaters off 30 \
                         minutes after the last line"
                    ),
                }
            }
            Err(error) => error,
        };
        disconnect(host, lost);
        for _ in 0..LOOKS_UNTIL_RETRY {
            if ends() {
                return;
            }
            thread::sleep(LOOK);
        }
    }
}

fn prepare(host: &PageHost, line: &mut PrinterLine) -> io::Result<()> {
    if host.setup.readings == Readings::Asked {
        line.send(REPORTS)?;
    }
    let mut inner = host.lock();
    inner.wishes = Wishes::default();
    (inner.phase, inner.is_halted, inner.owed, inner.message) = (Phase::Idle, false, None, None);
    inner.asked_position = Some(Instant::now());
    inner.output = Some(line.output());
    Ok(())
}

fn disconnect(host: &PageHost, why: String) {
    let mut inner = host.lock();
    (inner.phase, inner.output, inner.owed) = (Phase::Disconnected, None, None);
    (inner.heat, inner.position_mm) = (None, None);
    inner.waiting.clear();
    inner.wishes = Wishes::default();
    if inner.message.as_ref() != Some(&why) {
        inner.console.add(Speaker::Host, &why);
    }
    inner.message = Some(why);
    host.ownership.release_page();
}

/// Next thing to do.
enum Task {
    Print(Arc<NamedTempFile>),
    Line(String),
    Listen,
}

/// Talks over an open line.
///
/// # Errors
/// The line is lost.
fn talk(host: &PageHost, line: &mut PrinterLine, ends: &impl Fn() -> bool) -> io::Result<()> {
    while !ends() {
        match next_task(host) {
            Task::Print(file) => print(host, line, &file, ends)?,
            Task::Line(text) => line.send(format!("{text}\n").as_bytes())?,
            Task::Listen => {}
        }
        if let Some(said) = line.receive(Instant::now() + LOOK)? {
            host.hear(&said);
            answered(host, line, &said)?;
        }
    }
    if host.setup.readings == Readings::Asked {
        line.send(NO_REPORTS)?;
        // Its answer must not be the first that the next host hears.
        let end = Instant::now() + LAST_ANSWER;
        while let Some(said) = line.receive(end)?
            && !said.starts_with("ok")
        {
            host.hear(&said);
        }
    }
    Ok(())
}

fn next_task(host: &PageHost) -> Task {
    let mut inner = host.lock();
    if std::mem::take(&mut inner.wishes.start)
        && let Some(job) = &inner.job
    {
        return Task::Print(Arc::clone(&job.file));
    }
    if inner.owed.is_some_and(|(since, _)| since.elapsed() >= ANSWER) {
        inner.owed = None;
        inner.console.add(Speaker::Host, "the printer has not answered the last line");
    }
    if inner.owed.is_some() {
        return Task::Listen;
    }
    if let Some(line) = inner.waiting.pop_front() {
        inner.owed = Some((Instant::now(), true));
        return Task::Line(line);
    }
    host.ownership.release_page();
    Task::Listen
}

/// Notes an answer to a person's line, and asks for the resulting state.
fn answered(host: &PageHost, line: &mut PrinterLine, said: &str) -> io::Result<()> {
    let mut inner = host.lock();
    let is_answer = said.starts_with("ok") || said.starts_with(HALTED);
    if let Some((since, _)) = &mut inner.owed
        && said.starts_with("echo:busy:")
    {
        *since = Instant::now();
    }
    if !is_answer {
        return Ok(());
    }
    let was_persons = matches!(inner.owed.take(), Some((_, true)));
    if was_persons && host.setup.readings == Readings::Asked {
        inner.asked_position = Some(Instant::now());
        inner.owed = Some((Instant::now(), false));
        drop(inner);
        line.send(b"M114\n")?;
    }
    Ok(())
}

/// Prints a file to its end, or ends it.
///
/// # Errors
/// The line is lost.
fn print(host: &PageHost, line: &mut PrinterLine, file: &NamedTempFile, ends: &impl Fn() -> bool) -> io::Result<()> {
    let message = match JobLines::open(file.path()) {
        Ok(mut lines) => {
            let mut watch = Watching::new(host, ends);
            let outcome =
                send::send_lines(line, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, &mut watch);
            match (lines.failed, outcome) {
                (Some(error), _) => format!("the file cannot be read on: {error}; {}", end(host, line)),
                (None, Err(SendError::Port(error))) => return Err(error),
                (None, outcome) => describe(host, line, outcome),
            }
        }
        Err(error) => error,
    };
    let mut inner = host.lock();
    inner.console.add(Speaker::Host, &message);
    (inner.phase, inner.message, inner.wishes) = (Phase::Idle, Some(message), Wishes::default());
    if let Some(job) = &mut inner.job {
        job.line = 0;
    }
    Ok(())
}

/// Describes how a job ended; a job that stopped early is also ended in the printer.
fn describe(host: &PageHost, line: &mut PrinterLine, outcome: Result<Outcome, SendError>) -> String {
    match outcome {
        Ok(Outcome { stop: None, sent, resends, .. }) => format!("printed: {sent} lines sent, {resends} of them again"),
        Ok(Outcome { stop: Some(Stop::Asked), file_line, .. }) => {
            format!("cancelled after line {file_line} of the file; {}", end(host, line))
        }
        Ok(Outcome { stop: Some(stop), file_line, .. }) => {
            format!("ended after line {file_line} of the file: {stop}; {}", end(host, line))
        }
        Err(error) => error.to_string(),
    }
}

/// Ends waits, motion and heat.
fn end(host: &PageHost, line: &mut PrinterLine) -> String {
    host.lock().phase = Phase::Cancelling;
    send::cool_down(line, |said| host.hear(said)).describe()
}
