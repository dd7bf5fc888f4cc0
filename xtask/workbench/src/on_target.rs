//! Over a debug probe: flashing, and the tests that measure the board they run on.
//!
//! Without a probe those tests run on the virtual mainboard: there they count instructions, and do
//! not measure how late a step is.

use std::path::{Path, PathBuf};
use std::process::Command;

use object::{Object, ObjectSection, ObjectSymbol};

use crate::firmware::{self, Program, Shown, Target};
use crate::mainboard::{self, Counter};
use crate::steps::{Failure, Run};
use crate::system;

/// The program that talks to debug probes.
const PROBE_RS: &str = "probe-rs";

/// Section in which the test harness keeps its tests: a symbol for each, whose name is JSON, and
/// there three words, the first of which is the address of the test's code.
const SECTION: &str = ".embedded_test";

/// The tests' source as a panic's place names it.
const ON_TARGET_SOURCE: &str = "on_target/main.rs:";

/// Arguments of `flash`.
#[derive(Clone, Debug, clap::Args)]
pub struct FlashOptions {
    /// The board: bench, prusa-buddy, btt-octopus-1.1 or the path of a TOML file
    #[arg(long)]
    board: String,
    /// The machine: cartesian, corexy, prusa-mini or the path of a TOML file; the
    /// board's own by default
    #[arg(long)]
    profile: Option<String>,
    /// Start of the image, bytes from the start of flash; the board's own by default
    #[arg(long, value_name = "BYTES", value_parser = firmware::bytes)]
    boot_offset: Option<u32>,
}

/// Arguments of `on-target`.
#[derive(Clone, Debug, clap::Args)]
pub struct TestOptions {
    /// The board at the probe, by name or the path of a TOML file; the virtual mainboard by default
    #[arg(long)]
    board: Option<String>,
    /// The machine: cartesian, corexy, prusa-mini or the path of a TOML file; the
    /// board's own by default
    #[arg(long, requires = "board")]
    profile: Option<String>,
    /// Start of the image, bytes from the start of flash; the board's own by default
    #[arg(long, value_name = "BYTES", value_parser = firmware::bytes, requires = "board")]
    boot_offset: Option<u32>,
    /// The virtual mainboard's program; it is built by default
    #[arg(long, value_name = "PROGRAM", conflicts_with = "board")]
    mainboard: Option<PathBuf>,
}

/// Builds the firmware of a board, writes it over a probe, and starts it.
pub fn flash(run: &mut Run, options: &FlashOptions) -> Result<(), Failure> {
    let target = Target::new(&options.board, options.profile.as_deref())?.at(options.boot_offset)?;
    run.step("probe-rs is installed", probe_rs)?;
    let image = firmware::build_image(run, &target, Shown::Output)?.path;
    run.step("flash", || {
        let chip = target.probe_name();
        system::run(Command::new(PROBE_RS).args(["download", "--verify", "--chip", chip]).arg(&image))?;
        system::run(Command::new(PROBE_RS).args(["reset", "--chip", chip]))
    })
}

/// Builds the tests for a board and runs them over a probe.
pub fn test(run: &mut Run, options: &TestOptions) -> Result<(), Failure> {
    let Some(board) = &options.board else {
        let mainboard = options.mainboard.clone().map_or_else(|| mainboard::build(run), Ok)?;
        return rehearse(run, &mainboard);
    };
    let target = Target::new(board, options.profile.as_deref())?.at(options.boot_offset)?;
    run.step("probe-rs is installed", probe_rs)?;
    let image = firmware::build(run, Program::OnTarget, &target)?;
    run.step("on-target tests", || {
        system::run(Command::new(PROBE_RS).args(["run", "--chip", target.probe_name()]).arg(&image))
    })
}

/// Builds them for the bench and runs them on the virtual mainboard.
fn rehearse(run: &mut Run, mainboard: &Path) -> Result<(), Failure> {
    let image = firmware::build(run, Program::OnTarget, &Target::bench()?)?;
    run.step("on-target tests on the virtual mainboard", || {
        let bytes = std::fs::read(&image).map_err(|error| format!("{}: {error}", image.display()))?;
        let tests = tests(&bytes).map_err(|error| format!("{}: {error}", image.display()))?;
        // Each test has a separate machine and one thread: two of them take longer than all
        // others together.
        let outcomes: Vec<Result<String, Failure>> = std::thread::scope(|scope| {
            let running: Vec<_> = tests.iter().map(|test| scope.spawn(|| outcome(mainboard, &image, test))).collect();
            let ended = running.into_iter().map(|test| test.join());
            ended.map(|test| test.unwrap_or_else(|_| Err("its thread panicked".to_owned()))).collect()
        });
        for (OnTargetTest { name, .. }, outcome) in tests.iter().zip(outcomes) {
            let said = outcome.map_err(|reason| format!("{name}: {reason}"))?;
            eprintln!("    {name}");
            said.lines().for_each(|line| eprintln!("        {line}"));
        }
        Ok(())
    })
}

/// Runs one of the tests; returns its output.
fn outcome(mainboard: &Path, image: &Path, test: &OnTargetTest) -> Result<String, Failure> {
    // The harness's runner names the test in the program's arguments.
    let arguments = format!("run_addr {}", test.address);
    let folder = system::target_directory();
    let outcome = mainboard::counting(mainboard, image, Counter::Core, &folder, &arguments)
        .and_then(|mut command| mainboard::output_of(&mut command));
    if test.should_panic { panicked(outcome) } else { outcome }
}

/// The log's line of a panic in the tests' source, for a test that must end in one.
fn panicked(outcome: Result<String, Failure>) -> Result<String, Failure> {
    let Err(reason) = outcome else { return Err("it has not panicked".to_owned()) };
    let log: Vec<&str> = reason.lines().filter(|line| line.starts_with("log: error panicked at ")).collect();
    let is_noticed = reason.contains("the program panicked or faulted");
    if is_noticed && log.iter().any(|line| line.contains(ON_TARGET_SOURCE)) { Ok(log.join("\n")) } else { Err(reason) }
}

fn probe_rs() -> Result<(), Failure> {
    match system::output(Command::new(PROBE_RS).arg("--version")) {
        Some(version) => {
            eprintln!("    {}", version.trim());
            Ok(())
        }
        None => {
            Err(format!("{PROBE_RS} is missing, which speaks to debug probes: https://probe.rs says how to install it"))
        }
    }
}

/// One of the tests in an image.
#[derive(Debug, PartialEq, Eq)]
struct OnTargetTest {
    name: String,
    address: u32,
    /// The test passes by a panic.
    should_panic: bool,
}

/// All tests of an image.
fn tests(image: &[u8]) -> Result<Vec<OnTargetTest>, Failure> {
    let file = object::File::parse(image).map_err(|error| error.to_string())?;
    let section = file.section_by_name(SECTION).ok_or("there are no tests in it")?;
    let data = section.data().map_err(|error| error.to_string())?;
    let mut tests = Vec::new();
    for symbol in file.symbols().filter(|symbol| symbol.section_index() == Some(section.index())) {
        let text = symbol.name().map_err(|error| error.to_string())?;
        let Ok(entry) = serde_json::from_str::<serde_json::Value>(text) else { continue };
        let name = entry.get("name").and_then(serde_json::Value::as_str).ok_or_else(|| format!("{text}: no name"))?;
        let place = usize::try_from(symbol.address().saturating_sub(section.address())).unwrap_or(usize::MAX);
        let word =
            data.get(place..).and_then(|rest| rest.first_chunk()).ok_or_else(|| format!("{name}: no address"))?;
        let should_panic = entry.get("should_panic").and_then(serde_json::Value::as_bool).unwrap_or(false);
        tests.push(OnTargetTest { name: name.to_owned(), address: u32::from_le_bytes(*word), should_panic });
    }
    if tests.is_empty() { Err("there are no tests in it".to_owned()) } else { Ok(tests) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_image_without_tests_is_refused() {
        let this = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        assert_eq!(tests(&this).unwrap_err(), "there are no tests in it");
        assert!(tests(b"no image").is_err());
    }

    #[test]
    fn a_panic_counts_only_with_its_place_in_the_log() {
        let ended = "the program panicked or faulted: a hard fault at 0x08001234";
        let logged = "log: error panicked at tests/bench/src/bin/on_target/main.rs:5:9:";
        assert_eq!(panicked(Err(format!("{logged}\n{ended}"))).unwrap(), logged);
        assert!(panicked(Err(ended.to_owned())).is_err());
        assert!(panicked(Err(logged.to_owned())).is_err());
        assert!(panicked(Ok(String::new())).is_err());
    }
}
