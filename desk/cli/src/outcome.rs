//! Ends a command: writes its result to standard output, and returns its exit status.

use std::error::Error;
use std::num::{ParseFloatError, ParseIntError};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};

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
    let worded = in_words(answer);
    let answer = worded.as_ref().unwrap_or(answer);
    let written = answer.print().and_then(|()| std::io::Write::flush(&mut std::io::stdout()));
    match answer.exit_code() {
        0 => exit_code(terminal::result_written(written)),
        code => u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from),
    }
}

/// The refusal of a number in words: clap repeats those of the parser ("invalid digit found in
/// string", "1 is not in 2..=99"), which do not say what to write.
fn in_words(answer: &clap::Error) -> Option<clap::Error> {
    let parser = answer.source()?;
    let expected = if parser.is::<ParseFloatError>() {
        "expected a number such as 12.5".to_owned()
    } else if parser.is::<ParseIntError>() {
        "expected a whole number".to_owned()
    } else {
        let says = parser.to_string();
        let (_, range) = says.split_once(" is not in ")?;
        let (lowest, highest) = range.split_once("..=")?;
        format!("expected a whole number from {lowest} to {highest}")
    };
    let (ContextValue::String(argument), ContextValue::String(value)) =
        (answer.get(ContextKind::InvalidArg)?, answer.get(ContextKind::InvalidValue)?)
    else {
        return None;
    };
    let message =
        format!("invalid value '{value}' for '{argument}': {expected}\n\nFor more information, try '--help'.\n");
    Some(clap::Error::raw(answer.kind(), message))
}
