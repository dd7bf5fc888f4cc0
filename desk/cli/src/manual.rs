//! Writes shell completions and manual pages from the command line's definition.

use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::{Command, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man;
use ferrostep_host::printable;
use ferrostep_session::output::{Accepted, Output};

use crate::arguments::Arguments;
use crate::outcome::exit_code;
use crate::terminal::{self, tell};

/// Name of the command.
const NAME: &str = "ferrostep";

/// Prints a shell's completion script.
///
/// # Errors
/// No error: the signature is that of all subcommands.
pub fn completions(shell: Shell) -> Result<ExitCode, String> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), NAME, &mut script);
    Ok(exit_code(write(&script)))
}

/// Prints the manual page, or writes all pages into a folder: `ferrostep.1`,
/// `ferrostep-print.1` and so on.
///
/// # Errors
/// A page cannot be written.
pub fn pages(folder: Option<&Path>) -> Result<ExitCode, String> {
    let mut command = Arguments::command();
    command.build();
    let Some(folder) = folder else {
        return Ok(exit_code(write(&page(command).map_err(|error| error.to_string())?)));
    };
    if !folder.is_dir() {
        return Err(format!("{}: no such folder: create it, then write the pages again", printable::name(folder)));
    }
    let parts: Vec<Command> = command.get_subcommands().filter(|part| part.get_name() != "help").cloned().collect();
    for part in std::iter::once(command).chain(parts) {
        // The name of the whole command: `ferrostep-print`.
        let name = part.get_display_name().unwrap_or(NAME).to_owned();
        let path = folder.join(format!("{name}.1"));
        let text = page(part).map_err(|error| error.to_string())?;
        let mut out = Output::create(&path, Accepted::File, &[]).map_err(|error| error.to_string())?;
        out.write_all(&text).map_err(|error| out.failed(error).to_string())?;
        out.keep().map_err(|error| error.to_string())?;
        tell(printable::name(&path));
    }
    Ok(ExitCode::SUCCESS)
}

/// A page in the language of `man`.
fn page(command: Command) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    // The page has no part about a version, which each subcommand would repeat.
    Man::new(command.disable_help_subcommand(true)).render(&mut page)?;
    Ok(page)
}

/// Writes bytes to standard output as they are: a script's control characters belong to it.
fn write(bytes: &[u8]) -> Result<(), String> {
    let mut out = io::stdout().lock();
    terminal::result_written(out.write_all(bytes).and_then(|()| out.flush()))
}
