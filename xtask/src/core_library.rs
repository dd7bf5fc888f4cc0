//! The core library of the boards' processor: installed by rustup, or compiled from the
//! toolchain's own source.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::Failure;
use crate::system;

/// The processor of every supported board: Cortex-M4 with its floating-point unit.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Installs the core library's source if it is missing. The library is compiled with every image:
/// with the image's own levels of optimisation and flags it takes a twentieth of the flash less
/// than the library that rustup has for the target.
///
/// # Errors
/// The toolchain lacks the source, and rustup cannot add it.
pub fn require_source() -> Result<(), Failure> {
    if has_source() {
        return Ok(());
    }
    let added = system::run(Command::new("rustup").args(["component", "add", "rust-src"]).current_dir(system::root()));
    if has_source() {
        return Ok(());
    }
    let reason = added.err().unwrap_or_else(|| "rustup added it to another toolchain".to_owned());
    Err(format!("the toolchain lacks the source of the core library (component rust-src): {reason}"))
}

/// Returns true if the compiler in use has the source of the core library.
fn has_source() -> bool {
    rustc_prints(&["sysroot"])
        .is_some_and(|sysroot| Path::new(&sysroot).join("lib/rustlib/src/rust/library/core/Cargo.toml").is_file())
}

fn rustc_prints(what: &[&str]) -> Option<String> {
    system::output(Command::new("rustc").arg("--print").args(what).current_dir(system::root()))
}

/// Name and version of the compiler.
pub fn compiler_version() -> Result<String, Failure> {
    system::output(Command::new("rustc").arg("--version").current_dir(system::root()))
        .ok_or_else(|| "`rustc --version` fails".to_owned())
}

/// Names by which a compiler calls the folders of this computer in what it builds: the root of the
/// sources, cargo's copies of others' sources, those of the core library, and what build scripts
/// have written. Panics and debug information name source files, and an image would otherwise
/// differ with the folder and the person that build it. The names are short, for each file's is in
/// an image's flash; Ferrostep's sources are named from their root, where a debugger finds them.
///
/// # Errors
/// The compiler does not say where it is.
pub fn folders() -> Result<Vec<(PathBuf, String)>, Failure> {
    let sysroot = rustc_prints(&["sysroot"]).ok_or("`rustc --print sysroot` fails")?;
    let mut folders = vec![(system::root(), String::new())];
    let registries = system::cargo_home().and_then(|home| home.join("registry/src").read_dir().ok());
    for registry in registries.into_iter().flatten().flatten() {
        folders.push((registry.path(), "/crates".to_owned()));
    }
    folders.push((Path::new(&sysroot).join("lib/rustlib/src/rust/library"), "/rust".to_owned()));
    // This folder comes last, since the last that fits counts, and it lies within the root unless
    // cargo has another setting.
    folders.push((system::target_directory(), "/target".to_owned()));
    // The compiler gets paths as they are written, and asks the system for the folder
    // that it runs in.
    let resolved = folders.iter().filter_map(|(folder, name)| {
        let resolved = folder.canonicalize().ok().filter(|resolved| resolved != folder)?;
        Some((resolved, name.clone()))
    });
    let resolved: Vec<_> = resolved.collect();
    Ok([folders, resolved].concat())
}

/// Effect of a failed check: an overflow, an index out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailedCheck {
    /// Calls the program's panic handler with a text, for programs that a debugger watches.
    Panics,
    /// Executes an undefined instruction in place, which the core answers with a hard fault. The
    /// address tells the place, and the calls and texts of panics would take 23 KB of an image.
    Traps,
}

/// Profile of Cargo.toml that the images are built with.
pub const PROFILE: &str = "image";

/// Makes a cargo command build for [`TARGET`] with [`PROFILE`], with the core library compiled
/// from its source.
pub fn apply(command: &mut Command, failed_check: FailedCheck) {
    command.args(["--target", TARGET, "--profile", PROFILE]);
    // The library has some code in two forms, as for writing numbers: the smaller one
    // saves another KB.
    command
        .args(["-Zbuild-std=core,compiler_builtins", "-Zbuild-std-features=compiler-builtins-mem,optimize_for_size"]);
    // The linked part mostly formats text: optimised for size it takes 2 KB less.
    command.args(["--config", "profile.image.package.core.opt-level=\"s\""]);
    // The arithmetic of f64 is software: at level "z" an input shaper takes half as much again.
    command.args(["--config", "profile.image.package.compiler_builtins.opt-level=\"s\""]);
    let flags: &[&str] = match failed_check {
        // No text of an image shows a value as `Debug` does, but errors that cannot happen would,
        // and with them come tables of Unicode: 4 KB. A panic reports its file only: with lines,
        // every check would need a separate place.
        FailedCheck::Panics => &["-Zfmt-debug=none", "-Zlocation-detail=file"],
        FailedCheck::Traps => {
            &["-Zfmt-debug=none", "-Zlocation-detail=none", "-Zunstable-options", "-Cpanic=immediate-abort"]
        }
    };
    command.arg("--config").arg(format!("target.{TARGET}.rustflags={flags:?}"));
    // These options need a nightly compiler or this variable; the crates themselves use no
    // nightly feature.
    command.env("RUSTC_BOOTSTRAP", "1");
}
