//! The machine of a command.

use std::path::Path;

use ferrostep_analysis::job_machine::JobMachine;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::input::Input;

use crate::terminal::tell;

pub use ferrostep_analysis::job_machine::name_or_path;

/// The machine of an open job; tells the person the values taken from the slicer's comments.
pub fn of_job(named: Option<&str>, asked: Option<PlannedBy>, file: &Path, input: &Input) -> Result<JobMachine, String> {
    told(JobMachine::of(named, asked, file, input).map_err(|error| error.to_string())?)
}

/// The same of a file that the command opens itself.
pub fn of_file(named: Option<&str>, asked: Option<PlannedBy>, file: &Path) -> Result<JobMachine, String> {
    told(JobMachine::of_file(named, asked, file).map_err(|error| error.to_string())?)
}

fn told(machine: JobMachine) -> Result<JobMachine, String> {
    if let Some(note) = &machine.note {
        tell(format_args!("note: {note}"));
    }
    Ok(machine)
}
