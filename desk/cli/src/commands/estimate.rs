//! `ferrostep estimate`.

use std::process::ExitCode;

use ferrostep_session::Session;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input;

use crate::arguments::JobArguments;
use crate::job::{self, open, replies};
use crate::progress::Progress;

/// Plans the job without making its steps, and reports time and material.
pub fn run(arguments: &JobArguments) -> Result<ExitCode, String> {
    let (profile, input) = open(arguments)?;
    if input.is_prepared() {
        return Err(format!(
            "{}: this is a prepared job, and estimate takes G-code: `ferrostep inspect` shows a prepared job's time",
            input::name(&arguments.file)
        ));
    }
    let progress = Progress::new();
    let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, replies(&progress));
    Ok(job::run(arguments, input, &session, &progress, 0))
}
