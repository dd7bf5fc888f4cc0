//! The `ferrostep` command.

mod arguments;
mod browser;
mod commands;
mod guide;
mod job;
mod machine;
mod manual;
mod outcome;
mod progress;
mod protected;
mod terminal;

use std::process::ExitCode;

use clap::Parser;
use ferrostep_papers::tables::Paper;
use ferrostep_session::gpre::Shown;
use ferrostep_session::input;
use ferrostep_session::macros::Macros;

use arguments::{Arguments, Command};
#[cfg(unix)]
use commands::serve;
use commands::{
    blackbox, calibrate, compare, estimate, import, inspect, papers, ports, post_process, preprocess, print, send,
    show, simulate, sweep,
};
use terminal::tell;

fn main() -> ExitCode {
    if std::env::args_os().nth(1).is_none() {
        return guide::show();
    }
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(answer) => return outcome::of_arguments(&answer),
    };
    input::choose_plate(arguments.command.plate());
    Macros::choose(arguments.command.has_strict_macros());
    let outcome = match arguments.command {
        Command::Print { job, look_ahead, from_frame, trace, vcd, from, to, .. } => {
            let vcd = vcd.as_deref().map(|path| (path, from, to));
            print::run(&job, look_ahead.map(|blocks| blocks as usize), from_frame, trace.as_deref(), vcd)
        }
        Command::Preprocess { job, out, format } => preprocess::run(&job, &out, format),
        Command::Inspect { file, items, entries } => {
            let shown = match (items, entries) {
                (true, _) => Shown::Items,
                (false, true) => Shown::Entries,
                (false, false) => Shown::Frames,
            };
            inspect::run(&file, shown)
        }
        Command::Send(arguments) => send::run(&arguments),
        Command::Ports => ports::run(),
        Command::Blackbox(arguments) => blackbox::run(&arguments),
        #[cfg(unix)]
        Command::Serve(arguments) => match &arguments.board {
            Some(board) => serve::image::run(board, &arguments),
            None => serve::run(&arguments),
        },
        Command::Estimate { job, macros, error_budget: Some(values), simulate, rules, .. } => {
            sweep::budgets(job, macros, values, simulate, rules)
        }
        Command::Estimate { job, rules, took, .. } => estimate::run(&job, rules, took),
        Command::PostProcess(arguments) => post_process::run(&arguments),
        Command::Sweep(arguments) => sweep::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Show(arguments) => show::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Calibrate { calibration } => calibrate::run(&calibration),
        Command::Import { file, moonraker, api_key, marlin, baud, out, json, all, assume } => {
            import::Source::of(file, moonraker, api_key, marlin, baud)
                .and_then(|source| import::run(&import::Arguments { source, out: out.as_deref(), json, all, assume }))
        }
        Command::Completions { shell } => manual::completions(shell),
        Command::Man { out } => manual::pages(out.as_deref()),
        Command::Papers { compare: Some(file), profile, json, .. } => papers::compare(&file, &profile, json),
        Command::Papers { paper, json, svg, .. } => papers::run(paper.map(Paper::from), json, svg.as_deref()),
    };
    // Exit status 2, as for wrong arguments: nothing was started.
    outcome.unwrap_or_else(|reason| {
        tell(format_args!("error: {reason}"));
        ExitCode::from(2)
    })
}
