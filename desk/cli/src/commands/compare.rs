//! `ferrostep compare`.

use std::io::Write;
use std::process::ExitCode;

use ferrostep_analysis::compare::{Asked, compare};
use ferrostep_analysis::job_machine::JobMachine;
use ferrostep_analysis::sweep::machine_with;
use ferrostep_session::input;
use ferrostep_session::output::{Accepted, Output};

use crate::arguments::CompareArguments;
use crate::browser::open_page;
use crate::machine;
use crate::outcome::{exit_code, result};
use crate::protected::inputs;

/// Prints both jobs and reports the differences.
pub fn run(arguments: &CompareArguments) -> Result<ExitCode, String> {
    let second = arguments.second.as_ref().unwrap_or(&arguments.file);
    if [&arguments.file, second].into_iter().any(|file| input::is_standard_input(file)) {
        return Err("compare reads its jobs more than once: give it files, not -".to_owned());
    }
    let [profile_a, profile_b] =
        [&arguments.profile_a, &arguments.profile_b].map(|own| own.as_deref().or(arguments.profile.as_deref()));
    if arguments.second.is_none() && profile_a == profile_b && arguments.set.is_empty() {
        return Err("nothing to compare with: give a second file, --profile-b or --set".to_owned());
    }
    let machine = |machine: &JobMachine, values: &[(String, f64)]| {
        machine_with(&machine.text, &machine.origin, values, arguments.rules).map_err(|error| error.to_string())
    };
    let machine_a = machine::of_file(profile_a, arguments.rules, &arguments.file)?;
    let machine_b = match &arguments.second {
        None if profile_a == profile_b => machine_a.clone(),
        _ => machine::of_file(profile_b, arguments.rules, second)?,
    };
    let asked = [
        Asked { file: &arguments.file, machine: machine(&machine_a, &[])?, changes: &[] },
        Asked { file: second, machine: machine(&machine_b, &arguments.set)?, changes: &arguments.set },
    ];
    let frequency_hz = match (arguments.frequency_x, arguments.frequency_y) {
        (None, None) => None,
        (x, y) => Some([x.or(y).unwrap_or_default(), y.or(x).unwrap_or_default()]),
    };
    if let Some(by) = asked.iter().find_map(|one| one.machine.by.as_ref()).filter(|_| frequency_hz.is_some()) {
        return Err(format!(
            "--frequency-x and --frequency-y play this firmware's steps on a frame, and the rules of {} make none: add --rules own, or \
             leave the frequencies out",
            by.rules.name()
        ));
    }
    let mut protected = inputs(&arguments.file, machine::name_or_path(profile_a));
    protected.extend(inputs(second, machine::name_or_path(profile_b)));
    let page = arguments.out.as_deref().map(|page| Output::create(page, Accepted::FileOrStream, &protected));
    let page = page.transpose().map_err(|error| error.to_string())?;
    let keys: Vec<String> = arguments.set.iter().map(|(key, _)| key.clone()).collect();
    let comparison = compare(asked, &keys, frequency_hz)?;
    if let Some(mut page) = page {
        let target = page.target().to_path_buf();
        page.write_all(&comparison.page).map_err(|error| page.failed(error).to_string())?;
        page.keep().map_err(|error| error.to_string())?;
        if !arguments.no_open {
            open_page(&target);
        }
    }
    let code = result(arguments.json.then_some(&comparison), || comparison.to_string());
    let stopped = [&comparison.a, &comparison.b].into_iter().find_map(|side| Some((side, side.stopped.as_ref()?)));
    Ok(match stopped {
        Some((side, reason)) => exit_code(Err(format!("{}: {reason}", side.file))),
        None => code,
    })
}
