//! The files that a command reads: none of its outputs may replace them.

use std::path::Path;

use ferrostep_session::output::Protected;

/// The files that a job is read from: no output may replace them.
pub fn inputs<'a>(job: &'a Path, profile: &'a str) -> Vec<Protected<'a>> {
    let mut inputs = vec![Protected { path: job, what: "the job to be read" }];
    inputs.extend(profile_file(profile));
    inputs
}

/// The file of a profile, if it is not built in.
pub fn profile_file(profile: &str) -> Option<Protected<'_>> {
    let is_file = ferrostep_profiles::builtin_text(profile).is_none();
    is_file.then(|| Protected { path: Path::new(profile), what: "the profile" })
}
