//! The check of a change ([`test`]) and of everything ([`everything`]): the tiers
//! above `cargo test`.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::images::{IMAGES_VARIABLE, images};
use crate::programs::{self, Program};
use crate::share::{self, Share};
use crate::steps::{Failure, Run};
use crate::system::{self, cargo};
use crate::tools::{self, Installed};
use crate::turns::Turns;
use crate::workbench::Workbench;
use crate::{DESK, FIRMWARE_VARIABLE, HOSTS_VARIABLE, budget, cost, mutants, policy, prose, seed};

/// Proptest cases a property in `ci`; the default of 256 serves `test`.
const CI_PROPTEST_CASES: &str = "4096";

/// Package of the image tests; most of these take turns.
const MAINBOARD: &str = "ferrostep-mainboard";

/// Package of the tests with programs from outside: hosts, a browser, slicers.
const OUTSIDE: &str = "ferrostep-outside-tests";

/// Number of checks in a row, one of which runs the on-target tests.
const ON_TARGET_TURNS: u64 = 5;

/// Arguments of `test`.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// The share of long sweeps and image tests: 0 to 19, or all; the commit's own by default
    #[arg(long, value_name = "K|all")]
    share: Option<Share>,
    /// Leaves out what `cargo test` runs, which has just been run
    #[arg(long)]
    after_cargo_test: bool,
    /// Tests first the packages that depend on files changed since this commit
    #[arg(long, value_name = "COMMIT", default_value = "HEAD~1")]
    since: String,
}

/// Checks a change.
///
/// # Errors
/// The first check that fails.
pub fn test(run: &mut Run, options: &Options) -> Result<(), Failure> {
    tested(run, options).map(|_| ())
}

/// Checks everything, and compares the steps' costs with those of an earlier run, or keeps
/// them for later ones.
///
/// # Errors
/// The first check that fails.
pub fn everything(run: &mut Run, save_costs: bool) -> Result<(), Failure> {
    let unit_s = run.step("calibration", || Ok(cost::calibration_s()))?;
    let options = Options { share: Some(Share::All), after_cargo_test: false, since: "HEAD~1".to_owned() };
    let workbench = tested(run, &options)?;
    slow(run, &workbench)?;
    let costs: Vec<_> = run.costs().collect();
    run.step("costs of the steps", || {
        if save_costs { budget::write(&costs, unit_s) } else { budget::check(&costs, unit_s) }
    })
}

fn tested(run: &mut Run, options: &Options) -> Result<Workbench, Failure> {
    run.step("rustfmt and clippy are installed", || {
        system::rustup_component("rustfmt", "fmt")?;
        system::rustup_component("clippy", "clippy")
    })?;
    let installed = tools::install(run)?;
    run.step("format", || system::run(cargo().args(["fmt", "--all", "--check"])))?;
    run.step("wording of comments and pages", prose::check)?;
    let share = run.step("share of long sweeps and image tests", || Ok(chosen(options.share)))?;
    let affected = programs::affected(&options.since).unwrap_or_else(|reason| {
        eprintln!("    tests run in the packages' order: {reason}");
        Default::default()
    });
    // The workbench is built before the tests: beside them cargo would wait for its own lock.
    let workbench = run.step("workbench: build", Workbench::build)?;
    let mainboard = run.step("virtual mainboard: build", || program_of(&workbench))?;
    // Images are linked and counted on one core.
    let mut programs = Vec::new();
    let image = run.beside(
        "lints and test programs: build",
        || {
            let mut clippy = cargo();
            clippy.arg("clippy").args(DESK).args(["--all-targets", "--", "-D", "warnings"]);
            system::run(&mut clippy)?;
            programs = programs::build(&DESK)?;
            Ok(())
        },
        |run| {
            let image = run.step("images, with their lints", || bench_image(&workbench))?;
            run.step("counts of the target", || {
                let bench = ["bench", "--check", "--only", "target", "--mainboard"].map(Path::new);
                workbench.check(bench.into_iter().chain([&*mainboard, Path::new("--image"), &*image]))
            })?;
            // The programs for a board and a probe do not depend on an image's change.
            if share.has(0, ON_TARGET_TURNS) {
                run.step("on-target tests", || {
                    workbench.check(["on-target", "--mainboard"].map(Path::new).into_iter().chain([&*mainboard]))
                })?;
            }
            Ok(image)
        },
    )?;
    if options.after_cargo_test {
        let tested = default_members()?;
        programs.retain(|program| !tested.contains(&program.package));
    }
    // A stable sort keeps the order within both parts.
    programs.sort_by_key(|program| !affected.contains(&program.package));
    let surroundings = Surroundings { installed: &installed, image: &image, images: images(), share: share.value() };
    let (outside, programs): (Vec<_>, Vec<_>) = programs.into_iter().partition(|program| program.package == OUTSIDE);
    let test = |program: &Program| surroundings.run(program, &arguments(program, share)?);
    // Hosts and browsers wait for clocks, and a print on a board takes one core.
    run.beside(
        "programs from outside, first layers",
        || {
            outside.iter().try_for_each(test)?;
            system::run(workbench.command(["mainboard", "--prints", "--share"]).arg(share.to_string()))
        },
        |run| run.step("tests", || programs.iter().try_for_each(test)),
    )?;
    if !options.after_cargo_test {
        run.step("examples in documentation", || system::run_tests(cargo().args(["test", "--doc"]).args(DESK)))?;
    }
    Ok(workbench)
}

/// The share that is asked for, or the commit's; says how to repeat it.
fn chosen(asked: Option<Share>) -> Share {
    let (share, why) = asked.map_or_else(Share::of_this_commit, |share| (share, "as asked for".to_owned()));
    eprintln!("    {why}; the same again: cargo xtask test --share {share}");
    share
}

/// Paths and values that test programs get in variables.
struct Surroundings<'a> {
    installed: &'a Installed,
    image: &'a Path,
    images: PathBuf,
    share: String,
}

impl Surroundings<'_> {
    fn run(&self, program: &Program, arguments: &[String]) -> Result<(), Failure> {
        let variables: [(&str, &OsStr); 5] = [
            (HOSTS_VARIABLE, self.installed.hosts.as_os_str()),
            (tools::CURA_VARIABLE, self.installed.cura.as_os_str()),
            (FIRMWARE_VARIABLE, self.image.as_os_str()),
            (IMAGES_VARIABLE, self.images.as_os_str()),
            (share::VARIABLE, OsStr::new(&self.share)),
        ];
        program.run(arguments, &variables)
    }
}

/// Arguments of a test program: image tests whose turn it is not are left out by name.
fn arguments(program: &Program, share: Share) -> Result<Vec<String>, Failure> {
    if program.package != MAINBOARD || program.target != "mainboard" {
        return Ok(Vec::new());
    }
    let turns = Turns::read()?;
    let names = program.tests()?;
    let waiting: Vec<String> = turns.waiting(&names, share).map(str::to_owned).collect();
    eprintln!("    {} of {} image tests wait for one of the next {} commits", waiting.len(), names.len(), turns.turns);
    Ok(std::iter::once("--exact".to_owned())
        .chain(waiting.into_iter().flat_map(|name| ["--skip".to_owned(), name]))
        .collect())
}

/// Packages that `cargo test` tests.
fn default_members() -> Result<Vec<String>, Failure> {
    let metadata = programs::metadata()?;
    let list = |key: &str| metadata.get(key).and_then(Value::as_array).cloned().unwrap_or_default();
    let members = list("workspace_default_members");
    let is_default = |package: &Value| package.get("id").is_some_and(|id| members.contains(id));
    let name = |package: &Value| package.get("name").and_then(Value::as_str).map(str::to_owned);
    Ok(list("packages").iter().filter(|package| is_default(package)).filter_map(name).collect())
}

/// Builds the virtual mainboard's program.
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

/// Checks that take too long for every change: the tests on released code, with more and new random
/// cases, and a part of the mutants, which show gaps in the tests.
fn slow(run: &mut Run, workbench: &Workbench) -> Result<(), Failure> {
    policy::check(run)?;
    run.step("counts of the desk", || workbench.check(["bench", "--check", "--only", "desk"]))?;
    run.step("documentation", || {
        let mut doc = cargo();
        doc.arg("doc").args(DESK).args(["--no-deps", "--document-private-items"]);
        system::run(doc.env("RUSTDOCFLAGS", "-D warnings"))
    })?;
    let seed = seed::of_this_run();
    run.step("tests as released, with more and other random cases", || {
        eprintln!("    random cases of seed {seed}: {}={seed} tries them again", seed::VARIABLE);
        let mut tests = cargo();
        tests
            .args(["test", "--release"])
            .env("PROPTEST_CASES", CI_PROPTEST_CASES)
            .env(seed::VARIABLE, seed.to_string());
        system::run_tests(tests.env(share::VARIABLE, Share::All.value()))
    })?;
    mutants::check_a_part(run, seed)
}
