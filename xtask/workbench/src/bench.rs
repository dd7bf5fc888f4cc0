//! Counts: the target's instructions for the parts of a print, the image's bytes, and the
//! speed of the desk.

mod baseline;
mod chart;
mod cycle_model;
mod desk;
mod emulation;
mod figures;
mod host;
mod lines;
mod page;
mod per_event;

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::core_library;
use crate::firmware::{self, Program, Target};
use crate::mainboard;
use crate::steps::{Failure, Run};

/// Arguments of `bench`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Prints one JSON object, alone, on standard output
    #[arg(long)]
    json: bool,
    /// Fails if a count of the target or the image's size is more than 3 % above the
    /// committed baseline
    #[arg(long)]
    check: bool,
    /// Makes these counts the baseline and writes the book's page of benchmarks
    #[arg(long, conflicts_with_all = ["check", "only"])]
    save_baseline: bool,
    /// Counts only a part
    #[arg(long, value_name = "PART")]
    only: Option<Part>,
    /// The virtual mainboard's program; it is built by default
    #[arg(long, value_name = "PROGRAM")]
    mainboard: Option<PathBuf>,
    /// The bench's firmware image; it is built by default
    #[arg(long)]
    image: Option<PathBuf>,
}

/// A part of the counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Part {
    /// The target's instructions and the image's size
    Target,
    /// The desk's instructions, where valgrind is installed: the command as released is minutes of
    /// link-time optimisation
    Desk,
}

impl Options {
    /// Options that make these counts the baseline.
    pub const SAVE: Self =
        Self { json: false, check: false, save_baseline: true, only: None, mainboard: None, image: None };
}

/// Builds both images, counts, and prints, compares or saves the counts. The speed of the desk is
/// for information only.
pub fn run(run: &mut Run, options: &Options) -> Result<(), Failure> {
    let mut figures = if options.only == Some(Part::Desk) {
        json!({ "compiler": core_library::compiler_version()? })
    } else {
        let mainboard = options.mainboard.clone().map_or_else(|| mainboard::build(run), Ok)?;
        let build = |run| firmware::build(run, Program::Firmware, &Target::bench()?);
        let image = options.image.clone().map_or_else(|| build(run), Ok)?;
        count(run, &mainboard, &image)?
    };
    if options.only != Some(Part::Target)
        && let Some(desk) = run.step("instructions of estimates", desk::count)?
    {
        insert(&mut figures, baseline::DESK, desk);
    }
    let is_for_a_person = options.json || !(options.check || options.save_baseline);
    if is_for_a_person && options.only.is_none() {
        let host = run.step("the desk", host::measure)?;
        insert(&mut figures, "host", host);
    }
    if options.json {
        println!("{figures:#}");
    } else {
        print_table(&figures);
    }
    if options.save_baseline {
        run.step("baseline and page", || baseline::write(&figures).and_then(|figures| page::write(&figures)))?;
        eprintln!("    the papers' figures show these counts: `cargo xtask refresh --desk` draws them anew");
    }
    if options.check {
        run.step("counts against the baseline", || baseline::check(&baseline::read()?, &figures))?;
    }
    Ok(())
}

/// The target's counts, which are the same on every run and every machine.
fn count(run: &mut Run, mainboard: &Path, firmware: &Path) -> Result<Value, Failure> {
    let board = Target::bench()?;
    let tally = firmware::build(run, Program::Tally, &board)?;
    let mut workload = run.step("events to make", || emulation::count(mainboard, &tally))?;
    let bench = firmware::build(run, Program::Bench, &board)?;
    let mut counts = run.step("instructions", || emulation::count(mainboard, &bench))?;
    let target = counts.get_mut("target").ok_or("the bench counted nothing of the target")?;
    lines::join(target, &mut workload)?;
    let sizes = firmware::sizes(firmware)?;
    Ok(json!({
        "target": per_event::target(&counts, &workload)?,
        "workload": per_event::workload(&counts, workload)?,
        "image": {"text": sizes.text, "data": sizes.data, "bss": sizes.bss},
        "compiler": core_library::compiler_version()?,
    }))
}

fn insert(figures: &mut Value, key: &str, value: Value) {
    if let Some(object) = figures.as_object_mut() {
        object.insert(key.to_owned(), value);
    }
}

/// Each figure, with its baseline if it differs.
fn print_table(figures: &Value) {
    let baseline = baseline::read().unwrap_or_default();
    let changes = baseline::changes(&baseline, figures);
    println!("{:<58} {:>14}", "instructions, bytes, numbers", "");
    for (key, number) in baseline::numbers(figures) {
        let change = changes.iter().find(|change| change.key == key);
        let percent = change.and_then(baseline::Change::percent);
        let note = percent.map(|percent| format!("  {percent:+.1} %")).unwrap_or_default();
        println!("{key:<58} {number:>14}{note}");
    }
}
