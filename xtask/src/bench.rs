//! Counts: the target's instructions for the parts of a print, the image's bytes, and how fast the desk is.

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

use std::path::Path;

use serde_json::{Value, json};

use crate::core_library;
use crate::firmware::{self, Program, Target};
use crate::mainboard;
use crate::steps::{Failure, Run};

/// Arguments of `bench`.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Options {
    /// Prints one JSON object, alone, on standard output
    #[arg(long)]
    json: bool,
    /// Fails if a count of the target or the image's size is more than 3 % above the committed baseline
    #[arg(long)]
    check: bool,
    /// Makes these counts the baseline and writes the book's page of benchmarks
    #[arg(long, conflicts_with = "check")]
    save_baseline: bool,
}

impl Options {
    /// To make these counts the baseline.
    pub const SAVE: Self = Self { json: false, check: false, save_baseline: true };
}

/// Builds both images, counts, and prints, compares or saves the counts. The speed of the desk is for information only.
pub fn run(run: &mut Run, options: Options) -> Result<(), Failure> {
    let mainboard = mainboard::build(run)?;
    let image = firmware::build(run, Program::Firmware, &Target::bench()?)?;
    let mut figures = count(run, &mainboard, &image)?;
    if let Some(desk) = count_desk(run)? {
        insert(&mut figures, baseline::DESK, desk);
    }
    if options.json || !(options.check || options.save_baseline) {
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
        compare(run, &figures)?;
    }
    Ok(())
}

/// Counts the target's instructions and compares, with the virtual mainboard's program and the firmware's image already built.
pub fn check(run: &mut Run, mainboard: &Path, firmware: &Path) -> Result<(), Failure> {
    let figures = count(run, mainboard, firmware)?;
    compare(run, &figures)
}

/// Counts the desk's instructions and compares: the command as released is minutes of link-time optimisation.
pub fn check_desk(run: &mut Run) -> Result<(), Failure> {
    let Some(desk) = count_desk(run)? else { return Ok(()) };
    compare(run, &json!({ baseline::DESK: desk, "compiler": core_library::compiler_version()? }))
}

fn count_desk(run: &mut Run) -> Result<Option<Value>, Failure> {
    run.step("instructions of estimates", desk::count)
}

fn compare(run: &mut Run, figures: &Value) -> Result<(), Failure> {
    run.step("counts against the baseline", || baseline::check(&baseline::read()?, figures))
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
