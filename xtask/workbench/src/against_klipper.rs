//! Makes the table of the book's page "Against Klipper's rules", and of other files the same.
//!
//! ```text
//! FERROSTEP_REFRESH=1 cargo xtask against-klipper [--threads 2] [--benchy FILE]
//! cargo xtask against-klipper [--corexy] FILE...
//! ```
//!
//! The first writes the page's table and its chart; without `FERROSTEP_REFRESH` it compares. The
//! rows of the Benchy, which is not among the examples, stay as they are unless its file is named.
//! The second prints the rows of other files.

use std::path::{Path, PathBuf};

use ferrostep_checked_toml::book::keep;
use ferrostep_testkit::against_klipper::chart;
use ferrostep_testkit::against_klipper::table::{self, Case};

use crate::steps::Failure;
use crate::system;

/// Arguments of `against-klipper`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Other files than the book's, whose rows are printed
    files: Vec<PathBuf>,
    /// Plans those for the CoreXY instead of the fast bed slinger
    #[arg(long)]
    corexy: bool,
    /// The file of the page's rows of the Benchy
    #[arg(long, value_name = "FILE")]
    benchy: Option<PathBuf>,
    /// Threads that measure
    #[arg(long, value_name = "NUMBER", default_value_t = 2)]
    threads: usize,
}

/// Compares or writes the page, or prints the rows of other files.
///
/// # Errors
/// The page is not current.
pub fn run(options: &Options) -> Result<(), Failure> {
    let Options { files, corexy, benchy, threads } = options;
    let root = system::root();
    if files.is_empty() {
        let example = |name: &str| root.join("examples").join(name);
        let cases = [
            Case::bed_slinger(&root, "cube", &example("cube.gcode")),
            Case::bed_slinger(&root, "gyroid", &example("gyroid.gcode.gz")),
            Case::bed_slinger(&root, "supports", &example("supports.gcode.gz")),
            Case::corexy("arcs", &example("arcs-corexy.gcode.gz")),
        ];
        let benchy: Option<Vec<_>> = benchy.as_ref().map(|file| vec![Case::bed_slinger(&root, "Benchy", file)]);
        let page = root.join("tests/data/against-klipper.md");
        let mut outcome = Ok(());
        for (name, cases) in [("table", Some(&cases[..])), ("Benchy", benchy.as_deref())] {
            let Some(cases) = cases else { continue };
            let table = table::table(cases, *threads);
            outcome = outcome.and(keep(&page, name, &table).map_err(|error| format!("{table}{error}")));
        }
        return outcome.and_then(|()| chart::keep_current(&root));
    }
    let case = |file: &PathBuf| {
        let name = file.file_name().map_or("file", |name| name.to_str().unwrap_or("file"));
        if *corexy { Case::corexy(name, file) } else { Case::bed_slinger(&root, name, Path::new(file)) }
    };
    print!("{}", table::table(&files.iter().map(case).collect::<Vec<_>>(), *threads));
    Ok(())
}
