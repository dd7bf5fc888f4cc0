//! The job of a command: opened, executed on a session, and summed up.

use std::cell::Cell;
use std::path::Path;
use std::process::ExitCode;

use ferrostep_host::printable;
use ferrostep_printer::Profile;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::desk::Desk;
use ferrostep_session::input::{self, Input};
use ferrostep_session::job::JobProgress;
use ferrostep_session::remarks::Remark;
use ferrostep_session::summed_up::{Wanted, summed_up};
use ferrostep_session::took::Took;
use ferrostep_session::{JobReplies, Session};

use crate::arguments::JobArguments;
use crate::machine;
use crate::outcome::{exit_code, result};
use crate::progress::Progress;

/// Maximum number of the machine's notices that are shown; a broken file could cause one a line.
const MAX_NOTICES: u32 = 20;

/// The machine, of this profile if one is named, and the open file of a job.
pub fn open(job: &JobArguments, named: Option<&str>) -> Result<(Profile, Input), String> {
    let input = open_file(job)?;
    let machine = machine::of_job(named, Some(PlannedBy::Own), &job.file, &input)?;
    Ok((machine.ruled().map_err(|error| error.to_string())?.profile, input))
}

/// The open file of a job.
pub fn open_file(job: &JobArguments) -> Result<Input, String> {
    Input::open(&job.file).map_err(|error| format!("{}: {error}", input::name(&job.file)))
}

/// Shows the machine's messages: errors always, notices up to a maximum.
pub fn replies(progress: &Progress) -> JobReplies<'_> {
    let shown = Cell::new(0);
    JobReplies::new(move |text: &str| {
        shown.set(shown.get() + 1);
        match shown.get() {
            // An error says why the machine stopped, and is shown after any number of notices.
            _ if text.starts_with("Error:") => progress.say(text),
            ..=MAX_NOTICES => progress.say(text),
            count if count == MAX_NOTICES + 1 => progress.say("(further notices of the machine are left out)"),
            _ => {}
        }
    })
}

/// Returns exit status 1 on any remark that is not harmless, for `--strict`.
pub fn strict(file: &Path, remarks: &[Remark]) -> ExitCode {
    let remarks: Vec<&Remark> = remarks.iter().filter(|remark| !remark.kind.is_harmless()).collect();
    match remarks[..] {
        [] => ExitCode::SUCCESS,
        [first, ..] => {
            let name = printable::name(file);
            let count = match remarks.len() {
                1 => "1 remark".to_owned(),
                count => format!("{count} remarks"),
            };
            exit_code(Err(format!("{name}: {count}, and none expected (--strict): {first}")))
        }
    }
}

/// Runs the job, a prepared one from a frame on, and prints its summary. `explain` tells, of the
/// estimated time, possible reasons for a measured one.
pub fn run<D: Desk>(
    job: &JobArguments,
    mut input: Input,
    session: &Session<D, JobReplies<'_>>,
    progress: &Progress,
    from: u32,
    explain: impl FnOnce(f64) -> Result<Option<Took>, String>,
) -> ExitCode {
    let place = input.place();
    let look = |job: &JobProgress| progress.show(place.share(), job, || session.figures());
    let between = || progress.pass_time(|| session.figures());
    let wanted = Wanted { from, has_parts: job.json };
    let (mut summary, outcome) = summed_up(&job.file, &mut input, session, wanted, look, between);
    progress.end();
    // A job that stops has no whole time to compare with.
    if outcome.is_ok() {
        match explain(summary.print_time_s) {
            Ok(took) => summary.took = took,
            Err(problem) => return exit_code(Err(format!("{}: {problem}", input::name(&job.file)))),
        }
    }
    let code = result(job.json.then_some(&summary), || format!("{summary}\n"));
    match outcome {
        Ok(()) if job.strict && code == ExitCode::SUCCESS => {
            strict(&job.file, summary.remarks.as_deref().unwrap_or_default())
        }
        Ok(()) => code,
        Err(error) => exit_code(Err(format!("{}: {error}", input::name(&job.file)))),
    }
}
