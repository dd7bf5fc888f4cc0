//! `ferrostep post-process`.

use std::process::ExitCode;

use ferrostep_post_process::{Additions, Failure, Options, post_process};
use ferrostep_session::desk::{Figures, LOOK_AHEAD_BLOCKS};
use ferrostep_session::job::JobProgress;
use ferrostep_session::rules::RuledMachine;
use ferrostep_session::{JobReplies, Session};

use crate::arguments::PostProcessArguments;
use crate::machine;
use crate::outcome::{exit_code, result};
use crate::progress::Progress;
use crate::protected::{inputs, profile_file};

/// Writes the time of the print into its file.
pub fn run(arguments: &PostProcessArguments) -> Result<ExitCode, String> {
    let named = arguments.profile.as_deref();
    let machine = machine::of_file(named, arguments.rules, &arguments.file)?;
    let RuledMachine { profile, by, .. } = machine.ruled().map_err(|error| error.to_string())?;
    let protected = match arguments.out {
        Some(_) => inputs(&arguments.file, &machine.origin),
        None => profile_file(&machine.origin).into_iter().collect(),
    };
    let options = Options {
        file: &arguments.file,
        out: arguments.out.as_deref(),
        additions: Additions { progress: !arguments.no_m73, mark: arguments.mark.as_deref() },
        protected: &protected,
    };
    let progress = Progress::new();
    // A slicer shows what its scripts say: only what stops the job.
    let replies = JobReplies::new(|text: &str| {
        if text.starts_with("Error:") {
            progress.say(text);
        }
    });
    let look = |share, done: &JobProgress, figures: &dyn Fn() -> Figures| progress.show(share, done, figures);
    let outcome = match by {
        None => post_process(&options, &Session::estimate(profile, LOOK_AHEAD_BLOCKS, replies), look),
        Some(by) => post_process(&options, &Session::by_rules(profile, by, replies), look),
    };
    progress.end();
    match outcome {
        Ok(report) => Ok(result(arguments.json.then_some(&report), || format!("{report}\n"))),
        Err(Failure::Job(reason)) => Ok(exit_code(Err(reason))),
        Err(Failure::Start(reason)) => Err(reason),
    }
}
