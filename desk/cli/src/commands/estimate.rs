//! `ferrostep estimate`.

use std::process::ExitCode;

use ferrostep_analysis::took::explain;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::Session;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input;
use ferrostep_session::took::Duration;

use crate::arguments::JobArguments;
use crate::job::{self, open_file, replies};
use crate::machine;
use crate::progress::Progress;

/// Plans the job without making its steps, by the rules that are asked for or else the profile's,
/// and reports time and material.
pub fn run(arguments: &JobArguments, rules: Option<PlannedBy>, took: Option<Duration>) -> Result<ExitCode, String> {
    if took.is_some() && input::is_standard_input(&arguments.file) {
        return Err("--took reads the file once for each limit: give a file, not -".to_owned());
    }
    let input = open_file(arguments)?;
    let machine = machine::of_job(arguments.profile.as_deref(), rules, &arguments.file, &input)?;
    let machine = machine.ruled().map_err(|error| error.to_string())?;
    if input.is_prepared() {
        return Err(format!(
            "{}: this is a prepared job, and estimate takes G-code: `ferrostep inspect` shows a prepared job's time",
            input::name(&arguments.file)
        ));
    }
    let progress = Progress::new();
    let profile = machine.profile;
    let explain = |estimated_s: f64| {
        let Some(Duration(measured_s)) = took else { return Ok(None) };
        explain(&arguments.file, &machine, measured_s, estimated_s).map(Some).map_err(|error| error.to_string())
    };
    Ok(match machine.by.clone() {
        None => {
            let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, replies(&progress));
            job::run(arguments, input, &session, &progress, 0, explain)
        }
        Some(by) => {
            let session = Session::by_rules(profile, by, replies(&progress));
            job::run(arguments, input, &session, &progress, 0, explain)
        }
    })
}
