//! `cargo xtask`: its arguments, and the parts of `test` and `ci`.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::{Command, CommandFactory, FromArgMatches, Parser, Subcommand};

use xtask::share::Share;
use xtask::steps::{Failure, Run};
use xtask::{check, hosts, mutants, prose, tools, workbench};

/// Tasks of the Ferrostep workspace.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

/// The tasks that need no crate of Ferrostep.
#[derive(Clone, Subcommand)]
enum Task {
    /// Check a change: install what is missing, then format, lints, images, counts and all tests,
    /// of long sweeps a share
    Test(check::Options),
    /// Check everything: `test` with all of each sweep, then spelling, licences and sources of
    /// dependencies, documentation, the desk's tests as released code with more and other random
    /// cases, and a part of the mutants
    Ci {
        /// Makes the steps' costs of this run those that later runs are held against
        #[arg(long)]
        save_costs: bool,
    },
    /// Install the programs from outside that tests run, and say which
    Tools,
    /// Print the commit's share of long sweeps, as tests want it in FERROSTEP_SHARE
    Share,
    /// Install the hosts that tests print with (OctoPrint, printcore) into a Python environment;
    /// its folder is the first line of the output
    Hosts,
    /// Check how comments and pages are worded
    Prose,
    /// Make small mistakes in the code, one at a time, and list those that no test notices
    Mutants(mutants::Options),
}

/// The arguments, with the workbench's commands for the help.
fn command() -> Command {
    workbench::COMMANDS
        .iter()
        .fold(Arguments::command(), |command, (name, about)| command.subcommand(Command::new(*name).about(*about)))
}

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    if arguments.first().is_some_and(|first| workbench::has(first)) {
        return workbench::forward(arguments).unwrap_or_else(|reason| {
            eprintln!("stopped: {reason}");
            ExitCode::FAILURE
        });
    }
    let task = match Arguments::from_arg_matches(&command().get_matches()) {
        Ok(arguments) => arguments.task,
        Err(error) => error.exit(),
    };
    let in_steps = |name, task: &dyn Fn(&mut Run) -> Result<(), Failure>| {
        let mut run = Run::new(name);
        let result = task(&mut run);
        run.finish(result)
    };
    match task {
        Task::Test(options) => in_steps("test", &|run| check::test(run, &options)),
        Task::Ci { save_costs } => in_steps("ci", &|run| check::everything(run, save_costs)),
        Task::Tools => in_steps("tools", &|run| tools::install(run).map(|_| ())),
        Task::Prose => in_steps("prose", &|run| run.step("wording", prose::check)),
        Task::Hosts => in_steps("hosts", &|run| hosts::install(run).map(|folder| println!("{}", folder.display()))),
        Task::Mutants(options) => in_steps("mutants", &|run| mutants::run(run, &options)),
        Task::Share => {
            let (share, why) = Share::of_this_commit();
            eprintln!("{why}");
            println!("{}", share.value());
            ExitCode::SUCCESS
        }
    }
}
