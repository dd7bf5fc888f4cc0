//! Mutants: the code with one small mistake each. The book's page lists the survivors, which
//! no test notices.

mod page;
mod tried;

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::steps::{Failure, Run};
use crate::system::{self, cargo};
use page::PAGE;
use tried::Files;

/// Number of parts of all mutants; each run of `ci` tries one part, about an hour.
const CI_SHARDS: u64 = 16;

/// Folder in which cargo-mutants builds and reports. It is not in the folder of other builds: its
/// own is a copy of the sources with another path.
const BUILD: &str = "mutants";

/// The configuration that lists the mutants.
const CONFIG: &str = ".cargo/mutants.toml";

/// Arguments of `mutants`.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// Files whose mutants are tried; by default all files of `.cargo/mutants.toml` (half a day)
    files: Vec<String>,
    /// Tries one part of them: 3/16 is the fourth of 16, numbered from 0
    #[arg(long, conflicts_with = "refresh")]
    shard: Option<String>,
    /// Writes the survivors in the tried files to the book's page, instead of
    /// comparing them with it
    #[arg(long)]
    refresh: bool,
}

/// Tries mutants, and compares or writes the page.
pub fn run(run: &mut Run, options: &Options) -> Result<(), Failure> {
    run.step("cargo-mutants is installed", || system::cargo_program("cargo-mutants", "mutants", &[]))?;
    let tried = run.step("mutants", || try_all(options))?;
    if options.refresh {
        return run.step("page of survivors", || page::write(&tried));
    }
    run.step("survivors against the page", || compare(&page::read()?, &tried, options.shard.is_none()))
}

/// Tries one part of all, chosen by the seed of the run's random cases.
pub fn check_a_part(run: &mut Run, seed: u64) -> Result<(), Failure> {
    let shard = Some(format!("{}/{CI_SHARDS}", seed % CI_SHARDS));
    self::run(run, &Options { shard, ..Options::default() })
}

/// Runs cargo-mutants and reads its report.
fn try_all(options: &Options) -> Result<Files, Failure> {
    let folder = system::target_directory().join(BUILD);
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut mutants = cargo();
    mutants.args(["mutants", "--no-shuffle", "--colors", "never"]);
    mutants.arg("--output").arg(&folder).env("CARGO_TARGET_DIR", folder.join("build"));
    if !options.files.is_empty() {
        mutants.arg("--config").arg(config_without_files(&folder)?);
    }
    for file in &options.files {
        if !system::root().join(file).is_file() {
            return Err(format!("{file}: no such file, expected one named from the workspace's root"));
        }
        mutants.args(["--file", file]);
    }
    if let Some(shard) = &options.shard {
        mutants.args(["--shard", shard, "--sharding", "round-robin"]);
    }
    run_mutants(&mut mutants)?;
    let report = folder.join("mutants.out/outcomes.json");
    let text = std::fs::read_to_string(&report).map_err(|error| format!("{}: {error}", report.display()))?;
    let report: Value = serde_json::from_str(&text).map_err(|error| format!("{}: {error}", report.display()))?;
    files(&report)
}

/// Writes the configuration without its list of files, which cargo-mutants would add to those
/// chosen; returns its path.
fn config_without_files(folder: &Path) -> Result<PathBuf, Failure> {
    let text = std::fs::read_to_string(system::root().join(CONFIG)).map_err(|error| format!("{CONFIG}: {error}"))?;
    let path = folder.join("mutants.toml");
    std::fs::write(&path, without_files(&text)?).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(path)
}

/// The configuration's text without the lines of that list.
fn without_files(text: &str) -> Result<String, Failure> {
    let parts = || {
        let (before, list) = text.split_once("\nexamine_globs = [\n")?;
        let (_, after) = list.split_once("\n]\n")?;
        Some(format!("{before}\n{after}"))
    };
    parts().ok_or_else(|| format!("{CONFIG} has no list `examine_globs` with lines of its own"))
}

/// Survivors and hanging tests are not errors here: the report lists them.
fn run_mutants(command: &mut Command) -> Result<(), Failure> {
    const SURVIVORS: i32 = 2;
    const TIMEOUTS: i32 = 3;
    match system::exit_status(command)?.code() {
        Some(0 | SURVIVORS | TIMEOUTS) => Ok(()),
        _ => Err("cargo-mutants has tried no mutants; above it says why".to_owned()),
    }
}

/// The results for each file of a report.
fn files(report: &Value) -> Result<Files, Failure> {
    let mut files = Files::new();
    let outcomes = report.get("outcomes").and_then(Value::as_array).ok_or("the report has no `outcomes`")?;
    for outcome in outcomes {
        let Some(mutant) = outcome.get("scenario").and_then(|scenario| scenario.get("Mutant")) else { continue };
        let text = |value: Option<&Value>| value.and_then(Value::as_str).map(str::to_owned);
        let (file, name, summary) = (text(mutant.get("file")), text(mutant.get("name")), text(outcome.get("summary")));
        let (Some(file), Some(name), Some(summary)) = (file, name, summary) else {
            return Err(format!("the report has an outcome without file, name or summary: {outcome}"));
        };
        let tried = files.entry(file).or_default();
        match summary.as_str() {
            "Unviable" => {}
            "CaughtMutant" | "Timeout" => tried.mutants += 1,
            "MissedMutant" => {
                tried.mutants += 1;
                *tried.survivors.entry(without_place(&name).to_owned()).or_default() += 1;
            }
            other => return Err(format!("the report has an outcome of an unknown kind, {other}: {name}")),
        }
    }
    Ok(files)
}

/// `file:line:column: what is changed` without the place: lines move whenever a file changes.
fn without_place(name: &str) -> &str {
    name.splitn(4, ':').last().unwrap_or(name).trim_start()
}

/// Compares the survivors with the page's; a new one is an error. `is_whole`: all mutants of the
/// files were tried.
fn compare(page: &Files, tried: &Files, is_whole: bool) -> Result<(), Failure> {
    let mut new = Vec::new();
    let mut fewer = false;
    for (file, tried) in tried {
        let Some(known) = page.get(file) else {
            eprintln!("    {file}: {} of {} survive; not on the page yet", tried.survivors(), tried.mutants);
            continue;
        };
        let (now, before) = (tried.survivors(), known.survivors());
        eprintln!("    {file}: {now} of {} survive, on the page {before} of {}", tried.mutants, known.mutants);
        fewer |= is_whole && now < before;
        for (change, count) in &tried.survivors {
            let known = known.survivors.get(change).copied().unwrap_or(0);
            if *count > known {
                new.push(format!("{file}: {change} ({count}, on the page {known})"));
            }
        }
    }
    if fewer {
        eprintln!("    fewer than on the page: `{}` writes them", PAGE.command);
    }
    if new.is_empty() {
        return Ok(());
    }
    Err(format!(
        "{} survive that {} does not have:\n{}\nWrite a test that fails with the change. If the change makes no difference, \
         leave it out in .cargo/mutants.toml, with the reason",
        new.len(),
        PAGE.path,
        new.join("\n")
    ))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::tried::Tried;
    use super::*;
    use serde_json::json;

    fn tried(mutants: usize, survivors: &[(&str, usize)]) -> Tried {
        let survivors = survivors.iter().map(|(change, count)| ((*change).to_owned(), *count)).collect();
        Tried { mutants, survivors }
    }

    fn outcome(file: &str, name: &str, summary: &str) -> Value {
        json!({"scenario": {"Mutant": {"file": file, "name": name}}, "summary": summary})
    }

    #[test]
    fn a_report_is_read_by_file() {
        let report = json!({"outcomes": [
            {"scenario": "Baseline", "summary": "Success"},
            outcome("a.rs", "a.rs:1:2: replace f with ()", "MissedMutant"),
            outcome("a.rs", "a.rs:9:2: replace f with ()", "MissedMutant"),
            outcome("a.rs", "a.rs:3:4: replace == with != in A::g", "CaughtMutant"),
            outcome("b.rs", "b.rs:3:4: replace h -> u8 with 0", "Timeout"),
            outcome("b.rs", "b.rs:3:4: replace h -> B with Default::default()", "Unviable"),
        ]});
        let expected = [("a.rs", tried(3, &[("replace f with ()", 2)])), ("b.rs", tried(1, &[]))];
        assert_eq!(files(&report).unwrap(), expected.map(|(file, tried)| (file.to_owned(), tried)).into());
        assert!(files(&json!({})).is_err());
        let unknown = json!({"outcomes": [outcome("a.rs", "a.rs:1:2: x", "Lost")]});
        assert!(files(&unknown).unwrap_err().contains("unknown kind, Lost"));
    }

    #[test]
    fn a_new_survivor_is_named() {
        let files = |tried: Tried| Files::from([("a.rs".to_owned(), tried)]);
        let page = files(tried(9, &[("f", 2), ("g", 1)]));
        for same_or_fewer in [&[("f", 2), ("g", 1)][..], &[("f", 1)], &[]] {
            assert_eq!(compare(&page, &files(tried(9, same_or_fewer)), true), Ok(()));
        }
        for (more, named) in
            [(&[("f", 3)][..], "a.rs: f (3, on the page 2)"), (&[("h", 1)], "a.rs: h (1, on the page 0)")]
        {
            let error = compare(&page, &files(tried(9, more)), false).unwrap_err();
            assert!(error.starts_with("1 survive") && error.contains(named), "{error}");
        }
        // A file that is not on the page yet is only reported.
        assert_eq!(compare(&Files::new(), &page, true), Ok(()));
    }

    #[test]
    fn the_configuration_keeps_all_but_its_files() {
        let text = "# Why.\nexamine_globs = [\n    \"a.rs\",\n    \"b/*.rs\",\n]\n\nexclude_re = [\n    \"c\",\n]\n";
        assert_eq!(without_files(text).unwrap(), "# Why.\n\nexclude_re = [\n    \"c\",\n]\n");
        assert!(without_files("exclude_re = []\n").unwrap_err().contains("examine_globs"));
        let own = std::fs::read_to_string(system::root().join(CONFIG)).unwrap();
        let kept = without_files(&own).unwrap();
        assert!(!kept.contains(".rs\",\n    \"") && kept.contains("\nexclude_re = [\n"), "{kept}");
    }

    #[test]
    fn the_place_of_a_mutant_is_left_out() {
        assert_eq!(
            without_place("a/b.rs:12:3: replace A::f -> Result<(), E> with Ok(())"),
            "replace A::f -> Result<(), E> with Ok(())"
        );
    }
}
