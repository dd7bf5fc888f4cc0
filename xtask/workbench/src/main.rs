//! The commands of `cargo xtask` that need Ferrostep's own crates, which `xtask`
//! itself does without.
//!
//! `cargo xtask COMMAND` compiles and runs this program. Builds and counts are lists of steps, as
//! in [`xtask`]; the checks of traces and planners print a result.
#![forbid(unsafe_code)]

mod against_klipper;
mod bbf;
mod bench;
mod bresenham_lines;
mod check_trace;
mod critical_sections;
mod feed_plot;
mod firmware;
mod hostile_programs;
mod house;
mod image;
mod mainboard;
mod on_target;
mod page;
mod reference_time;
mod refresh;
mod release;
mod reproducible;
mod size;
mod step_edges;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use ferrostep_oracle::reference::ReferenceProfile;

use steps::{Failure, Run};
// The modules look for these at the root, as in `xtask`.
use xtask::{DESK, FIRMWARE_VARIABLE, HOSTS_VARIABLE, core_library, generated, hosts, policy, share, steps, system};

/// Tasks of the Ferrostep workspace that need its crates.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// The commands; [`xtask::workbench::COMMANDS`] describes each.
#[derive(Clone, Subcommand)]
enum Command {
    Firmware(firmware::Options),
    Bench(bench::Options),
    Flash(on_target::FlashOptions),
    OnTarget(on_target::TestOptions),
    Mainboard(mainboard::Options),
    Page,
    Release(release::Options),
    Reproducible(reproducible::Options),
    Refresh(refresh::Options),
    CheckTrace(check_trace::Options),
    ReferenceTime(reference_time::Options),
    StepEdges(step_edges::Options),
    AgainstKlipper(against_klipper::Options),
    FeedPlot,
    HostilePrograms(hostile_programs::Options),
    BresenhamLines(bresenham_lines::Options),
    CriticalSections(critical_sections::Options),
}

fn main() -> ExitCode {
    let command = match Arguments::from_arg_matches(&command().get_matches()) {
        Ok(arguments) => arguments.command,
        Err(error) => error.exit(),
    };
    match command {
        Command::Firmware(options) => in_steps("firmware", |run| firmware::run(run, &options)),
        Command::Bench(options) => in_steps("bench", |run| bench::run(run, &options)),
        Command::Flash(options) => in_steps("flash", |run| on_target::flash(run, &options)),
        Command::OnTarget(options) => in_steps("on-target", |run| on_target::test(run, &options)),
        Command::Mainboard(options) => in_steps("mainboard", |run| mainboard::run(run, &options)),
        Command::Page => in_steps("page", page::run),
        Command::Release(options) => in_steps("release", |run| release::write(run, &options)),
        Command::Reproducible(options) => in_steps("reproducible", |run| reproducible::check(run, &options)),
        Command::Refresh(options) => in_steps("refresh", |run| refresh::write(run, &options)),
        Command::CheckTrace(options) => ended(check_trace::run(&options)),
        Command::ReferenceTime(options) => ended(reference_time::run(&options).map(|()| true)),
        Command::StepEdges(options) => ended(step_edges::run(&options).map(|()| true)),
        Command::AgainstKlipper(options) => ended(against_klipper::run(&options).map(|()| true)),
        Command::FeedPlot => ended(feed_plot::run().map(|()| true).map_err(|error| error.to_string())),
        Command::HostilePrograms(options) => ended(Ok(hostile_programs::run(&options))),
        Command::BresenhamLines(options) => ended(bresenham_lines::run(&options).map(|()| true)),
        Command::CriticalSections(options) => {
            ended(critical_sections::run(&options).map(|()| true).map_err(|error| error.to_string()))
        }
    }
}

/// The arguments; the text about each command comes from the list that `cargo xtask --help` shows.
fn command() -> clap::Command {
    xtask::workbench::COMMANDS
        .iter()
        .fold(Arguments::command(), |command, (name, about)| command.mut_subcommand(name, |one| one.about(*about)))
}

/// Runs a command of steps, with the summary at its end.
fn in_steps(name: &'static str, command: impl FnOnce(&mut Run) -> Result<(), Failure>) -> ExitCode {
    let mut run = Run::new(name);
    let result = command(&mut run);
    run.finish(result)
}

/// The exit status of a command that prints a result: 0 if the result is good.
fn ended(result: Result<bool, Failure>) -> ExitCode {
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(reason) => {
            eprintln!("error: {reason}");
            ExitCode::FAILURE
        }
    }
}

/// The oracle's own profile by name, or one from a TOML file.
fn reference_profile(name_or_path: &str) -> Result<ReferenceProfile, Failure> {
    match name_or_path {
        "cartesian" => Ok(ReferenceProfile::cartesian()),
        "corexy" => Ok(ReferenceProfile::corexy()),
        "prusa-mini" => Ok(ReferenceProfile::prusa_mini()),
        path => {
            let text = std::fs::read_to_string(path).map_err(|error| format!("{path}: {error}"))?;
            ReferenceProfile::from_toml(&text).map_err(|error| format!("{path}: {error}"))
        }
    }
}

/// A job's G-code, plain or gzip.
fn job_text(path: &std::path::Path) -> Result<Vec<u8>, Failure> {
    let shown = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let bytes = std::fs::read(path).map_err(|error| shown(&error))?;
    ferrostep_oracle::gcode_text(&bytes).map_err(|error| shown(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_forwarded_and_says_what_it_does() {
        let own = Arguments::command();
        let own: Vec<&str> = own.get_subcommands().map(clap::Command::get_name).collect();
        assert_eq!(own, xtask::workbench::COMMANDS.map(|(name, _)| name));
        command().debug_assert();
    }
}
