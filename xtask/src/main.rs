//! Build, test, bench, flash: the same commands for CI and for a person.
//!
//! Each subcommand is a list of steps that run one after the other; the first that fails ends the run.
#![forbid(unsafe_code)]

mod bbf;
mod bench;
mod core_library;
mod firmware;
mod generated;
mod hosts;
mod house;
mod image;
mod mainboard;
mod mutants;
mod no_std;
mod on_target;
mod policy;
mod refresh;
mod release;
mod reproducible;
mod seed;
mod size;
mod slicers;
mod steps;
mod system;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use steps::{Failure, Run};
use system::cargo;

/// Proptest cases a property in `ci`; the default of 256 serves `test`.
const CI_PROPTEST_CASES: &str = "4096";

/// Environment variable that tells the tests where the firmware image is.
const FIRMWARE_VARIABLE: &str = "FERROSTEP_FIRMWARE";

/// Environment variable that tells the tests where the hosts are.
const HOSTS_VARIABLE: &str = "FERROSTEP_HOSTS";

/// All packages but those that only the board's processor can build.
const DESK: [&str; 11] = [
    "--workspace",
    "--exclude",
    "ferrostep-firmware",
    "--exclude",
    "ferrostep-bench",
    "--exclude",
    "ferrostep-stm32f4-board",
    "--exclude",
    "ferrostep-stm32f4-usb",
    "--exclude",
    "ferrostep-step-interrupt",
];

/// Tasks of the Ferrostep workspace.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

/// The tasks.
#[derive(Clone, Subcommand)]
enum Task {
    /// Install what is missing, then check format, lints, tests, documentation and the target build
    Test,
    /// All of `test`, then spelling, licences and sources of dependencies, the tests again as released code with more and
    /// other random cases, and a part of the mutants
    Ci,
    /// Build the firmware images of one board or all, as ELF, plain bytes and Intel HEX, and print their size tables; the
    /// first image's path is the first line of the output
    Firmware(firmware::Options),
    /// Count the target's instructions for the parts of a print, on the virtual mainboard: the same on every machine
    Bench(bench::Options),
    /// Build a board's firmware, write it over a debug probe, and start it
    Flash(on_target::FlashOptions),
    /// Measure a board over a debug probe and compare the times with their bounds; without a board, on the virtual mainboard
    OnTarget(on_target::TestOptions),
    /// Print a file on the virtual mainboard: the board's image, unmodified, on an emulated chip with a printer around it
    Mainboard(mainboard::Options),
    /// Install the hosts that tests print with (OctoPrint, printcore) into a Python environment; its folder is the first line of
    /// the output
    Hosts,
    /// Write what a release consists of into a folder: images, the command, their checksums, parts lists and licences
    Release(release::Options),
    /// Build a board's image in two folders and compare them: the last commit makes the same bytes anywhere
    Reproducible(reproducible::Options),
    /// Write everything of the book, the README and the tests' data that a command makes anew: figures, tables, pictures
    Refresh(refresh::Options),
    /// Make small mistakes in the code, one at a time, and list those that no test notices
    Mutants(mutants::Options),
    /// Check that the firmware's crates build for thumbv7em-none-eabihf, without std
    NoStd,
}

fn main() -> ExitCode {
    let task = Arguments::parse().task;
    let name = match task {
        Task::Test => "test",
        Task::Ci => "ci",
        Task::Firmware(_) => "firmware",
        Task::Bench(_) => "bench",
        Task::Flash(_) => "flash",
        Task::OnTarget(_) => "on-target",
        Task::Mainboard(_) => "mainboard",
        Task::Hosts => "hosts",
        Task::Release(_) => "release",
        Task::Reproducible(_) => "reproducible",
        Task::Refresh(_) => "refresh",
        Task::Mutants(_) => "mutants",
        Task::NoStd => "no-std",
    };
    let mut run = Run::new(name);
    let result = match task {
        Task::Test => test(&mut run).map(|_| ()),
        Task::Ci => test(&mut run).and_then(|image| slow_tests(&mut run, &image)),
        Task::Firmware(options) => firmware::build_images(&mut run, &options).map(|_| ()),
        Task::Bench(options) => bench::run(&mut run, options),
        Task::Flash(options) => on_target::flash(&mut run, &options),
        Task::OnTarget(options) => on_target::test(&mut run, &options),
        Task::Mainboard(options) => mainboard::run(&mut run, &options),
        Task::Hosts => hosts::install(&mut run).map(|folder| println!("{}", folder.display())),
        Task::Reproducible(options) => reproducible::check(&mut run, &options),
        Task::Release(options) => release::write(&mut run, &options),
        Task::Refresh(options) => refresh::write(&mut run, &options),
        Task::Mutants(options) => mutants::run(&mut run, &options),
        Task::NoStd => no_std::check(&mut run),
    };
    run.finish(result)
}

/// All checks of a change. Returns the path of the firmware image that was tested.
fn test(run: &mut Run) -> Result<PathBuf, Failure> {
    run.step("rustfmt and clippy are installed", || {
        system::rustup_component("rustfmt", "fmt")?;
        system::rustup_component("clippy", "clippy")
    })?;
    run.step("format", || system::run(cargo().args(["fmt", "--all", "--check"])))?;
    run.step("lints", || {
        let mut clippy = cargo();
        clippy.arg("clippy").args(DESK).args(["--all-targets", "--features", slicers::FEATURE]);
        system::run(clippy.args(["--", "-D", "warnings"]))
    })?;
    let cura = run.step("slicers to test with", slicers::find)?;
    // The test profile and not release: it is optimised but checks overflows and debug assertions, and does not spend
    // minutes on link-time optimisation of every test program.
    let tests = || {
        let mut tests = cargo();
        tests.args(["test", "--no-fail-fast"]).args(DESK);
        if let Some(cura) = &cura {
            tests.args(["--features", slicers::FEATURE]).env(slicers::CURA_VARIABLE, cura);
        }
        tests
    };
    let mainboard = mainboard::build(run)?;
    // Images are checked, linked and counted on one core.
    let (image, hosts) = run.beside(
        "tests: build",
        || system::run(tests().arg("--no-run")),
        |run| {
            firmware::check(run)?;
            // All boards; the bench's comes first.
            let images = firmware::build_images(run, &firmware::Options::default())?;
            let image = images.into_iter().next().ok_or("there is no board")?;
            bench::check(run, &mainboard, &image)?;
            on_target::rehearse(run, &mainboard)?;
            Ok((image, hosts::install(run)?))
        },
    )?;
    run.step("tests", || {
        let mut tests = tests();
        tests.env(HOSTS_VARIABLE, &hosts).env(FIRMWARE_VARIABLE, &image);
        system::run_tests(tests.env(image::IMAGES_VARIABLE, image::images()))
    })?;
    run.step("documentation", || {
        system::run(
            cargo()
                .arg("doc")
                .args(DESK)
                .args(["--no-deps", "--document-private-items"])
                .env("RUSTDOCFLAGS", "-D warnings"),
        )
    })?;
    no_std::check(run)?;
    mainboard::check(run)?;
    Ok(image)
}

/// Checks that take too long for every change: the tests on released code, with more and new random cases, and a part of the
/// mutants, which show what the tests miss.
fn slow_tests(run: &mut Run, image: &Path) -> Result<(), Failure> {
    policy::check(run)?;
    bench::check_desk(run)?;
    let seed = seed::of_this_run();
    run.step("tests as released, with more and other random cases", || {
        eprintln!("    random cases of seed {seed}: {}={seed} tries them again", seed::VARIABLE);
        system::run_tests(
            cargo()
                .arg("test")
                .args(DESK)
                .arg("--release")
                .env("PROPTEST_CASES", CI_PROPTEST_CASES)
                .env(seed::VARIABLE, seed.to_string())
                .env(FIRMWARE_VARIABLE, image)
                .env(image::IMAGES_VARIABLE, image::images()),
        )
    })?;
    mutants::check_a_part(run, seed)
}
