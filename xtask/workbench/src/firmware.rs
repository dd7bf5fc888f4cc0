//! The firmware's images: built for a board, written in its boot loader's format, with
//! a table of sizes.

use std::path::{Path, PathBuf};
use std::process::Command;

use ferrostep_boards::Board;
use ferrostep_image_code::code::Code;
use ferrostep_image_code::interrupt_time;
use ferrostep_image_code::stack_need::StackNeed;
use ferrostep_planner::MotionChoice;
use ferrostep_step_player::MIN_GAP_TICKS;
use serde_json::{Value, json};

use crate::core_library::{self, FailedCheck};
use crate::image;
use crate::size::{Budget, Sizes, Table};
use crate::steps::{Failure, Run};
use crate::system::{self, cargo};

/// The images to build.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// The board: bench, prusa-buddy, btt-octopus-1.1 or the path of a TOML file; all built-in
    /// boards by default
    #[arg(long)]
    board: Option<String>,
    /// The machine: cartesian, corexy, prusa-mini or the path of a TOML file; the
    /// board's own by default
    #[arg(long)]
    profile: Option<String>,
    /// Start of the image, bytes from the start of flash; the board's own by default. 0 puts the
    /// image where the boot loader is
    #[arg(long, value_name = "BYTES", value_parser = bytes, requires = "board")]
    boot_offset: Option<u32>,
    /// Checks the lints of the firmware's own packages first, which the desk cannot build
    #[arg(long)]
    lints: bool,
    /// Prints one JSON object on standard output: the boards with their images, sizes
    /// and budgets, bytes
    #[arg(long)]
    json: bool,
}

/// Destination of paths and size tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// Standard output: they are results.
    Output,
    /// Standard error, since standard output has other results.
    Progress,
}

impl Shown {
    /// Chooses standard error if standard output is one JSON value.
    pub fn beside_json(json: bool) -> Self {
        if json { Self::Progress } else { Self::Output }
    }
}

/// A board's image.
#[derive(Clone, Debug)]
pub struct Image {
    /// Path of the ELF file; the others are in its folder.
    pub path: PathBuf,
    board: String,
    /// Memory that the image takes.
    pub sizes: Sizes,
    budget: Budget,
}

impl Image {
    /// Board, path, sizes and budget, bytes.
    pub fn json(&self) -> Value {
        let Self { path, board, sizes, budget } = self;
        json!({
            "board": board,
            "image": path,
            "sizes": {
                "text": sizes.text,
                "data": sizes.data,
                "bss": sizes.bss,
                "ccm": sizes.ccm,
                "flash": sizes.flash(),
                "ram": sizes.ram(),
            },
            "budget": {"flash": budget.flash, "ram": budget.ram},
        })
    }
}

/// `cargo xtask firmware`.
pub fn run(run: &mut Run, options: &Options) -> Result<(), Failure> {
    if options.lints {
        check(run)?;
    }
    let images = build_images(run, options, Shown::beside_json(options.json))?;
    if options.json {
        println!("{:#}", json!({"boards": images.iter().map(Image::json).collect::<Vec<_>>()}));
    }
    Ok(())
}

/// A number of bytes, decimal or hexadecimal (`0x20200`).
///
/// # Errors
/// The text is neither.
pub fn bytes(text: &str) -> Result<u32, String> {
    let number = match text.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.map_err(|_| "expected a number of bytes, such as 0 or 0x20200".to_owned())
}

/// A board and its machine.
#[derive(Clone, Debug)]
pub struct Target {
    board: Board,
    /// Names, or absolute paths, since build scripts run in other folders.
    board_variable: String,
    profile_variable: Option<String>,
    /// Start of the image, if not at the board's own offset.
    boot_offset: Option<u32>,
    /// Features for the methods in its image: all of them on the bench, otherwise the profile's.
    methods: Vec<&'static str>,
}

impl Target {
    /// A board by name or path, with a profile by name or path, or its own.
    ///
    /// # Errors
    /// A file has a fault, or the two do not fit; errors name file, line and key.
    pub fn new(board: &str, profile: Option<&str>) -> Result<Self, Failure> {
        let loaded = ferrostep_boards::load(board).map_err(|error| error.to_string())?;
        let profile_name = profile.unwrap_or(&loaded.profile);
        let machine = ferrostep_profiles::load(profile_name).map_err(|error| error.to_string())?;
        ferrostep_boards::fit::check(&loaded, &machine, profile_name).map_err(|error| error.to_string())?;
        let is_board = |name: &str| ferrostep_boards::builtin_text(name).is_some();
        let is_profile = |name: &str| ferrostep_profiles::builtin_text(name).is_some();
        Ok(Self {
            board_variable: absolute(board, is_board)?,
            profile_variable: profile.map(|name| absolute(name, is_profile)).transpose()?,
            methods: methods(&loaded, profile_name, &machine.motion)?,
            board: loaded.for_machine(&machine),
            boot_offset: None,
        })
    }

    /// The same with its image at another place of flash, if one is given.
    ///
    /// # Errors
    /// No image may begin there.
    pub fn at(self, boot_offset: Option<u32>) -> Result<Self, Failure> {
        let Some(offset) = boot_offset.filter(|offset| *offset != self.board.boot_offset) else { return Ok(self) };
        Ok(Self { board: self.board.at_boot_offset(offset)?, boot_offset: Some(offset), ..self })
    }

    /// The chip as probe-rs calls it.
    pub fn probe_name(&self) -> &str {
        self.board.chip.probe_name
    }

    /// The bench, whose programs the virtual mainboard runs.
    pub fn bench() -> Result<Self, Failure> {
        Self::new(ferrostep_boards::DEFAULT, None)
    }
}

/// Features for the methods of motion: a printer's image contains the standard ones only,
/// the bench's all.
///
/// # Errors
/// The profile of a printer asks for another.
fn methods(board: &Board, profile: &str, motion: &MotionChoice) -> Result<Vec<&'static str>, Failure> {
    if board.name == ferrostep_boards::DEFAULT {
        return Ok(vec!["papers"]);
    }
    if motion.is_standard() {
        return Ok(Vec::new());
    }
    let (interpolation, acceleration) = (motion.interpolation.name(), motion.acceleration.name());
    Err(format!(
        "{profile}: interpolation = \"{interpolation}\", acceleration = \"{acceleration}\": a printer's image contains only \
         \"step-bresenham\" with \"trapezoid\" or \"s-curve\"; the papers' other methods run on the desk and on the bench board"
    ))
}

/// A name unchanged, or the absolute path of a file.
fn absolute(name_or_path: &str, is_name: impl Fn(&str) -> bool) -> Result<String, Failure> {
    if is_name(name_or_path) {
        return Ok(name_or_path.to_owned());
    }
    let path = std::path::absolute(name_or_path).map_err(|error| format!("{name_or_path}: {error}"))?;
    path.to_str().map(str::to_owned).ok_or_else(|| format!("{name_or_path}: the path is not Unicode text"))
}

/// Builds the named images, prints a path and a size table for each board, and returns the images,
/// the bench's first where all are built.
pub fn build_images(run: &mut Run, options: &Options, shown: Shown) -> Result<Vec<Image>, Failure> {
    let names: Vec<&str> = match &options.board {
        Some(name) => vec![name],
        None => ferrostep_boards::builtin_names().collect(),
    };
    let targets: Result<Vec<Target>, Failure> =
        names.into_iter().map(|name| Target::new(name, options.profile.as_deref())?.at(options.boot_offset)).collect();
    targets?.iter().map(|target| build_image(run, target, shown)).collect()
}

/// Builds a board's image, writes its files, and prints its path and size table.
pub fn build_image(run: &mut Run, target: &Target, shown: Shown) -> Result<Image, Failure> {
    eprintln!("\n{}", target.board.title);
    target.board.notes.iter().for_each(|note| eprintln!("    note: {note}"));
    let elf = build(run, Program::Firmware, target)?;
    run.step("time of the step interrupt, and stack", || {
        let code = Code::of(&elf)?;
        let clock = &target.board.clock;
        let gap_cycles = MIN_GAP_TICKS * (clock.core_hz / clock.timer_hz);
        let [time, measured] = interrupt_time::check(&code, gap_cycles)?;
        eprintln!("    step interrupt: {time}; at most {gap_cycles}\n    measured (M798): {measured}");
        let need = StackNeed::of(&code)?;
        eprintln!("    stack: at most {need}, with all tasks interrupting each other");
        need.check()
    })?;
    run.step("files and sizes", || {
        names_no_folder(&elf)?;
        let folder = image::folder_of(&target.board, target.boot_offset.is_some());
        let image = image::export(&elf, &target.board, &folder)?;
        let sizes = sizes(&image)?;
        let budget = Budget::of(&target.board);
        let table = format!("{}\n{}", image.display(), Table(sizes, budget));
        match shown {
            Shown::Output => println!("{table}"),
            Shown::Progress => eprintln!("{table}"),
        }
        eprintln!("    by a debug probe: probe-rs download --chip {} {}", target.probe_name(), image.display());
        sizes.check(budget).map(|()| Image { path: image, board: target.board.name.clone(), sizes, budget })
    })
}

/// The programs for boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// The firmware that prints.
    Firmware,
    /// The bench, which counts the instructions of its parts.
    Bench,
    /// The same, built to count step events instead. It replaces the other image.
    Tally,
    /// The tests that measure the board they run on.
    OnTarget,
}

impl Program {
    /// The folder of its package, from the root of the workspace.
    fn folder(self) -> &'static str {
        if self == Self::Firmware { "app" } else { "tests/bench" }
    }

    /// Main source file, from the root of the workspace.
    fn source(self) -> &'static str {
        match self {
            Self::Firmware => "app/src/main.rs",
            Self::Bench | Self::Tally => "tests/bench/src/bin/bench/main.rs",
            Self::OnTarget => "tests/bench/src/bin/on_target/main.rs",
        }
    }

    /// Effect of a failed check: a trap in the firmware, in the others a panic, whose
    /// text a probe reads.
    fn failed_check(self) -> FailedCheck {
        if self == Self::Firmware { FailedCheck::Traps } else { FailedCheck::Panics }
    }
}

/// Builds a program for a board as it is shipped, and returns the path of its image.
pub fn build(run: &mut Run, program: Program, target: &Target) -> Result<PathBuf, Failure> {
    run.step("source of the core library", core_library::require_source)?;
    let name = match program {
        Program::Firmware => "firmware image",
        Program::Bench => "bench image",
        Program::Tally => "tally image",
        Program::OnTarget => "on-target image",
    };
    run.step(name, || {
        let messages = system::run_for_output(&mut build_command(program, target)?)?;
        executable(&messages, &system::root().join(program.source()))
            .ok_or_else(|| format!("cargo names no image of {}", program.source()))
    })
}

/// Lints of the firmware's own packages, which the desk cannot build, and of the one package
/// without std that is in no image.
pub fn check(run: &mut Run) -> Result<(), Failure> {
    run.step("source of the core library", core_library::require_source)?;
    run.step("lints of the firmware", || {
        for name in ferrostep_boards::builtin_names() {
            let target = Target::new(name, None)?;
            // All at once: one after the other they would check the chip's registers with other
            // features each time.
            let board = ["--package", "ferrostep-stm32f4-board", "--package", "ferrostep-stm32f4-usb"];
            let both = ["--package", "ferrostep-binary-gcode"];
            let firmware =
                ["--package", "ferrostep-step-interrupt", "--package", "ferrostep-firmware", "--lib", "--bins"];
            let chip = ["--no-default-features", "--features", target.board.chip.feature];
            system::run(&mut lint_command(&target, &[&board[..], &both, &firmware, &chip].concat()))?;
        }
        // The tally is the bench's source with another feature: only that package is linted twice.
        let bench = Target::bench()?;
        for targets in [
            ["--package", "ferrostep-bench", "--lib", "--bin=bench"].as_slice(),
            &["--package", "ferrostep-bench", "--bin=bench", "--features", "tally"],
            &["--package", "ferrostep-bench", "--bin=on-target", "--features", "on-target"],
        ] {
            system::run(&mut lint_command(&bench, targets))?;
        }
        Ok(())
    })
}

/// Memory of the board that an image takes.
pub fn sizes(image: &Path) -> Result<Sizes, Failure> {
    let bytes = std::fs::read(image).map_err(|error| format!("{}: {error}", image.display()))?;
    Sizes::of_elf(&bytes).map_err(|error| format!("{}: {error}", image.display()))
}

/// Returns true if a variable would change how cargo builds: it is removed, so that every shell
/// builds the same image.
fn changes_profile(variable: &str) -> bool {
    variable == "CARGO_INCREMENTAL" || variable.starts_with("CARGO_PROFILE_")
}

/// Cargo in a folder of the workspace, for a board.
fn cargo_in(folder: &str, target: &Target) -> Command {
    let mut command = cargo();
    for (variable, _) in std::env::vars_os() {
        if variable.to_str().is_some_and(changes_profile) {
            command.env_remove(variable);
        }
    }
    command.current_dir(system::root().join(folder));
    command.env("FERROSTEP_BOARD", &target.board_variable);
    match &target.profile_variable {
        Some(profile) => command.env("FERROSTEP_PROFILE", profile),
        None => command.env_remove("FERROSTEP_PROFILE"),
    };
    match target.boot_offset {
        Some(offset) => command.env("FERROSTEP_BOOT_OFFSET", offset.to_string()),
        None => command.env_remove("FERROSTEP_BOOT_OFFSET"),
    };
    command
}

/// Lints of the targets that cargo's arguments name.
fn lint_command(target: &Target, targets: &[&str]) -> Command {
    let mut command = cargo_in("app", target);
    command.args(["clippy", "--locked"]).args(targets);
    command.arg("--target-dir").arg(system::target_directory().join("firmware"));
    core_library::apply(&mut command, FailedCheck::Traps);
    command.args(["--", "-D", "warnings"]);
    command
}

fn build_command(program: Program, target: &Target) -> Result<Command, Failure> {
    let mut command = cargo_in(program.folder(), target);
    command.args(["build", "--locked", "--message-format", "json-render-diagnostics"]);
    // The chip of the board instead of the default's.
    command.args(["--no-default-features", "--features", target.board.chip.feature]);
    command.arg("--target-dir").arg(system::target_directory().join("firmware"));
    match program {
        // Named after its package. The other programs have all methods.
        Program::Firmware => {
            for method in &target.methods {
                command.args(["--features", method]);
            }
            command.args(["--bin", &package_name()?])
        }
        Program::Bench => command.args(["--bin", "bench"]),
        Program::Tally => command.args(["--bin", "bench", "--features", "tally"]),
        Program::OnTarget => command.args(["--bin", "on-target", "--features", "on-target"]),
    };
    core_library::apply(&mut command, program.failed_check());
    command
        .arg("--config")
        .arg(renamed_folders(&format!("target.{}", core_library::TARGET), &core_library::folders()?)?);
    Ok(command)
}

/// Checks that an image names no folder of this computer, in its debug information neither: it
/// would differ from the same image built elsewhere.
///
/// # Errors
/// The image names one.
fn names_no_folder(elf: &Path) -> Result<(), Failure> {
    let bytes = std::fs::read(elf).map_err(|error| format!("{}: {error}", elf.display()))?;
    for (folder, _) in core_library::folders()? {
        let name = folder.as_os_str().as_encoded_bytes();
        if bytes.windows(name.len()).any(|window| window == name) {
            return Err(format!("{} names {}: see core_library::folders", elf.display(), folder.display()));
        }
    }
    Ok(())
}

/// Cargo's key by which the compiler calls folders by these names. `table`: place of cargo's flags
/// for the compiler, `build` or a target's.
///
/// # Errors
/// A folder's name is not text.
pub fn renamed_folders(table: &str, folders: &[(PathBuf, String)]) -> Result<String, Failure> {
    let flags: Result<Vec<toml::Value>, Failure> = folders
        .iter()
        .map(|(folder, name)| {
            let folder =
                folder.to_str().ok_or_else(|| format!("{}: the path is not Unicode text", folder.display()))?;
            Ok(toml::Value::from(format!("--remap-path-prefix={folder}={name}")))
        })
        .collect();
    Ok(format!("{table}.rustflags={}", toml::Value::from(flags?)))
}

/// Name of the firmware's package.
fn package_name() -> Result<String, Failure> {
    let path = system::root().join("app/Cargo.toml");
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let manifest: toml::Table = text.parse().map_err(|error| format!("{}: {error}", path.display()))?;
    let name = manifest.get("package").and_then(|package| package.get("name")).and_then(toml::Value::as_str);
    name.map(str::to_owned).ok_or_else(|| format!("{}: no package.name", path.display()))
}

/// Path of the executable that cargo made of a source file, from cargo's messages (a
/// JSON object a line).
fn executable(messages: &str, source: &Path) -> Option<PathBuf> {
    messages.lines().find_map(|line| {
        let message: serde_json::Value = serde_json::from_str(line).ok()?;
        let made_of = message.get("target")?.get("src_path")?.as_str()?;
        let executable = message.get("executable")?.as_str()?;
        (Path::new(made_of) == source).then(|| PathBuf::from(executable))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn variable<'a>(command: &'a Command, name: &str) -> Option<&'a str> {
        command.get_envs().find(|(key, _)| *key == name)?.1?.to_str()
    }

    #[test]
    fn a_shell_does_not_change_an_image() {
        let changing = ["CARGO_INCREMENTAL", "CARGO_PROFILE_IMAGE_LTO", "CARGO_PROFILE_RELEASE_CODEGEN_UNITS"];
        assert!(changing.into_iter().all(changes_profile));
        assert!(!["CARGO_HOME", "CARGO_TARGET_DIR", "CARGO"].into_iter().any(changes_profile));
    }

    #[test]
    fn an_image_names_no_folder_of_the_computer_that_builds_it() {
        let key = renamed_folders(
            "target.thumbv7em-none-eabihf",
            &[("/home/a \"b\"".into(), "/c".to_owned()), ("/d".into(), "/e".to_owned())],
        )
        .unwrap();
        let parsed: toml::Table = key.parse().unwrap();
        let flags = parsed["target"]["thumbv7em-none-eabihf"]["rustflags"].as_array().unwrap();
        let expected = ["--remap-path-prefix=/home/a \"b\"=/c", "--remap-path-prefix=/d=/e"];
        assert_eq!(flags.iter().filter_map(toml::Value::as_str).collect::<Vec<_>>(), expected);
        let names: Vec<String> = core_library::folders().unwrap().into_iter().map(|(_, name)| name).collect();
        assert_eq!(names[0], "");
        assert!(["/crates", "/rust", "/target"].iter().all(|name| names.contains(&(*name).to_owned())), "{names:?}");
        let file = std::env::temp_dir().join(format!("ferrostep-folders-{}", std::process::id()));
        let checked = |text: String| {
            std::fs::write(&file, text).unwrap();
            names_no_folder(&file)
        };
        let (named, unnamed) = (checked(format!("x{}/y", system::root().display())), checked("printer/y".to_owned()));
        std::fs::remove_file(&file).unwrap();
        assert!(named.unwrap_err().contains("names /"));
        assert_eq!(unnamed, Ok(()));
    }

    #[test]
    fn an_image_is_built_for_the_chip_of_its_board() {
        let target = Target::new("btt-octopus-1.1", Some("cartesian")).unwrap();
        let command = build_command(Program::Bench, &target).unwrap();
        let words: Vec<&str> = command.get_args().map(|word| word.to_str().unwrap()).collect();
        assert!(
            words.windows(3).any(|words| words == ["--no-default-features", "--features", "stm32f446"]),
            "{words:?}"
        );
        assert_eq!(variable(&command, "FERROSTEP_BOARD"), Some("btt-octopus-1.1"));
        assert_eq!(variable(&command, "FERROSTEP_PROFILE"), Some("cartesian"));
        let bench = build_command(Program::Firmware, &Target::bench().unwrap()).unwrap();
        assert_eq!(variable(&bench, "FERROSTEP_PROFILE"), None);
        assert_eq!(variable(&bench, "FERROSTEP_BOOT_OFFSET"), None);
        for (offset, expected) in [(None, None), (Some(0x20200), None), (Some(0), Some("0"))] {
            let target = Target::new("prusa-buddy", None).unwrap().at(offset).unwrap();
            let command = build_command(Program::Firmware, &target).unwrap();
            assert_eq!(variable(&command, "FERROSTEP_BOOT_OFFSET"), expected, "{offset:?}");
        }
        let error = Target::new("prusa-buddy", None).unwrap().at(Some(7)).unwrap_err();
        assert!(error.starts_with("--boot-offset 0x7: expected 0x20200, the board's own, or"), "{error}");
        assert_eq!(["0", "0x20200", "131584"].map(|text| bytes(text).unwrap()), [0, 0x20200, 0x20200]);
        assert!(bytes("-1").is_err() && bytes("0y").is_err());
    }

    #[test]
    fn a_mismatch_is_refused_before_building() {
        let error = |board: &str, profile: Option<&str>| Target::new(board, profile).unwrap_err();
        assert!(error("no-board", None).contains("no built-in board of this name (bench"));
        assert!(error("bench", Some("no-profile")).contains("no built-in profile of this name (cartesian"));
        let text = ferrostep_profiles::builtin_text("cartesian").unwrap().replace("edges = false", "edges = true");
        let path = std::env::temp_dir().join(format!("ferrostep-both-edges-{}.toml", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let refused = error("prusa-buddy", path.to_str());
        let fits = Target::new("bench", path.to_str());
        std::fs::remove_file(&path).unwrap();
        assert!(refused.contains(": driver.both_edges = true: expected false"), "{refused}");
        assert!(fits.is_ok());
    }

    #[test]
    fn the_image_is_the_one_cargo_names() {
        let messages = concat!(
            r#"{"reason":"compiler-artifact","target":{"kind":["lib"],"src_path":"/p/src/main.rs"},"executable":null}"#,
            "\nnot a message\n",
            r#"{"reason":"compiler-artifact","target":{"src_path":"/p/src/bin/b.rs"},"executable":"/t/b"}"#,
            "\n",
            r#"{"reason":"compiler-artifact","target":{"src_path":"/p/src/main.rs"},"executable":"/t/main"}"#,
            "\n{\"reason\":\"build-finished\",\"success\":true}\n",
        );
        assert_eq!(executable(messages, Path::new("/p/src/main.rs")), Some(PathBuf::from("/t/main")));
        assert_eq!(executable(messages, Path::new("/p/src/bin/b.rs")), Some(PathBuf::from("/t/b")));
        assert_eq!(executable(messages, Path::new("/p/src/other.rs")), None);
    }
}
