//! `ferrostep show`.

use std::fs::File;
use std::io::{BufWriter, Read};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ferrostep_analysis::recording::{self, MAX_NODES};
use ferrostep_host::printable;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::duration::hms;
use ferrostep_session::input::{self, Input};
use ferrostep_session::output::{Accepted, Output};
use ferrostep_session::rules::RuledMachine;
use ferrostep_show::write_page;

use crate::arguments::ShowArguments;
use crate::browser;
use crate::job::{replies, strict};
use crate::machine;
use crate::outcome::exit_code;
use crate::progress::Progress;
use crate::protected::inputs;
use crate::terminal;

/// Beginning of the pages that this command writes.
const MARK: &[u8] = b"<!doctype html><!-- ferrostep show -->";

/// Largest file whose time is also estimated with other limits.
const MAX_ASKED_BYTES: u64 = 32 << 20;

/// Prints the job and writes its page.
pub fn run(arguments: &ShowArguments) -> Result<ExitCode, String> {
    let name = input::name(&arguments.file);
    let mut input = Input::open(&arguments.file).map_err(|error| format!("{name}: {error}"))?;
    let named = arguments.profile.as_deref();
    let machine = machine::of_job(named, arguments.rules, &arguments.file, &input)?;
    let RuledMachine { profile, by, .. } = machine.ruled().map_err(|error| error.to_string())?;
    // A prepared job has its steps already.
    let by = by.filter(|_| !input.is_prepared());
    if input.is_prepared()
        && let Some(asked) = arguments.rules.filter(|asked| *asked != PlannedBy::Own)
    {
        return Err(format!(
            "{name}: this is a prepared job, whose steps are planned already: --rules {} takes the G-code that it was made from",
            asked.name()
        ));
    }
    let path = arguments.out.clone().map_or_else(|| default_page(&arguments.file), Ok)?;
    let protected = inputs(&arguments.file, machine::name_or_path(named));
    let out = Output::create(&path, Accepted::FileOrStream, &protected).map_err(|error| error.to_string())?;

    let progress = Progress::new();
    let place = input.place();
    // A pipe can be read only once, and a large file takes too long to read twice.
    // What other limits would win is asked of this firmware's planner.
    let asks =
        by.is_none() && arguments.file.is_file() && !input.is_prepared() && input.size_bytes() <= MAX_ASKED_BYTES;
    let (shown, chances) = std::thread::scope(|scope| {
        let chances = asks.then(|| scope.spawn(|| recording::chances(profile, &arguments.file)));
        let shown = recording::record(profile, by, &mut input, MAX_NODES, replies(&progress), |done, figures| {
            progress.show(place.share(), done, || *figures);
        });
        (shown, chances.and_then(|thread| thread.join().ok()).unwrap_or_default())
    });
    progress.end();
    let shown = shown.map_err(|error| error.to_string())?;
    // A job that stops has no whole print to compare with.
    let chances = if shown.stopped.is_some() { Vec::new() } else { chances };
    let said = input.description().map(|description| &description.figures);
    let slicer_time_s = said.and_then(|said| Some(said.time_s?.into()));
    let mut job = shown.job(&arguments.file, &profile, slicer_time_s, chances);
    job.profile = machine.name(&profile);
    let mut out = BufWriter::with_capacity(1 << 16, out);
    if let Err(error) = write_page(&mut out, &job, &shown.recording, &shown.text) {
        return Err(out.get_ref().failed(error).to_string());
    }
    let target = out.get_ref().target().to_path_buf();
    Output::keep_buffered(out).map_err(|error| error.to_string())?;
    let findings = job.findings.iter().filter(|finding| !matches!(finding.weight, "extreme" | "place"));
    let written = terminal::write_result(&format!(
        "{}: {}{} in {}, {}\n",
        printable::name(&path),
        hms(job.print_time_s),
        job.rules.as_ref().map_or_else(String::new, |rules| format!(" by the rules of {}", rules.name)),
        counted(job.moves, "move"),
        counted(findings.count() as u64, "finding")
    ));
    if !arguments.no_open {
        browser::open_page(&target);
    }
    let code = exit_code(written);
    Ok(match shown.stopped {
        Some(error) => exit_code(Err(format!("{name}: {error}"))),
        None if arguments.strict && code == ExitCode::SUCCESS => strict(&arguments.file, &shown.remarks),
        None => code,
    })
}

/// A number and its noun: 1 finding, 2 findings.
fn counted(count: u64, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// The page's name if none is given: an older page of that name may be replaced, another file not.
fn default_page(file: &Path) -> Result<PathBuf, String> {
    let stem = if input::is_standard_input(file) { None } else { file.file_name() };
    let stem = stem.map_or_else(|| "print".to_owned(), |stem| stem.to_string_lossy().into_owned());
    let stem = [".gz", ".gcode", ".bgcode", ".gpre", ".gco", ".g"]
        .iter()
        .fold(stem.as_str(), |stem, end| stem.strip_suffix(end).unwrap_or(stem));
    let page = PathBuf::from(format!("{stem}.html"));
    let is_ours = |page: &Path| {
        let mut start = [0; MARK.len()];
        File::open(page).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == MARK
    };
    if page.symlink_metadata().is_ok() && !is_ours(&page) {
        return Err(format!(
            "{}: a file of this name exists, and show did not write it: choose another name with -o",
            printable::name(&page)
        ));
    }
    Ok(page)
}
