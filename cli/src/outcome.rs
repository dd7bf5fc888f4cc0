//! How a command ends: its result on standard output, and its exit status.

use std::process::ExitCode;

use ferrostep::terminal::{self, tell};

/// Writes the result, as JSON if given. Exit status 1 if it cannot be written.
pub fn result(json: Option<impl serde::Serialize>, text: impl FnOnce() -> String) -> ExitCode {
    let written = match json {
        Some(json) => terminal::write_json(&json),
        None => terminal::write_result(&text()),
    };
    exit_code(written)
}

/// Success, or exit status 1 with the error on standard error.
pub fn exit_code(written: Result<(), impl std::fmt::Display>) -> ExitCode {
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell(format_args!("error: {error}"));
            ExitCode::from(1)
        }
    }
}
