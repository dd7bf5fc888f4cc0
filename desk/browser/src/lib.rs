//! The program inside the page that reads a print in a browser: `estimate` and `show` for one file.
//!
//! It runs as a WASI command in a worker, and like any program on the desk: its arguments name the
//! job's file, the machine and the page to write, and it reports [`Event`]s as lines of JSON on
//! standard output. It starts no thread.

mod machine;
pub mod page;
mod request;

use std::cell::Cell;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use ferrostep_analysis::recording::{self, MAX_NODES};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input::Input;
use ferrostep_session::report::{Motors, Summary};
use ferrostep_session::summed_up::{Wanted, summed_up};
use ferrostep_session::{JobReplies, Session};
use ferrostep_show::{Finding, write_page};
use serde::Serialize;

pub use machine::{Kept, Machine, OF_JOB};
pub use request::Request;

/// Largest file whose time is also estimated with other limits, bytes: as `ferrostep show` has it.
const MAX_ASKED_BYTES: u64 = 32 << 20;

/// Minimum time between two reports of the progress.
const INTERVAL: Duration = Duration::from_millis(50);

/// Maximum number of notices of the machine that are reported; a broken file could cause one a
/// line.
const MAX_NOTICES: u32 = 20;

/// A report to the page.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// The work's progress.
    Progress {
        /// Step: `estimate`, `record`, `compare` or `write`.
        step: &'static str,
        /// Share of the step, 0 to 1.
        share: f64,
    },
    /// A message of the machine.
    Notice(String),
    /// Sentence about the values taken from the slicer's comments for the machine.
    Taken(String),
    /// The machine that a configuration describes.
    Machine(Kept),
    /// The result; the page is written.
    Done(Box<Done>),
    /// The reason for which there is no result.
    Error(String),
}

/// The result.
#[derive(Debug, Serialize)]
pub struct Done {
    /// The summary, as `estimate --json` has it.
    pub summary: Summary,
    /// The same as `estimate` prints it.
    pub text: String,
    /// The steps, as `print --json` has them.
    pub steps: Motors,
    /// The findings of the page.
    pub findings: Vec<Finding>,
}

/// Reads the job, writes its page, and reports on the way.
///
/// # Errors
/// The machine or the job cannot be read, or the page cannot be written: words for a person. A job
/// that stops at a line has a page up to there, and its summary says that it stopped.
pub fn answer(request: &Request, tell: impl Fn(&Event)) -> Result<(), String> {
    let Machine { profile, by, name: machine, note, kept } = Machine::of(request)?;
    if let Some(note) = note {
        tell(&Event::Taken(note));
    }
    if let Some(kept) = kept {
        tell(&Event::Machine(kept));
    }
    let file = request.job.as_path();
    let open = || Input::open(file).map_err(|error| format!("{}: {error}", request.job_name()));
    let reported = Cell::new(None::<Instant>);
    let report = |step, share: Option<f64>| {
        if reported.get().is_none_or(|last| last.elapsed() >= INTERVAL) {
            reported.set(Some(Instant::now()));
            tell(&Event::Progress { step, share: share.unwrap_or(0.0) });
        }
    };

    let mut input = open()?;
    if input.is_prepared() {
        return Err(format!(
            "{}: this is a prepared job, and the page takes G-code: `ferrostep show` shows a prepared job",
            request.job_name()
        ));
    }
    let place = input.place();
    let name = Path::new(request.job_name());
    let silent = || JobReplies::new(|_: &str| {});
    let look = |_: &_| report("estimate", place.share());
    let (summary, _) = match by.clone() {
        None => {
            let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, silent());
            summed_up(name, &mut input, &session, Wanted::default(), look, || {})
        }
        Some(by) => {
            let session = Session::by_rules(profile, by, silent());
            summed_up(name, &mut input, &session, Wanted::default(), look, || {})
        }
    };

    let mut input = open()?;
    let place = input.place();
    let notices = Cell::new(0);
    let replies = JobReplies::new(|text: &str| {
        notices.set(notices.get() + 1);
        if notices.get() <= MAX_NOTICES || text.starts_with("Error:") {
            tell(&Event::Notice(text.to_owned()));
        }
    });
    let look = |_: &_, _: &_| report("record", place.share());
    let shown = recording::record(profile, by.clone(), &mut input, MAX_NODES, replies, look)
        .map_err(|error| error.to_string())?;
    // The gain of other limits is asked of this firmware's planner, as `ferrostep show` does.
    let asks = by.is_none() && shown.stopped.is_none() && input.size_bytes() <= MAX_ASKED_BYTES;
    let mut chances = Vec::new();
    if asks {
        for chance in recording::chances_in_turn(profile, file) {
            chances.push(chance);
            tell(&Event::Progress { step: "compare", share: chances.len() as f64 / 4.0 });
        }
    }
    tell(&Event::Progress { step: "write", share: 0.0 });
    let slicer_time_s = input.description().and_then(|said| Some(said.figures.time_s?.into()));
    let mut job = shown.job(name, &profile, slicer_time_s, chances);
    job.profile = machine;
    let write = || {
        let mut out = BufWriter::with_capacity(1 << 16, File::create(&request.page)?);
        write_page(&mut out, &job, &shown.recording, &shown.text)?;
        out.flush()
    };
    write().map_err(|error| format!("the page cannot be written: {error}"))?;
    let text = summary.to_string();
    let steps = Motors::from(&shown.figures);
    tell(&Event::Done(Box::new(Done { summary, text, steps, findings: job.findings })));
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples");

    fn asked(job: &Path, page: &Path) -> (Result<(), String>, Vec<serde_json::Value>) {
        let request =
            Request { job: job.to_owned(), page: page.to_owned(), machine: "cartesian".to_owned(), rules: None };
        let told = RefCell::new(Vec::new());
        let outcome = answer(&request, |event| told.borrow_mut().push(serde_json::to_value(event).unwrap()));
        (outcome, told.into_inner())
    }

    #[test]
    fn a_job_has_a_page_and_the_estimates_summary() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("page.html");
        let job = Path::new(EXAMPLES).join("cube.bgcode");
        let (outcome, told) = asked(&job, &page);
        outcome.unwrap();
        let progress = &told.first().unwrap()["progress"];
        assert_eq!(progress["step"], "estimate");
        let done = &told.last().unwrap()["done"];
        assert_eq!(done["summary"]["file"], "cube.bgcode");
        assert!(done["summary"]["moves"].as_u64() > Some(1000), "{done}");
        assert!(done["text"].as_str().unwrap().starts_with("cube.bgcode on cartesian: done\n"), "{done}");
        assert_eq!(done["steps"]["step_digest"].as_str().unwrap().len(), 16);
        assert!(std::fs::read_to_string(page).unwrap().starts_with("<!doctype html><!-- ferrostep show -->"));
    }

    #[test]
    fn a_job_that_stops_has_a_page_up_to_there() {
        let folder = tempfile::tempdir().unwrap();
        let [job, page] = ["cold.gcode", "page.html"].map(|name| folder.path().join(name));
        std::fs::write(&job, "G28\nG1 X10 F6000\nG1 X20 E5\n").unwrap();
        let (outcome, told) = asked(&job, &page);
        outcome.unwrap();
        assert_eq!(told.last().unwrap()["done"]["summary"]["stopped"]["line"], 3);
        assert!(page.is_file());
    }

    #[test]
    fn a_file_that_is_no_job_makes_no_page() {
        let folder = tempfile::tempdir().unwrap();
        let [job, page] = ["job.gcode", "page.html"].map(|name| folder.path().join(name));
        std::fs::write(&job, b"\x89PNG\r\n\x1a\n").unwrap();
        let (outcome, _) = asked(&job, &page);
        assert!(outcome.unwrap_err().starts_with("job.gcode: "));
        assert!(!page.exists());
    }
}
