//! Everything of the book, the README and the tests' data that a command makes, made
//! anew by one command.
//!
//! Each figure and each table has a test that compares it with the code's present result, and that
//! writes it if [`REFRESH_VARIABLE`] is set. This command runs all of these tests. The mutants'
//! table is left out, for it takes hours: `cargo xtask mutants --refresh`.

use crate::firmware::{self, Image, Shown};
use crate::generated::Page;
use crate::size::{Budget, Row};
use crate::steps::{Failure, Run};
use crate::system::{self, cargo};
use crate::{FIRMWARE_VARIABLE, HOSTS_VARIABLE, bench, hosts, house, image};

/// Environment variable by which a test writes the part that it would compare.
const REFRESH_VARIABLE: &str = "FERROSTEP_REFRESH";

/// The README, with the table of the images' sizes.
const README: Page = Page { path: "README.md", command: "cargo xtask refresh" };

/// Parts to write.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Options {
    /// Only what needs no image of a board
    #[arg(long)]
    desk: bool,
}

/// Tests or a program that write a part.
struct Writer {
    /// Parts that they write.
    what: &'static str,
    /// Cargo's arguments.
    arguments: &'static [&'static str],
    /// Their sources, from the root.
    #[cfg_attr(not(test), expect(dead_code, reason = "for the test that none is forgotten"))]
    sources: &'static [&'static str],
}

/// The writers that need only the desk.
const DESK: [Writer; 9] = [
    Writer {
        what: "keys of profiles",
        arguments: &["test", "-p", "ferrostep-profiles", "--test", "profiles", "book"],
        sources: &["config/profiles/tests/profiles/book.rs"],
    },
    Writer {
        what: "keys of boards",
        arguments: &["test", "-p", "ferrostep-boards", "--test", "boards", "book"],
        sources: &["config/boards/tests/boards/book.rs"],
    },
    Writer {
        what: "play of drives",
        arguments: &["test", "-p", "ferrostep-planner", "--test", "planner", "backlash::picture"],
        sources: &["planner/tests/backlash/picture.rs"],
    },
    Writer {
        what: "input shapers",
        arguments: &["test", "-p", "ferrostep-planner", "--test", "planner", "--", "shapers::", "ringing::"],
        sources: &["planner/tests/shapers.rs", "planner/tests/ringing.rs"],
    },
    Writer {
        what: "autotune of heaters, and models of them",
        arguments: &["test", "-p", "ferrostep-printer", "--lib", "--", "tuned", "modelled"],
        sources: &["printer/src/heat/tests/tuning.rs", "printer/src/heat/tests/modelled.rs"],
    },
    Writer {
        what: "papers, slicers, hosts, refusals, faults, examples of prepared jobs",
        arguments: &[
            "test",
            "-p",
            "ferrostep-tests",
            "--",
            "end_to_end::papers",
            "end_to_end::pause_times",
            "end_to_end::slicer_profiles",
            "end_to_end::slaved_extruder",
            "end_to_end::prepared",
            "end_to_end::refusals_page",
            "end_to_end::fault_matrix",
            "end_to_end::on_the_way",
        ],
        sources: &[
            "tests/tests/end_to_end/papers.rs",
            "tests/tests/end_to_end/pause_times.rs",
            "tests/tests/end_to_end/slicer_profiles.rs",
            "tests/tests/end_to_end/slaved_extruder.rs",
            "tests/tests/end_to_end/prepared.rs",
            "tests/tests/end_to_end/refusals_page.rs",
            "tests/tests/end_to_end/fault_matrix.rs",
            "tests/tests/end_to_end/on_the_way.rs",
        ],
    },
    Writer {
        what: "pictures of pages",
        arguments: &["test", "-p", "ferrostep-outside-tests", "browser::pictures"],
        sources: &["tests/outside/tests/browser/pictures.rs"],
    },
    Writer {
        what: "feed with slow input and a slow planner",
        arguments: &["xtask", "feed-plot"],
        sources: &["xtask/workbench/src/feed_plot.rs"],
    },
    Writer {
        what: "against Klipper's rules",
        arguments: &["xtask", "against-klipper"],
        sources: &[
            "xtask/workbench/src/against_klipper.rs",
            "tests/testkit/src/against_klipper/chart.rs",
            "tests/tests/end_to_end/against_klipper.rs",
        ],
    },
];

/// The writer that reads the boards' images.
const MASKED: Writer = Writer {
    what: "masked sections of the images",
    arguments: &["test", "-p", "ferrostep-outside-tests", "firmware::masked_sections"],
    sources: &["tests/outside/tests/firmware/masked_sections.rs"],
};

/// Writes all parts.
///
/// # Errors
/// A part cannot be made; those before it are written.
pub fn write(run: &mut Run, options: &Options) -> Result<(), Failure> {
    run.step("drawing of the packages", house::draw)?;
    let hosts = hosts::install(run)?;
    for Writer { what, arguments, .. } in DESK {
        run.step(what, || system::run(cargo().args(arguments).env(REFRESH_VARIABLE, "1").env(HOSTS_VARIABLE, &hosts)))?;
    }
    if options.desk {
        return Ok(());
    }
    let images = firmware::build_images(run, &firmware::Options::default(), Shown::Output)?;
    run.step("sizes of the images", || README.write(&size_table(&images)?))?;
    let bench_image = &images.first().ok_or("there is no board")?.path;
    run.step(MASKED.what, || {
        let mut tests = cargo();
        tests.args(MASKED.arguments).env(REFRESH_VARIABLE, "1");
        system::run(tests.env(FIRMWARE_VARIABLE, bench_image).env(image::IMAGES_VARIABLE, image::images()))
    })?;
    bench::run(run, &bench::Options::SAVE)
}

/// The sizes of the built-in boards' images, in the order of the boards.
fn size_table(images: &[Image]) -> Result<String, Failure> {
    let mut table = Row::HEAD.to_owned();
    for (name, image) in ferrostep_boards::builtin_names().zip(images) {
        let board = ferrostep_boards::load(name).map_err(|error| error.to_string())?;
        let methods = if name == ferrostep_boards::DEFAULT { ", with all methods" } else { "" };
        let row = Row { name: &format!("{name}{methods}"), sizes: image.sizes, budget: Budget::of(&board) };
        table += &format!("{row}\n");
    }
    Ok(table)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Sources below a folder that write if the variable is set, or that say so.
    fn writing(root: &Path, folder: &Path, found: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if path.is_dir() {
                if !matches!(name, "target" | ".git") {
                    writing(root, &path, found);
                }
            } else if name.ends_with(".rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                if [REFRESH_VARIABLE, "REFRESH_VARIABLE", "book::keep("].iter().any(|sign| text.contains(sign)) {
                    found.push(path.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/"));
                }
            }
        }
    }

    #[test]
    fn the_readme_has_a_row_for_each_board() {
        let text = README.read().unwrap();
        let table = README.generated(&text).unwrap();
        assert!(table.contains(Row::HEAD), "{table}");
        let rows = table.lines().filter(|line| !line.is_empty()).skip(2);
        let names: Vec<&str> = rows.map(|row| row.trim_start_matches("| ").split([',', ' ']).next().unwrap()).collect();
        assert_eq!(names, ferrostep_boards::builtin_names().collect::<Vec<_>>());
    }

    #[test]
    fn no_writer_is_forgotten() {
        let root = system::root();
        let mut found = Vec::new();
        writing(&root, &root, &mut found);
        let known: Vec<&str> = DESK.iter().chain([&MASKED]).flat_map(|writer| writer.sources).copied().collect();
        for source in found.iter().filter(|source| {
            !matches!(source.as_str(), "config/checked-toml/src/book.rs" | "xtask/workbench/src/refresh.rs")
        }) {
            assert!(known.contains(&source.as_str()), "{source} writes, but `cargo xtask refresh` does not run it");
        }
        for source in known {
            assert!(root.join(source).is_file(), "{source} does not exist");
        }
    }
}
