//! Programs from outside that tests run, and their installation: no person installs one by hand.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::hosts;
use crate::steps::{Failure, Run};
use crate::system;

/// Environment variable that names Chromium's program.
const CHROMIUM_VARIABLE: &str = "FERROSTEP_CHROMIUM";

/// Environment variable that names the folder above Cura's `definitions`.
pub const CURA_VARIABLE: &str = "FERROSTEP_CURA";

/// Folder in which Debian's package `cura` puts the definitions that all printers inherit.
const CURA_RESOURCES: &str = "usr/share/cura/resources";

/// Sign by which a tool is recognised.
#[derive(Clone, Copy, Debug)]
enum Sign {
    /// One of these programs is on the path.
    Program(&'static [&'static str]),
    /// One of these programs is on the path, or a variable names it.
    ProgramOrVariable(&'static [&'static str], &'static str),
    /// A file exists.
    File(&'static str),
    /// Python has a module.
    PythonModule(&'static str),
}

/// A tool, the tests that need it, and where it comes from.
#[derive(Clone, Copy, Debug)]
struct Tool {
    name: &'static str,
    needed_by: &'static str,
    sign: Sign,
    /// Debian's packages.
    packages: &'static [&'static str],
}

/// All tools, apart from Python's packages ([`hosts`]) and Cura's definitions.
const TOOLS: [Tool; 10] = [
    Tool {
        name: "Python 3 with venv",
        needed_by: "hosts, browser",
        sign: Sign::PythonModule("ensurepip"),
        packages: &["python3", "python3-dev", "python3-venv"],
    },
    Tool {
        name: "Chromium",
        needed_by: "browser",
        sign: Sign::ProgramOrVariable(&["chromium", "chromium-browser", "google-chrome"], CHROMIUM_VARIABLE),
        packages: &["chromium"],
    },
    Tool {
        name: "Noto fonts, which the kept pictures show",
        needed_by: "browser",
        sign: Sign::File("/usr/share/fonts/truetype/noto/NotoSans-Regular.ttf"),
        packages: &["fonts-noto-core"],
    },
    Tool {
        name: "PrusaSlicer",
        needed_by: "slicers",
        sign: Sign::Program(&["prusa-slicer"]),
        packages: &["prusa-slicer"],
    },
    Tool { name: "CuraEngine", needed_by: "slicers", sign: Sign::Program(&["CuraEngine"]), packages: &["cura-engine"] },
    Tool { name: "Node.js", needed_by: "scripts", sign: Sign::Program(&["node"]), packages: &["nodejs"] },
    Tool { name: "bash", needed_by: "shells", sign: Sign::Program(&["bash"]), packages: &["bash"] },
    Tool { name: "groff", needed_by: "shells", sign: Sign::Program(&["groff"]), packages: &["groff"] },
    Tool { name: "mtools", needed_by: "mtools", sign: Sign::Program(&["mcopy"]), packages: &["mtools"] },
    Tool {
        name: "dosfstools",
        needed_by: "mtools",
        sign: Sign::Program(&["mkfs.fat", "/usr/sbin/mkfs.fat", "/sbin/mkfs.fat"]),
        packages: &["dosfstools"],
    },
];

/// Folders whose paths the tests get.
#[derive(Clone, Debug)]
pub struct Installed {
    /// Python's environment with the hosts.
    pub hosts: PathBuf,
    /// The folder above Cura's `definitions`.
    pub cura: PathBuf,
}

/// Installs the missing tools and prints their names.
///
/// # Errors
/// Tools are missing that cannot be installed from here: all of them are named, with the
/// way to get each.
pub fn install(run: &mut Run) -> Result<Installed, Failure> {
    run.step("programs to test with", || {
        let missing: Vec<Tool> = TOOLS.into_iter().filter(|tool| !tool.sign.is_there()).collect();
        if missing.is_empty() {
            eprintln!("    nothing to install");
            return Ok(());
        }
        if !may_install() {
            return Err(to_get(&missing));
        }
        let packages: Vec<&str> = missing.iter().flat_map(|tool| tool.packages).copied().collect();
        eprintln!("    installing Debian's packages {}", packages.join(", "));
        system::run(apt_get().arg("update")).map_err(|error| format!("{error}\n{}", to_get(&missing)))?;
        let mut install = apt_get();
        install.args(["--quiet", "--quiet", "install", "--yes", "--no-install-recommends"]);
        system::run(install.args(&packages)).map_err(|error| format!("{error}\n{}", to_get(&missing)))
    })?;
    let cura = run.step("definitions of Cura's printers", definitions)?;
    Ok(Installed { hosts: hosts::install(run)?, cura })
}

impl Sign {
    fn is_there(self) -> bool {
        match self {
            Self::Program(names) => names.iter().any(|name| is_on_path(name)),
            Self::ProgramOrVariable(names, variable) => {
                std::env::var_os(variable).is_some() || names.iter().any(|name| is_on_path(name))
            }
            Self::File(path) => Path::new(path).is_file(),
            Self::PythonModule(module) => {
                system::output(Command::new("python3").arg("-c").arg(format!("import {module}"))).is_some()
            }
        }
    }
}

/// A message that names the tools, the tests that need them, and how to get or leave out each.
fn to_get(missing: &[Tool]) -> Failure {
    let mut text = "these programs are missing, which tests run:".to_owned();
    for tool in missing {
        let _ = write!(text, "\n  {} (Debian: {}): tests {}", tool.name, tool.packages.join(" "), tool.needed_by);
    }
    let packages: Vec<&str> = missing.iter().flat_map(|tool| tool.packages).copied().collect();
    let _ = write!(
        text,
        "\ninstall them: apt-get install {}\n`cargo test` needs none of them, and runs all other tests of the desk",
        packages.join(" ")
    );
    text
}

fn apt_get() -> Command {
    let mut command = Command::new("apt-get");
    command.env("DEBIAN_FRONTEND", "noninteractive");
    command
}

/// True for root on Debian.
fn may_install() -> bool {
    let debian = system::output(Command::new("apt-get").arg("--version")).is_some();
    debian && system::output(Command::new("id").arg("-u")).is_some_and(|user| user == "0")
}

/// A program by name on the path, or by an absolute path.
fn is_on_path(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
}

/// The folder above Cura's definitions: named, installed, or unpacked from its package, whose
/// graphical program is not needed.
fn definitions() -> Result<PathBuf, Failure> {
    let has_definitions = |resources: &PathBuf| resources.join("definitions/fdmprinter.def.json").is_file();
    let named = std::env::var_os(CURA_VARIABLE).map(PathBuf::from);
    let installed = PathBuf::from("/").join(CURA_RESOURCES);
    if let Some(found) = named.into_iter().chain([installed]).find(has_definitions) {
        return Ok(found);
    }
    let folder = system::target_directory().join("slicers");
    let unpacked = folder.join(CURA_RESOURCES);
    if has_definitions(&unpacked) {
        return Ok(unpacked);
    }
    let cure = |error| {
        format!(
            "{error}\ninstall Cura (Debian: apt-get install cura), or name the folder above its definitions in {CURA_VARIABLE}"
        )
    };
    eprintln!("    unpacking Debian's package cura");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    system::run(Command::new("apt-get").current_dir(&folder).args(["download", "cura"])).map_err(cure)?;
    let package = std::fs::read_dir(&folder)
        .map_err(|error| format!("{}: {error}", folder.display()))?
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .find(|path| path.extension().is_some_and(|extension| extension == "deb"))
        .ok_or("apt-get downloaded no package cura")?;
    system::run(Command::new("dpkg-deb").arg("-x").arg(package).arg(&folder)).map_err(cure)?;
    if has_definitions(&unpacked) {
        Ok(unpacked)
    } else {
        Err("the package cura has no fdmprinter.def.json".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_tools_are_named_at_once_with_their_packages() {
        let said = to_get(&TOOLS);
        for tool in TOOLS {
            assert!(tool.packages.iter().all(|package| said.contains(package)), "{said}");
            assert!(said.contains(tool.name) && said.contains(tool.needed_by), "{said}");
        }
        assert!(said.contains("`cargo test` needs none of them"));
    }

    #[test]
    fn a_tool_is_recognised_by_its_sign() {
        assert!(Sign::Program(&["no-such-program", "sh"]).is_there());
        assert!(!Sign::Program(&["no-such-program"]).is_there());
        assert!(!Sign::ProgramOrVariable(&["no-such-program"], "FERROSTEP_NO_SUCH_VARIABLE").is_there());
        assert!(!Sign::File("/no/such/file").is_there());
        assert!(!Sign::PythonModule("no_such_module_anywhere").is_there());
    }
}
