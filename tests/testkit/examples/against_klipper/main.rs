//! Makes the table of the book's page "Against Klipper's rules", and of other files the same.
//!
//! ```text
//! FERROSTEP_REFRESH=1 cargo run --release -p ferrostep-testkit --example against_klipper -- [--threads 2] [--benchy FILE]
//! cargo run --release -p ferrostep-testkit --example against_klipper -- [--corexy] FILE...
//! ```
//!
//! The first writes the page's table and its chart; without `FERROSTEP_REFRESH` it compares. The rows of the Benchy, which is not among the
//! examples, stay as they are unless its file is named. The second prints the rows of other files.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ferrostep_checked_toml::book::keep;
use ferrostep_testkit::against_klipper::table::Case;
use ferrostep_testkit::against_klipper::{chart, table};
use ferrostep_testkit::program::repository;

fn main() -> ExitCode {
    let (mut files, mut is_corexy, mut threads, mut benchy) = (Vec::new(), false, 2, None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--corexy" => is_corexy = true,
            "--benchy" => benchy = Some(PathBuf::from(arguments.next().expect("a file"))),
            "--threads" => threads = arguments.next().expect("a number").parse().expect("a number"),
            _ => files.push(PathBuf::from(argument)),
        }
    }
    let root = repository();
    if files.is_empty() {
        let example = |name: &str| root.join("examples").join(name);
        let cases = [
            Case::bed_slinger(&root, "cube", &example("cube.gcode")),
            Case::bed_slinger(&root, "gyroid", &example("gyroid.gcode.gz")),
            Case::bed_slinger(&root, "supports", &example("supports.gcode.gz")),
            Case::corexy("arcs", &example("arcs-corexy.gcode.gz")),
        ];
        let benchy: Option<Vec<_>> = benchy.map(|file| vec![Case::bed_slinger(&root, "Benchy", &file)]);
        let page = root.join("docs/src/against-klipper.md");
        let mut outcome = Ok(());
        for (name, cases) in [("table", Some(&cases[..])), ("Benchy", benchy.as_deref())] {
            let Some(cases) = cases else { continue };
            let table = table::table(cases, threads);
            outcome = outcome.and(keep(&page, name, &table).map_err(|error| format!("{table}{error}")));
        }
        return match outcome.and_then(|()| chart::keep_current(&root)) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{error}");
                ExitCode::FAILURE
            }
        };
    }
    let case = |file: &PathBuf| {
        let name = file.file_name().map_or("file", |name| name.to_str().unwrap_or("file"));
        if is_corexy { Case::corexy(name, file) } else { Case::bed_slinger(&root, name, Path::new(file)) }
    };
    print!("{}", table::table(&files.iter().map(case).collect::<Vec<_>>(), threads));
    ExitCode::SUCCESS
}
