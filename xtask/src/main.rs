//! `cargo xtask`: its arguments, and what `test` and `ci` consist of.
#![forbid(unsafe_code)]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Command, CommandFactory, FromArgMatches, Parser, Subcommand};

use xtask::images::{IMAGES_VARIABLE, images};
use xtask::steps::{Failure, Run};
use xtask::system::{self, cargo};
use xtask::workbench::{self, Workbench};
use xtask::{DESK, FIRMWARE_VARIABLE, HOSTS_VARIABLE, hosts, mutants, no_std, policy, seed, slicers};

/// Proptest cases a property in `ci`; the default of 256 serves `test`.
const CI_PROPTEST_CASES: &str = "4096";

/// Tasks of the Ferrostep workspace.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

/// The tasks that need none of Ferrostep's crates.
#[derive(Clone, Subcommand)]
enum Task {
    /// Install what is missing, then check format, lints, tests, documentation and the target build
    Test,
    /// All of `test`, then spelling, licences and sources of dependencies, the tests again as released code with more and
    /// other random cases, and a part of the mutants
    Ci,
    /// Install the hosts that tests print with (OctoPrint, printcore) into a Python environment; its folder is the first line of
    /// the output
    Hosts,
    /// Make small mistakes in the code, one at a time, and list those that no test notices
    Mutants(mutants::Options),
    /// Check that the firmware's crates build for thumbv7em-none-eabihf, without std
    NoStd,
}

/// The arguments, with the workbench's commands for the help.
fn command() -> Command {
    workbench::COMMANDS
        .iter()
        .fold(Arguments::command(), |command, (name, about)| command.subcommand(Command::new(*name).about(*about)))
}

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    if arguments.first().is_some_and(|first| workbench::has(first)) {
        return workbench::forward(arguments).unwrap_or_else(|reason| {
            eprintln!("stopped: {reason}");
            ExitCode::FAILURE
        });
    }
    let task = match Arguments::from_arg_matches(&command().get_matches()) {
        Ok(arguments) => arguments.task,
        Err(error) => error.exit(),
    };
    let name = match task {
        Task::Test => "test",
        Task::Ci => "ci",
        Task::Hosts => "hosts",
        Task::Mutants(_) => "mutants",
        Task::NoStd => "no-std",
    };
    let mut run = Run::new(name);
    let result = match task {
        Task::Test => test(&mut run).map(|_| ()),
        Task::Ci => test(&mut run).and_then(|tested| slow_tests(&mut run, &tested)),
        Task::Hosts => hosts::install(&mut run).map(|folder| println!("{}", folder.display())),
        Task::Mutants(options) => mutants::run(&mut run, &options),
        Task::NoStd => no_std::check(&mut run),
    };
    run.finish(result)
}

/// The programs of a run of `test`.
struct Tested {
    workbench: Workbench,
    /// The bench's firmware image.
    image: PathBuf,
}

/// All checks of a change.
fn test(run: &mut Run) -> Result<Tested, Failure> {
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
    // Before the tests: beside them cargo would wait for its own lock.
    let workbench = run.step("workbench: build", Workbench::build)?;
    let mainboard = run.step("virtual mainboard: build", || program_of(&workbench))?;
    // Images are checked, linked and counted on one core.
    let (image, hosts) = run.beside(
        "tests: build",
        || system::run(tests().arg("--no-run")),
        |run| {
            let image = run.step("images", || bench_image(&workbench))?;
            run.step("counts of the target", || {
                let bench = ["bench", "--check", "--only", "target", "--mainboard"].map(Path::new);
                workbench.check(bench.into_iter().chain([&*mainboard, Path::new("--image"), &*image]))
            })?;
            run.step("on-target tests", || {
                workbench.check(["on-target", "--mainboard"].map(Path::new).into_iter().chain([&*mainboard]))
            })?;
            Ok((image, hosts::install(run)?))
        },
    )?;
    run.step("tests", || {
        let mut tests = tests();
        tests.env(HOSTS_VARIABLE, &hosts).env(FIRMWARE_VARIABLE, &image);
        system::run_tests(tests.env(IMAGES_VARIABLE, images()))
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
    run.step("virtual mainboard", || system::run(&mut workbench.command(["mainboard", "--check"])))?;
    Ok(Tested { workbench, image })
}

/// The virtual mainboard's program.
fn program_of(workbench: &Workbench) -> Result<PathBuf, Failure> {
    let said = system::run_for_output(&mut workbench.command(["mainboard", "--program"]))?;
    Ok(PathBuf::from(said.trim_end()))
}

/// Lints the firmware, builds all boards' images, and returns the path of the bench's.
fn bench_image(workbench: &Workbench) -> Result<PathBuf, Failure> {
    let built = workbench.json(["firmware", "--lints"])?;
    // All boards; the bench's comes first.
    let image = built["boards"][0]["image"].as_str().ok_or("there is no board")?;
    Ok(PathBuf::from(image))
}

/// Checks that take too long for every change: the tests on released code, with more and new random cases, and a part of the
/// mutants, which show what the tests miss.
fn slow_tests(run: &mut Run, tested: &Tested) -> Result<(), Failure> {
    policy::check(run)?;
    run.step("counts of the desk", || tested.workbench.check(["bench", "--check", "--only", "desk"]))?;
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
                .env(FIRMWARE_VARIABLE, &tested.image)
                .env(IMAGES_VARIABLE, images()),
        )
    })?;
    mutants::check_a_part(run, seed)
}
