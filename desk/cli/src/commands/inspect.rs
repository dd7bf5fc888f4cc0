//! `ferrostep inspect`.

use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::ExitCode;

use ferrostep_session::gpre::{self, InspectError, Shown};
use ferrostep_session::input::{self, Input};

use crate::outcome::exit_code;
use crate::terminal;

/// Shows what is in a prepared job, or what its slicer says in a binary one.
pub fn run(file: &Path, shown: Shown) -> Result<ExitCode, String> {
    let name = input::name(file);
    let input = Input::open(file).map_err(|error| format!("{name}: {error}"))?;
    if let (Some(description), Shown::Frames) = (input.description(), shown) {
        return Ok(exit_code(terminal::write_result(&description.to_string())));
    }
    if !input.is_prepared() {
        return Err(format!(
            "{name}: this is G-code, and inspect reads prepared jobs (`ferrostep preprocess` makes one) and binary G-code: \
             `ferrostep estimate` gives its time"
        ));
    }
    let mut out = BufWriter::new(std::io::stdout().lock());
    let outcome = gpre::inspect(input, shown, &mut out);
    let code = match outcome {
        Ok(()) => exit_code(terminal::result_written(out.flush())),
        Err(InspectError::Write(error)) => exit_code(terminal::result_written(Err(error))),
        Err(InspectError::Job(error)) => {
            let _ = out.flush();
            exit_code(Err(format!("{name}: {error}")))
        }
    };
    Ok(code)
}
