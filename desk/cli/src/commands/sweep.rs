//! `ferrostep sweep`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use ferrostep_analysis::sweep::{self, ACCELERATION_KEYS, ERROR_BUDGET_KEY, Sweep, Values, chart};
use ferrostep_profiles::PlannedBy;
use ferrostep_session::input;
use ferrostep_session::output::{Accepted, Output};

use crate::arguments::{JobArguments, MacroArgument, SweepArguments};
use crate::machine;
use crate::outcome::result;
use crate::protected::inputs;

/// Estimates the job with each value and reports the times.
pub fn run(arguments: &SweepArguments) -> Result<ExitCode, String> {
    if input::is_standard_input(&arguments.file) {
        return Err("the job is read once for each value: give a file, not -".to_owned());
    }
    let sweep = keys(arguments)?;
    let machine = machine::of_file(arguments.profile.as_deref(), arguments.rules, &arguments.file)?;
    let plot = arguments.plot.as_deref().map(|plot| plot_output(plot, arguments)).transpose()?;
    let swept = sweep::sweep(&arguments.file, &machine.text, &machine.origin, &sweep)
        .map_err(|error| format!("{}: {error}", input::name(&arguments.file)))?;
    if let Some(mut plot) = plot {
        plot.write_all(chart::draw(&swept).as_bytes()).map_err(|error| plot.failed(error).to_string())?;
        plot.keep().map_err(|error| error.to_string())?;
    }
    Ok(result(arguments.json.then_some(&swept), || swept.to_string()))
}

/// `estimate --error-budget`.
pub fn budgets(
    job: JobArguments,
    macros: MacroArgument,
    values: Values,
    simulate: bool,
    rules: Option<PlannedBy>,
) -> Result<ExitCode, String> {
    let JobArguments { file, plate, profile, json, strict: _ } = job;
    let error_budget = Some(values);
    run(&SweepArguments {
        file,
        plate,
        macros,
        profile,
        acceleration: None,
        error_budget,
        set: Vec::new(),
        simulate,
        rules,
        json,
        plot: None,
    })
}

/// Returns the change: the keys of `--set`, with the same values each, or the keys of
/// `--acceleration` or `--error-budget`.
fn keys(arguments: &SweepArguments) -> Result<Sweep, String> {
    let (with_error, rules) = (arguments.simulate, arguments.rules);
    if let Some(values) = &arguments.acceleration {
        let label = "acceleration of print, travel, X and Y, mm/s²".to_owned();
        let keys = ACCELERATION_KEYS.map(str::to_owned).to_vec();
        return Ok(Sweep { keys, label, values: values.clone(), with_error, rules });
    }
    if let Some(values) = &arguments.error_budget {
        let keys = vec![ERROR_BUDGET_KEY.to_owned()];
        return Ok(Sweep { keys, label: "error budget, mm".to_owned(), values: values.clone(), with_error, rules });
    }
    let [(_, values), ..] = &arguments.set[..] else { return Err("nothing to change".to_owned()) };
    if let Some((key, _)) = arguments.set.iter().find(|(_, others)| others != values) {
        return Err(format!("--set {key}: keys that change together take the same values"));
    }
    let keys: Vec<String> = arguments.set.iter().map(|(key, _)| key.clone()).collect();
    Ok(Sweep { label: keys.join(", "), keys, values: values.clone(), with_error, rules })
}

/// The chart, which must not replace what is read.
fn plot_output(plot: &Path, arguments: &SweepArguments) -> Result<Output, String> {
    let protected = inputs(&arguments.file, machine::name_or_path(arguments.profile.as_deref()));
    Output::create(plot, Accepted::FileOrStream, &protected).map_err(|error| error.to_string())
}
