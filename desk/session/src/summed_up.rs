//! Executes a job on a session and sums it up.

use std::path::Path;
use std::rc::Rc;
use std::time::Instant;

use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;

use crate::desk::{Desk, LineEnds, MotionState};
use crate::extent::ExtentFinder;
use crate::gpre;
use crate::input::Input;
use crate::job::{self, JobError, JobProgress};
use crate::macros::Macros;
use crate::parts::Parts;
use crate::report::{Motors, Stop, Summary};
use crate::watch::Watch;
use crate::{JobReplies, Session};

/// The part of a job to execute, and the extent of its summary.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted {
    /// Frame of a prepared job with which it begins; 0 for its start.
    pub from: u32,
    /// True if the summary lists the print's parts.
    pub has_parts: bool,
}

/// Executes a job and returns its summary, with the error that stopped it early.
///
/// `look` is called from time to time; `between` after each passing of time of a prepared job.
pub fn summed_up<D: Desk>(
    file: &Path,
    input: &mut Input,
    session: &Session<D, JobReplies<'_>>,
    wanted: Wanted,
    look: impl FnMut(&JobProgress),
    mut between: impl FnMut(),
) -> (Summary, Result<(), JobError>) {
    let started = Instant::now();
    let profile = session.profile();
    let mut printer = session.printer();
    let mut done = JobProgress::default();
    let mut watch = Watch::new(profile, session.replies().remarks()).with_refusals(session.desk().refusals());
    let ends = Rc::new(LineEnds::default());
    let follows = wanted.has_parts && !input.is_prepared() && session.desk().follow_lines(Rc::clone(&ends));
    let mut parts =
        follows.then(|| Parts::new(ends, || (session.desk().now_ns() as f64 * 1e-9, session.desk().state().tick())));
    let mut extent = ExtentFinder::default();
    let outcome = if input.is_prepared() {
        // A prepared job is planned already, and most of it fits into the look-ahead: only its
        // execution takes time.
        let job = gpre::play_from(wanted.from, input, profile, &mut printer, &mut done, look);
        session.run_with(job, |_| between())
    } else {
        let mut watches = (&mut extent, &mut watch);
        let mut onlookers = (&mut watches, &mut parts);
        let run = job::run_watched(input, &mut printer, &mut done, Macros::chosen(), &mut onlookers, look);
        let outcome = session.run(run);
        watch.end_of_text(outcome.is_ok());
        outcome
    };
    watch.end(&session.heating(), outcome.is_ok());
    let wall_s = started.elapsed().as_secs_f64();

    let figures = session.figures();
    let report = session.desk().rules();
    let mut remarks = session.replies().remarks().to_vec();
    if let Some(report) = &report {
        report.keep(&mut remarks);
    }
    let (rules, limits) = report.map(|report| (report.name, report.limits)).unzip();
    let tally = printer.tally();
    let summary = Summary {
        file: file.to_string_lossy().into_owned(),
        profile: profile.name.to_owned(),
        lines: done.lines,
        moves: tally.moves,
        unknown_commands: session.replies().unknown_commands(),
        clamped_moves: tally.clamped_moves,
        extent_mm: extent.extent(),
        print_time_s: figures.print_time_s,
        motion_time_s: figures.motion_time_s,
        rules,
        limits,
        took: None,
        filament_mm: tally.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
        position_mm: printer.logical_10nm().map(|length| length as f64 / UNITS_PER_MM as f64).into(),
        motors: D::MAKES_STEPS.then(|| Motors::from(&figures)),
        wall_s,
        realtime_factor: figures.motion_time_s / wall_s.max(1e-9),
        layers: done.layers,
        parts: parts.map(Parts::finish),
        slicer: input.description().map(|description| description.figures.clone()),
        slicer_time_s: done.slicer_time_s.or(input.description().and_then(|said| Some(said.figures.time_s?.into()))),
        remarks: Some(remarks),
        stopped: outcome.as_ref().err().map(Stop::from),
    };
    (summary, outcome)
}
