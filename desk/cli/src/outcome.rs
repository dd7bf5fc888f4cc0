//! Ends a command: writes its result to standard output, and returns its exit status.

use std::process::ExitCode;

use crate::terminal::{self, tell};

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

/// Writes what clap answers instead of running a command: help, the version, or what is wrong
/// with the arguments.
pub fn of_arguments(answer: &clap::Error) -> ExitCode {
    let written = answer.print().and_then(|()| std::io::Write::flush(&mut std::io::stdout()));
    match answer.exit_code() {
        0 => exit_code(terminal::result_written(written)),
        code => u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from),
    }
}
