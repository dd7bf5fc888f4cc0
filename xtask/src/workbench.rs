//! The commands that need Ferrostep's own crates: a separate program (`xtask/workbench/`), compiled
//! when one of them is first used.

use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};

use serde_json::Value;

use crate::steps::Failure;
use crate::system::{self, cargo};

/// Names of the workbench's commands, each with its effect.
pub const COMMANDS: [(&str, &str); 17] = [
    (
        "firmware",
        "Build the firmware images of one board or all, as ELF, plain bytes and Intel HEX, and print their size tables; the first \
         image's path is the first line of the output",
    ),
    (
        "bench",
        "Count the target's instructions for the parts of a print, on the virtual mainboard: the same on every machine",
    ),
    ("flash", "Build a board's firmware, write it over a debug probe, and start it"),
    (
        "on-target",
        "Measure a board over a debug probe and compare the times with their bounds; without a board, on the virtual mainboard",
    ),
    (
        "mainboard",
        "Print a file on the virtual mainboard: the board's image, unmodified, on an emulated chip with a printer around it",
    ),
    (
        "page",
        "Build the page that reads a print in a browser: one file, with the program as WebAssembly in it; its path is the first \
         line of the output",
    ),
    (
        "release",
        "Write what a release consists of into a folder: images, the command, their checksums, parts lists and licences",
    ),
    (
        "reproducible",
        "Build a board's image in two folders and compare them: the last commit makes the same bytes anywhere",
    ),
    (
        "refresh",
        "Write everything of the book, the README and the tests' data that a command makes anew: figures, tables, pictures",
    ),
    ("check-trace", "Hold a step trace against the job and the profile it came from, and print the report"),
    ("reference-time", "Print a job's motion time by the reference planner"),
    (
        "step-edges",
        "Measure how close the edges of a trace's steps come on a board whose step interrupt is as late as its image allows",
    ),
    ("against-klipper", "Make the table of the book's page \"Against Klipper's rules\", and of other files the same"),
    ("feed-plot", "Draw feed against time for slow input and for a slow planner"),
    ("hostile-programs", "Print programs that no slicer writes, and count every motor's steps at every move's end"),
    ("bresenham-lines", "Compare step Bresenham with classic Bresenham on random lines, for any number of points"),
    (
        "critical-sections",
        "Count the instructions of an image's critical sections in a short print: the longest of each place",
    ),
];

/// Name of the workbench's package.
const PACKAGE: &str = "ferrostep-workbench";

/// Cargo's profile, that of the tests, for which its crates are compiled anyway; and the folder of
/// that profile's programs.
const PROFILE: (&str, &str) = ("test", "debug");

/// True for a command of the workbench.
pub fn has(command: &OsStr) -> bool {
    COMMANDS.iter().any(|(name, _)| command == *name)
}

/// The compiled program.
#[derive(Clone, Debug)]
pub struct Workbench(PathBuf);

impl Workbench {
    /// Compiles it, unless that has been done.
    ///
    /// # Errors
    /// The workbench does not compile.
    pub fn build() -> Result<Self, Failure> {
        let (profile, folder) = PROFILE;
        system::run(cargo().args(["build", "--quiet", "--profile", profile, "--package", PACKAGE]))?;
        let name = format!("{PACKAGE}{}", std::env::consts::EXE_SUFFIX);
        Ok(Self(system::target_directory().join(folder).join(name)))
    }

    /// Makes one of its commands with arguments, in the present folder.
    pub fn command<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Command {
        let mut command = Command::new(&self.0);
        command.args(arguments);
        command
    }

    /// Runs a command and checks only that it succeeds: its results are for a
    /// person, and not shown.
    ///
    /// # Errors
    /// The command fails.
    pub fn check<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Result<(), Failure> {
        system::run(self.command(arguments).stdout(Stdio::null()))
    }

    /// Returns the result of a command with `--json`.
    ///
    /// # Errors
    /// The command fails, or its output is not JSON.
    pub fn json<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Result<Value, Failure> {
        let mut command = self.command(arguments);
        let output = system::run_for_output(command.arg("--json"))?;
        serde_json::from_str(&output).map_err(|error| format!("{error} in {output}"))
    }
}

/// Runs a command as if it were one of this program: its output and its exit status are passed on.
///
/// # Errors
/// The workbench does not compile.
pub fn forward(arguments: impl IntoIterator<Item = OsString>) -> Result<ExitCode, Failure> {
    let workbench = Workbench::build()?;
    let status = workbench
        .command(arguments)
        .status()
        .map_err(|error| format!("cannot run {}: {error}", workbench.0.display()))?;
    // A program that was ended by a signal has no code.
    Ok(status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from))
}
