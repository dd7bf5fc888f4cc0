//! `ferrostep estimate`.

use std::process::ExitCode;

use ferrostep_profiles::PlannedBy;
use ferrostep_session::Session;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input;
use ferrostep_session::rules::RuledMachine;

use crate::arguments::JobArguments;
use crate::job::{self, open_file, replies};
use crate::machine::Machine;
use crate::progress::Progress;

/// Plans the job without making its steps, by the rules that are asked for or else the profile's,
/// and reports time and material.
pub fn run(arguments: &JobArguments, rules: Option<PlannedBy>) -> Result<ExitCode, String> {
    let input = open_file(arguments)?;
    let Machine { ruled: RuledMachine { profile, by }, .. } =
        Machine::of_job(arguments.profile.as_deref(), rules, &arguments.file, &input)?;
    if input.is_prepared() {
        return Err(format!(
            "{}: this is a prepared job, and estimate takes G-code: `ferrostep inspect` shows a prepared job's time",
            input::name(&arguments.file)
        ));
    }
    let progress = Progress::new();
    Ok(match by {
        None => {
            let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, replies(&progress));
            job::run(arguments, input, &session, &progress, 0)
        }
        Some(by) => job::run(arguments, input, &Session::by_rules(profile, by, replies(&progress)), &progress, 0),
    })
}
