//! The page's requests: what is known goes out, wishes are noted or refused in clear words.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Weak};
use std::thread;
use std::time::Instant;

use ferrostep_web::{Activity, ConsoleLine, Control, Job, Printer, Refusal, Speaker, State, Upload};

use super::job_lines::JobLines;
use super::shared::{Inner, PageHost, PageJob, Phase, Wishes};
use crate::desk::LOOK_AHEAD_BLOCKS;
use crate::schedule::Schedule;

/// Maximum number of persons' lines that wait for the printer.
const MAX_WAITING: usize = 16;

/// Longest line, as of the printer: with its number and checksum it has 96 characters there.
const MAX_LINE: usize = 80;

/// The page's side of a host.
pub struct PageSide(pub Arc<PageHost>);

fn refuse<T>(why: impl Into<String>) -> Result<T, Refusal> {
    Err(Refusal(why.into()))
}

impl PageSide {
    fn host(&self) -> &PageHost {
        &self.0
    }

    /// The other host, in words, while it owns the line.
    fn owner(&self) -> Option<String> {
        let place = self.host().setup.outside.as_deref().unwrap_or("another line");
        self.host().ownership.is_outsides().then(|| {
            format!("A host at {place} uses this printer until it disconnects: from here only the emergency stop acts.")
        })
    }

    /// Takes the line for the page.
    fn take_line(&self) -> Result<(), Refusal> {
        if self.host().ownership.take_for_page() {
            return Ok(());
        }
        refuse(self.owner().unwrap_or_else(|| "another host uses this printer: try again".to_owned()))
    }

    /// Checks that the printer reads a line with this command now, and takes the line to it.
    fn may_send(&self, inner: &Inner, command: &str) -> Result<(), Refusal> {
        match inner.phase {
            Phase::Disconnected => refuse("the line to the printer is not open"),
            Phase::Idle => self.take_line(),
            Phase::Printing if command.starts_with('M') && !matches!(command, "M410" | "M876" | "M110") => Ok(()),
            Phase::Printing => refuse(format!("{command} would act in the middle of the print: cancel it first")),
            Phase::Pausing | Phase::Paused | Phase::Cancelling => {
                refuse("the printer reads no lines during a pause: press Resume or Cancel")
            }
        }
    }

    /// Sends a command that acts as its bytes arrive.
    fn send_at_once(&self, command: &str) -> Result<(), Refusal> {
        let output = self.host().lock().output.clone();
        let Some(output) = output else { return refuse("the line to the printer is not open") };
        self.host().lock().console.add(Speaker::Person, command);
        // A line that was cut off by a port that does not take its bytes must not hide it.
        output
            .send(format!("\n{command}\n").as_bytes())
            .map_err(|error| Refusal(format!("{command} was not sent: {error}")))
    }
}

/// The part of a file's lines that is done.
fn share_of_lines(job: &PageJob) -> f64 {
    job.lines.map_or(0.0, |lines| (f64::from(job.line) / f64::from(lines.max(1))).min(1.0))
}

/// A wish that needs a job under way.
fn in_job(inner: &Inner) -> Result<(), Refusal> {
    if inner.phase.is_job() { Ok(()) } else { refuse("nothing is being printed") }
}

/// Appends lines that belong together to those that wait.
fn queue(inner: &mut Inner, lines: Vec<String>) -> Result<(), Refusal> {
    if inner.waiting.len().saturating_add(lines.len()) > MAX_WAITING {
        let waiting = inner.waiting.len();
        return refuse(format!("{waiting} lines wait for the printer already: M108 ends its wait, M410 its motion"));
    }
    for line in lines {
        inner.console.add(Speaker::Person, &line);
        inner.waiting.push_back(line);
    }
    Ok(())
}

/// Checks that the nozzle is warm enough for filament to move.
fn warm_enough(inner: &Inner, least_celsius: f32) -> Result<(), Refusal> {
    match inner.heat {
        Some(heat) if heat.nozzle_celsius >= f64::from(least_celsius) => Ok(()),
        Some(heat) => refuse(format!(
            "the nozzle is at {:.0} °C, and filament moves from {least_celsius:.0} °C on: heat it first",
            heat.nozzle_celsius
        )),
        None => refuse("the nozzle's temperature is not known yet: filament moves in a warm nozzle only"),
    }
}

/// A person's line as it is sent: without comment, and nothing in it that would make
/// it another line.
fn checked(line: &str) -> Result<String, Refusal> {
    let text = line.split(';').next().unwrap_or_default().trim();
    if text.is_empty() {
        return refuse("the line is empty");
    }
    if text.len() > MAX_LINE || !text.bytes().all(|byte| matches!(byte, b' '..=b'~')) {
        return refuse(format!("a line has at most {MAX_LINE} characters, all of them ASCII"));
    }
    let is_numbered = text.get(..1).is_some_and(|first| first.eq_ignore_ascii_case("n"));
    if is_numbered || text.contains('*') {
        return refuse("write the line without number and checksum: they are added where they are needed");
    }
    Ok(text.to_owned())
}

impl Printer for PageSide {
    fn state(&self) -> State {
        let inner = self.host().lock();
        let activity = match inner.phase {
            Phase::Disconnected => Activity::Disconnected,
            Phase::Printing => Activity::Printing,
            Phase::Pausing => Activity::Pausing,
            Phase::Paused => Activity::Paused,
            Phase::Cancelling => Activity::Cancelling,
            Phase::Idle if inner.is_halted => Activity::Halted,
            Phase::Idle if inner.owed.is_some() || !inner.waiting.is_empty() => Activity::Working,
            Phase::Idle => Activity::Idle,
        };
        let job = inner.job.as_ref().map(|job| {
            let scheduled = job.schedule.as_ref().map(|schedule| {
                let (total_s, at_s) = (schedule.total_s(), schedule.at_s(job.line));
                (if total_s > 0.0 { (at_s / total_s).clamp(0.0, 1.0) } else { 0.0 }, (total_s - at_s).max(0.0))
            });
            Job {
                name: job.name.clone(),
                bytes: job.bytes,
                line: job.line,
                share: scheduled.map_or_else(|| share_of_lines(job), |(share, _)| share),
                remaining_s: scheduled.map(|(_, left_s)| left_s).or(job.slicer_left_s),
            }
        });
        State {
            machine: self.host().setup.machine.clone(),
            activity,
            owner: self.owner(),
            heat: inner.heat,
            position_mm: inner.position_mm,
            job,
            message: inner.message.clone(),
        }
    }

    fn console(&self, after: u64) -> Vec<ConsoleLine> {
        self.host().lock().console.after(after)
    }

    fn send_line(&self, line: &str) -> Result<(), Refusal> {
        let text = checked(line)?;
        let command = text.split_ascii_whitespace().next().unwrap_or_default().to_ascii_uppercase();
        if command == "M112" {
            return self.stop();
        }
        let mut inner = self.host().lock();
        if inner.phase == Phase::Idle && matches!(command.as_str(), "M108" | "M410" | "M876") {
            self.take_line()?;
            // The line stays the page's until this is answered.
            inner.owed = inner.owed.or(Some((Instant::now(), true)));
            drop(inner);
            return self.send_at_once(&text);
        }
        if inner.phase == Phase::Printing && command == "M108" {
            inner.wishes.wait_ended = true;
            inner.console.add(Speaker::Person, &text);
            return Ok(());
        }
        self.may_send(&inner, &command)?;
        queue(&mut inner, vec![text])?;
        // A printer that does not restart says so again.
        inner.is_halted &= command != "M999";
        Ok(())
    }

    fn control(&self, control: Control) -> Result<(), Refusal> {
        let mut inner = self.host().lock();
        if inner.phase.is_job() && !control.acts_in_a_print() {
            return refuse(
                "a file is being printed, and this would act in the middle of it: wait for its end, or cancel it",
            );
        }
        if inner.is_halted {
            return refuse("the printer is halted: send M999 first");
        }
        if matches!(control, Control::Filament { .. }) {
            warm_enough(&inner, self.host().setup.profile.min_extrusion_celsius)?;
        }
        let lines = control.lines();
        self.may_send(&inner, lines.first().map_or("", String::as_str))?;
        queue(&mut inner, lines)
    }

    fn may_upload(&self) -> Result<(), Refusal> {
        if self.host().lock().phase.is_job() {
            return refuse("a file is being printed: wait for its end, or cancel it");
        }
        Ok(())
    }

    fn upload(&self, upload: Upload) -> Result<(), Refusal> {
        JobLines::open(upload.file.path()).map_err(|error| Refusal(format!("{}: {error}", upload.name)))?;
        let (file, unwanted) = (Arc::new(upload.file), Arc::new(AtomicBool::new(false)));
        let job = PageJob {
            name: upload.name,
            bytes: upload.bytes,
            file: Arc::clone(&file),
            schedule: None,
            lines: None,
            unwanted: Arc::clone(&unwanted),
            line: 0,
            slicer_left_s: None,
        };
        {
            let mut inner = self.host().lock();
            if inner.phase.is_job() {
                return refuse("a file is being printed: wait for its end, or cancel it");
            }
            inner.message = None;
            inner.job = Some(job);
        }
        // The estimate does not keep the file: the program may end before it.
        let (host, path, file) = (Arc::clone(&self.0), file.path().to_owned(), Arc::downgrade(&file));
        let estimate = thread::Builder::new().name("estimate".to_owned()).spawn(move || {
            let schedule = Schedule::of(&path, host.setup.profile, LOOK_AHEAD_BLOCKS, &unwanted);
            let lines = if schedule.is_err() { JobLines::open(&path).ok().map(JobLines::count) } else { None };
            let mut inner = host.lock();
            let is_its = |job: &&mut PageJob| Weak::ptr_eq(&Arc::downgrade(&job.file), &file);
            let Some(job) = inner.job.as_mut().filter(is_its) else { return };
            match schedule {
                Ok(schedule) => job.schedule = Some(schedule),
                Err(error) => {
                    job.lines = lines;
                    let note = format!("note: {}: the printer would stop here: {error}", job.name);
                    inner.console.add(Speaker::Host, &note);
                }
            }
        });
        // The job prints without an estimate of its time.
        drop(estimate);
        Ok(())
    }

    fn start(&self) -> Result<(), Refusal> {
        let mut inner = self.host().lock();
        match inner.phase {
            Phase::Idle => {}
            Phase::Disconnected => return refuse("the line to the printer is not open"),
            _ => return refuse("a file is being printed already"),
        }
        if inner.is_halted {
            return refuse("the printer is halted: send M999, then start again");
        }
        if inner.owed.is_some_and(|(_, is_persons)| is_persons) || !inner.waiting.is_empty() {
            return refuse("the printer works on a line of the console: wait for its end");
        }
        let Some(job) = &mut inner.job else { return refuse("no file: upload one first") };
        job.line = 0;
        job.slicer_left_s = None;
        self.take_line()?;
        inner.wishes = Wishes { start: true, ..Default::default() };
        inner.owed = None;
        (inner.phase, inner.message) = (Phase::Printing, None);
        Ok(())
    }

    fn pause(&self) -> Result<(), Refusal> {
        let mut inner = self.host().lock();
        in_job(&inner)?;
        if inner.phase != Phase::Printing {
            return refuse("the job is not running");
        }
        (inner.phase, inner.wishes.pause) = (Phase::Pausing, true);
        Ok(())
    }

    fn resume(&self) -> Result<(), Refusal> {
        let mut inner = self.host().lock();
        in_job(&inner)?;
        if inner.phase != Phase::Paused {
            return refuse("the job is not paused");
        }
        (inner.phase, inner.wishes.wait_ended) = (Phase::Printing, true);
        Ok(())
    }

    fn cancel(&self) -> Result<(), Refusal> {
        let mut inner = self.host().lock();
        in_job(&inner)?;
        (inner.phase, inner.wishes.end) = (Phase::Cancelling, true);
        Ok(())
    }

    fn stop(&self) -> Result<(), Refusal> {
        self.send_at_once("M112")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_one_line_each() {
        assert_eq!(checked(" m115 ; who "), Ok("m115".to_owned()));
        for line in ["", ";", "M117 \u{e9}", "M105\nM112", "N5 M105", "M105*33", &"M".repeat(81)] {
            assert!(checked(line).is_err(), "{line}");
        }
    }
}
