//! The virtual mainboard's command: prints on it, serves its line, injects faults,
//! counts instructions.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use ferrostep_mainboard::commands::{count::Count, print::Print, serve::Serve};
use ferrostep_mainboard::faults::command::Faults;

/// Printer boards around an emulated STM32F4 that run the shipped images unmodified.
#[derive(Parser)]
#[command(version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Prints a file and compares the pins with the desk's trace.
    Print(Print),
    /// Serves the printer on a pseudo-terminal or TCP port, for any host program.
    Serve(Serve),
    /// Injects faults at random instants of a print and checks how the printer reacts.
    Faults(Faults),
    /// Runs a benchmark or test that prints by semihosting and ends itself.
    Count(Count),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Print(print) => print.run(),
        Command::Serve(serve) => serve.run(),
        Command::Faults(faults) => faults.execute(),
        Command::Count(count) => count.run(),
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
