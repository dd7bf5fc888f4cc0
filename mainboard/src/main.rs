//! The virtual mainboard's command: prints on it, leads its line out, breaks its parts, counts.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use ferrostep_mainboard::commands::{count::Count, print::Print, serve::Serve};
use ferrostep_mainboard::faults::command::Faults;

/// Printer boards around an emulated STM32F4, on which the shipped images run unmodified.
#[derive(Parser)]
#[command(version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Prints a file, and compares the pins with the desk's trace.
    Print(Print),
    /// Leads the printer's line out, for any host.
    Serve(Serve),
    /// Lets parts fail at random instants of a print, and tells what the printer did.
    Faults(Faults),
    /// Runs a bench or a test that prints by semihosting and ends itself.
    Count(Count),
}

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Print(print) => print.run(),
        Command::Serve(serve) => serve.run(),
        Command::Faults(faults) => faults.execute(),
        Command::Count(count) => count.run(),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
