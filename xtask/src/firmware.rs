//! The firmware image: built, and its sizes told.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::core_library::{self, CoreLibrary};
use crate::size::Sizes;
use crate::steps::{Failure, Run};
use crate::system::{self, cargo};

/// The programs that the firmware's folder holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// What prints.
    Firmware,
    /// What counts the instructions of its parts.
    Bench,
    /// The same built to count the step events that those instructions make. It takes the place of the other's image.
    Tally,
}

impl Program {
    /// Its main source file, from the root of the workspace.
    fn source(self) -> &'static str {
        match self {
            Self::Firmware => "app/src/main.rs",
            Self::Bench | Self::Tally => "app/src/bin/bench/main.rs",
        }
    }
}

/// Builds a program as it is shipped, prints its size table and returns the path of its image.
pub fn build(run: &mut Run, program: Program) -> Result<PathBuf, Failure> {
    let core_library = run.step("core library of thumbv7em-none-eabihf", core_library::find)?;
    let name = match program {
        Program::Firmware => "firmware image",
        Program::Bench => "bench image",
        Program::Tally => "tally image",
    };
    run.step(name, || {
        let messages = system::run_for_output(&mut build_command(&core_library, program)?)?;
        executable(&messages, &system::root().join(program.source()))
            .ok_or_else(|| format!("cargo names no image of {}", program.source()))
    })
}

/// Lints of the firmware's own packages, which the desk cannot build.
pub fn check(run: &mut Run) -> Result<(), Failure> {
    let core_library = run.step("core library of thumbv7em-none-eabihf", core_library::find)?;
    run.step("lints of the firmware", || match core_library {
        // The tally is the bench's source over again, so that only that is looked at twice.
        CoreLibrary::Installed => {
            for package in ["ferrostep-stm32f4", "ferrostep-stm32f4-usb"] {
                let library = ["--package", package, "--lib", "--features", "stm32f405"];
                system::run(&mut lint_command(&core_library, &library))?;
            }
            system::run(&mut lint_command(&core_library, &["--bins", "--features", "bench"]))?;
            system::run(&mut lint_command(&core_library, &["--bin", "bench", "--features", "tally"]))
        }
        CoreLibrary::FromSource { .. } => {
            eprintln!("    left out: clippy cannot read what Debian's compiler has made");
            Ok(())
        }
    })
}

/// Prints how much of the board's memory an image takes.
pub fn print_sizes(image: &Path) -> Result<(), Failure> {
    println!("{}\n{}", image.display(), sizes(image)?);
    Ok(())
}

/// How much of the board's memory an image takes.
pub fn sizes(image: &Path) -> Result<Sizes, Failure> {
    let bytes = std::fs::read(image).map_err(|error| format!("{}: {error}", image.display()))?;
    Sizes::of_elf(&bytes).map_err(|error| format!("{}: {error}", image.display()))
}

/// Cargo in the firmware's folder, which has settings of its own for the linker.
fn app_cargo() -> Command {
    let mut command = cargo();
    command.current_dir(system::root().join("app"));
    command
}

/// Lints of the targets that cargo's arguments name.
fn lint_command(core_library: &CoreLibrary, targets: &[&str]) -> Command {
    let mut command = app_cargo();
    command.args(["clippy", "--release", "--locked"]).args(targets);
    command.arg("--target-dir").arg(system::target_directory().join("firmware"));
    core_library.apply(&mut command);
    command.args(["--", "-D", "warnings"]);
    command
}

fn build_command(core_library: &CoreLibrary, program: Program) -> Result<Command, Failure> {
    let mut command = app_cargo();
    command.args(["build", "--release", "--locked", "--message-format", "json-render-diagnostics"]);
    command.arg("--target-dir").arg(system::target_directory().join("firmware"));
    match program {
        // By its package's name, which the package alone decides.
        Program::Firmware => command.args(["--bin", &package_name()?]),
        Program::Bench => command.args(["--bin", "bench", "--features", "bench"]),
        Program::Tally => command.args(["--bin", "bench", "--features", "tally"]),
    };
    core_library.apply(&mut command);
    core_library.apply_linker(&mut command)?;
    Ok(command)
}

/// Name of the firmware's package.
fn package_name() -> Result<String, Failure> {
    let path = system::root().join("app/Cargo.toml");
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let manifest: toml::Table = text.parse().map_err(|error| format!("{}: {error}", path.display()))?;
    let name = manifest.get("package").and_then(|package| package.get("name")).and_then(toml::Value::as_str);
    name.map(str::to_owned).ok_or_else(|| format!("{}: no package.name", path.display()))
}

/// Path of the executable that cargo made of a source file, from cargo's messages (a JSON object a line).
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
