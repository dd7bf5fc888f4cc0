//! `mainboard faults` on its own.
use clap::Parser;
use ferrostep_mainboard::faults::command::Faults;

/// Faults from outside.
#[derive(Parser)]
struct Command {
    #[command(flatten)]
    faults: Faults,
}

fn main() -> std::process::ExitCode {
    match Command::parse().faults.execute() {
        Ok(true) => std::process::ExitCode::SUCCESS,
        Ok(false) => std::process::ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            std::process::ExitCode::from(2)
        }
    }
}
