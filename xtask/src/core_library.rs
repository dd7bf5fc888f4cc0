//! The core library of the boards' processor: installed by rustup, or compiled from the toolchain's own source.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::Failure;
use crate::system;

/// The processor of every supported board: Cortex-M4 with its floating-point unit.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Where the target's core library comes from.
pub enum CoreLibrary {
    /// Installed by rustup.
    Installed,
    /// Compiled with the image, from the toolchain's component `rust-src`: a mirror of rustup's downloads may lack the
    /// target.
    FromSource,
}

/// Finds the core library, or has rustup install it: the target's, else the source.
pub fn find() -> Result<CoreLibrary, Failure> {
    if target_is_installed() {
        eprintln!("    installed");
        return Ok(CoreLibrary::Installed);
    }
    if has_library_source() {
        eprintln!("    compiling it from source");
        return Ok(CoreLibrary::FromSource);
    }
    let rustup = |words: [&str; 3]| system::run(Command::new("rustup").args(words).current_dir(system::root())).err();
    let no_target = rustup(["target", "add", TARGET]);
    if target_is_installed() {
        return Ok(CoreLibrary::Installed);
    }
    let no_source = rustup(["component", "add", "rust-src"]);
    if has_library_source() {
        return Ok(CoreLibrary::FromSource);
    }
    let reason =
        |failure: Option<Failure>| failure.unwrap_or_else(|| "rustup added it to another toolchain".to_owned());
    Err(format!(
        "no core library for {TARGET}: {}; and no source to compile it from: {}. Install one of them by hand",
        reason(no_target),
        reason(no_source),
    ))
}

/// Whether the compiler in use has the target's libraries. The compiler knows, even without rustup.
fn target_is_installed() -> bool {
    rustc_prints(&["target-libdir", "--target", TARGET]).is_some_and(|folder| Path::new(&folder).is_dir())
}

/// Whether the compiler in use has the source of the core library.
fn has_library_source() -> bool {
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

/// What a compiler calls the folders of this computer in what it builds: the root of the sources, cargo's copies of others' sources, those of the
/// core library, and what build scripts have written. Panics and debug information name source files, and an image would otherwise differ with the folder in
/// which, and the person by whom, it is built. The names are short, for each file's is in an image's flash; our own sources are named from their root, where a
/// debugger finds them.
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
    // Last, for the last that fits counts, and this one lies within the root unless cargo has another setting.
    folders.push((system::target_directory(), "/target".to_owned()));
    // The compiler gets paths as they are written, and asks the system for the folder that it runs in.
    let resolved = folders.iter().filter_map(|(folder, name)| {
        let resolved = folder.canonicalize().ok().filter(|resolved| resolved != folder)?;
        Some((resolved, name.clone()))
    });
    let resolved: Vec<_> = resolved.collect();
    Ok([folders, resolved].concat())
}

/// Packages that are optimised for speed on the desk and for size in an image. Not the planner: it would take 4 KB less, and half as long again for
/// each change that an input shaper makes.
const FOR_SIZE: [&str; 5] = ["ferrostep-card", "ferrostep-gcode", "ferrostep-gpre", "ferrostep-printer", "\"*\""];

impl CoreLibrary {
    /// Makes a cargo command build for [`TARGET`] with this library.
    pub fn apply(&self, command: &mut Command) {
        command.args(["--target", TARGET]);
        command.args(["--config", "profile.release.package.ferrostep-planner.opt-level=\"s\""]);
        for package in FOR_SIZE {
            command.arg("--config").arg(format!("profile.release.package.{package}.opt-level=\"z\""));
        }
        if let CoreLibrary::FromSource = self {
            // The smaller of two ways where the library has both, as for writing numbers: another KB.
            command.args([
                "-Zbuild-std=core,compiler_builtins",
                "-Zbuild-std-features=compiler-builtins-mem,optimize_for_size",
            ]);
            // The linked part mostly formats text: optimised for size it takes 2 KB less.
            command.args(["--config", "profile.release.package.core.opt-level=\"s\""]);
            // The arithmetic of f64 is software: at level "z" an input shaper takes half as much again.
            command.args(["--config", "profile.release.package.compiler_builtins.opt-level=\"s\""]);
            // No text of an image shows a value as `Debug` does, but errors that cannot happen would, and with them come tables of Unicode:
            // 4 KB. A panic says its file: lines would make a place of its own of every check, 11 KB.
            command
                .arg("--config")
                .arg(format!("target.{TARGET}.rustflags=[\"-Zfmt-debug=none\", \"-Zlocation-detail=file\"]"));
            // -Zbuild-std wants a nightly compiler or this; the crates themselves use no nightly feature.
            command.env("RUSTC_BOOTSTRAP", "1");
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn words(command: &Command) -> Vec<String> {
        command.get_args().map(|word| word.to_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn only_the_build_from_source_needs_more_than_the_target() {
        let mut installed = Command::new("cargo");
        CoreLibrary::Installed.apply(&mut installed);
        assert!(words(&installed).starts_with(&["--target".to_owned(), TARGET.to_owned()]));
        assert!(!words(&installed).iter().any(|word| word.starts_with("-Z")));
        assert_eq!(installed.get_envs().count(), 0);

        let mut from_source = Command::new("cargo");
        CoreLibrary::FromSource.apply(&mut from_source);
        assert!(words(&from_source).iter().any(|word| word == "-Zbuild-std=core,compiler_builtins"));
        assert!(from_source.get_envs().any(|(key, value)| key == "RUSTC_BOOTSTRAP" && value == Some("1".as_ref())));
    }
}
