//! Makes the table of the book's page "Against Klipper's rules", and of other files the same.
//!
//! ```text
//! FERROSTEP_REFRESH=1 cargo run --release -p ferrostep-tests --example against_klipper -- [--threads 2]
//! cargo run --release -p ferrostep-tests --example against_klipper -- [--corexy] FILE...
//! ```
//!
//! The first writes the page's table; without `FERROSTEP_REFRESH` it compares. The second prints the rows of other files.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod table;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ferrostep_checked_toml::book::keep;
use ferrostep_tests::program::repository;
use table::Case;

fn main() -> ExitCode {
    let (mut files, mut is_corexy, mut threads) = (Vec::new(), false, 2);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--corexy" => is_corexy = true,
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
        let table = table::table(&cases, threads);
        return match keep(&root.join("docs/src/against-klipper.md"), "table", &table) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{table}{error}");
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
