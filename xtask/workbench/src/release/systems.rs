//! The command for other systems: wheels, cross-compiled with Zig as the linker, and archives of
//! what is in them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Failure, copy, files, read, write_file};
use crate::core_library;
use crate::firmware;
use crate::hosts;
use crate::steps::Run;
use crate::system;

/// A system that the command is built for.
#[derive(Clone, Copy, Debug)]
pub struct System {
    /// Rust's name of it.
    pub triple: &'static str,
    /// Standard of the C library that a wheel may need, on Linux.
    standard: Option<&'static str>,
    /// The command's file.
    pub program: &'static str,
}

/// The systems. macOS is missing: the command links Apple's frameworks, which Zig does not bring.
pub const SYSTEMS: [System; 3] = [
    System { triple: "x86_64-unknown-linux-gnu", standard: Some("manylinux2014"), program: "ferrostep" },
    System { triple: "aarch64-unknown-linux-gnu", standard: Some("manylinux2014"), program: "ferrostep" },
    System { triple: "x86_64-pc-windows-gnu", standard: None, program: "ferrostep.exe" },
];

/// Cargo's profile for programs that are given to others.
const PROFILE: &str = "dist";

/// The wheel's folder, and in it the tools that build it.
const SOURCES: &str = "desk/python";
const REQUIREMENTS: &str = "desk/python/requirements.txt";

/// The command's manifest as the wheel's project file names it.
const MANIFEST: &str = "../cli/Cargo.toml";

/// Line of the project file after which the wheel's licence texts are named.
const LICENCE: &str = "license = \"MIT OR Apache-2.0\"\n";

impl System {
    /// The command, once its wheel is built.
    pub fn path(&self) -> PathBuf {
        system::target_directory().join(self.triple).join(PROFILE).join(self.program)
    }
}

/// Builds a wheel for each system into a folder that has the licences and the command's
/// notices already.
///
/// # Errors
/// A tool cannot be installed, or a wheel not be built.
pub fn write_wheels(run: &mut Run, folder: &Path) -> Result<(), Failure> {
    let tools = hosts::environment(run, "wheels: maturin, Zig", "wheel-tools", &[&["--requirement", REQUIREMENTS]])?;
    let sources = run.step("wheels: sources", || stage(folder))?;
    for one in SYSTEMS {
        run.step(one.triple, || {
            system::run(Command::new("rustup").args(["target", "add", one.triple]))?;
            // maturin finds Zig's module by the Python that is first on the path.
            let path = std::env::var_os("PATH").unwrap_or_default();
            let folders = std::iter::once(tools.join("bin")).chain(std::env::split_paths(&path));
            let path = std::env::join_paths(folders).map_err(|error| format!("PATH: {error}"))?;
            let mut build = Command::new(tools.join("bin/maturin"));
            build.current_dir(&sources).env("PATH", path);
            build.args(["build", "--zig", "--profile", PROFILE, "--target", one.triple, "--out"]).arg(folder);
            build.arg("--target-dir").arg(system::target_directory());
            build.arg("--config").arg(firmware::renamed_folders("build", &core_library::folders()?)?);
            if let Some(standard) = one.standard {
                build.args(["--compatibility", standard]);
            }
            system::run(&mut build)
        })?;
    }
    Ok(())
}

/// Copies the wheel's sources to a folder of their own, with the licences and notices
/// that belong into it.
fn stage(release: &Path) -> Result<PathBuf, Failure> {
    let to = system::target_directory().join("wheel-sources");
    let shown = |error: std::io::Error| format!("{}: {error}", to.display());
    if to.exists() {
        fs::remove_dir_all(&to).map_err(shown)?;
    }
    let from = system::root().join(SOURCES);
    for file in files(&from)? {
        let copied = to.join(file.strip_prefix(&from).unwrap_or(&file));
        fs::create_dir_all(copied.parent().unwrap_or(&to)).map_err(shown)?;
        copy(&file, &copied)?;
    }
    let mut texts = Vec::new();
    for text in ["LICENSE-APACHE", "LICENSE-MIT", "NOTICES-cli.md"] {
        copy(&release.join(text), &to.join(text))?;
        texts.push(format!("\"{text}\""));
    }
    let project = to.join("pyproject.toml");
    write_file(&project, &staged(&read(&project)?, &texts.join(", "), &system::root().join("desk/cli/Cargo.toml"))?)?;
    Ok(to)
}

/// The project file for another folder: with the command's manifest by its whole path, and
/// with licence texts.
///
/// # Errors
/// The file lacks one of the lines that change.
fn staged(project: &str, texts: &str, manifest: &Path) -> Result<String, Failure> {
    for part in [MANIFEST, LICENCE] {
        if project.matches(part).count() != 1 {
            return Err(format!("{SOURCES}/pyproject.toml: {:?} is expected in it once", part.trim_end()));
        }
    }
    let manifest = manifest.to_str().ok_or_else(|| format!("{}: the path is not Unicode text", manifest.display()))?;
    let project = project.replace(&format!("\"{MANIFEST}\""), &toml::Value::from(manifest).to_string());
    Ok(project.replace(LICENCE, &format!("{LICENCE}license-files = [{texts}]\n")))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_projects_file_is_one_for_another_folder_too() {
        let project = read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(SOURCES).join("pyproject.toml"));
        let staged = staged(&project.unwrap(), "\"A\", \"B\"", Path::new("/x/Cargo.toml")).unwrap();
        let staged: toml::Table = staged.parse().unwrap();
        assert_eq!(staged["tool"]["maturin"]["manifest-path"].as_str(), Some("/x/Cargo.toml"));
        assert_eq!(staged["project"]["license-files"], toml::Value::from(vec!["A", "B"]));
    }

    #[test]
    fn a_project_file_without_the_manifest_is_an_error() {
        let failure = staged("[project]\n", "", Path::new("/x")).unwrap_err();
        assert!(failure.contains("../cli/Cargo.toml"), "{failure}");
    }
}
