//! The check that the firmware's crates build where there is no std: on the board's processor.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::{Failure, Run};
use crate::system::{self, cargo};

/// The processor of every supported board: Cortex-M4 with its floating-point unit.
const TARGET: &str = "thumbv7em-none-eabihf";

/// The crates that the firmware is made of.
const PACKAGES: [&str; 4] = ["ferrostep-gcode", "ferrostep-planner", "ferrostep-hal-shim", "ferrostep-printer"];

/// Where Debian installs its compiler. By path: the name alone would find rustup's.
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";

/// Debian's compiler and the library source that matches it.
const DEBIAN_PACKAGES: [&str; 2] = ["rustc-web", "rust-web-src"];

/// Where the target's core library comes from.
enum CoreLibrary {
    /// Installed by rustup, used as ever.
    Installed,
    /// Compiled on the way, by a compiler that has the matching source.
    FromSource {
        /// That compiler.
        rustc: PathBuf,
    },
}

/// Checks [`PACKAGES`] for [`TARGET`], after installing what is needed.
pub fn check(run: &mut Run) -> Result<(), Failure> {
    let core_library = run.step("core library of thumbv7em-none-eabihf", core_library)?;
    run.step("no_std check", || system::run(&mut check_command(&core_library)))
}

/// Finds the core library, or installs it: by rustup, else from Debian.
fn core_library() -> Result<CoreLibrary, Failure> {
    if target_is_installed() {
        eprintln!("    installed");
        return Ok(CoreLibrary::Installed);
    }
    // Rustup is asked before Debian's source is looked for, as its library is the one that releases are built with.
    let by_rustup = system::run(Command::new("rustup").args(["target", "add", TARGET]));
    if target_is_installed() {
        return Ok(CoreLibrary::Installed);
    }
    let rustup_failure = by_rustup.err().unwrap_or_else(|| "rustup added it to another toolchain".to_owned());
    let rustc = Path::new(DEBIAN_RUSTC);
    if has_library_source(rustc) {
        eprintln!("    compiling it from Debian's source");
        return Ok(CoreLibrary::FromSource { rustc: rustc.into() });
    }
    if !system::can_install_debian_packages() {
        return Err(format!(
            "no core library for {TARGET}: {rustup_failure}; and without root on Debian its packages {} cannot be \
             installed. Install either of them by hand",
            DEBIAN_PACKAGES.join(" and "),
        ));
    }
    system::install_debian_packages(&DEBIAN_PACKAGES)
        .map_err(|failure| format!("no core library for {TARGET}: {rustup_failure}; {failure}"))?;
    if has_library_source(rustc) {
        Ok(CoreLibrary::FromSource { rustc: rustc.into() })
    } else {
        Err(format!("{} are installed, but {DEBIAN_RUSTC} has no library source", DEBIAN_PACKAGES.join(" and "),))
    }
}

/// Whether the compiler in use has the target's libraries. Asks the compiler, so that rustup need not be there.
fn target_is_installed() -> bool {
    let mut rustc = Command::new("rustc");
    rustc.args(["--print", "target-libdir", "--target", TARGET]);
    rustc.current_dir(system::root());
    system::output(&mut rustc).is_some_and(|folder| Path::new(&folder).is_dir())
}

/// Whether the source of the core library lies in this compiler's system root.
fn has_library_source(rustc: &Path) -> bool {
    system::output(Command::new(rustc).args(["--print", "sysroot"]))
        .is_some_and(|sysroot| Path::new(&sysroot).join("lib/rustlib/src/rust/library/core/Cargo.toml").is_file())
}

/// The check itself, in a target folder of its own: another compiler's results would be thrown away each time.
fn check_command(core_library: &CoreLibrary) -> Command {
    let mut command = cargo();
    command.args(["check", "--target", TARGET, "--target-dir"]);
    command.arg(system::target_directory().join("thumb"));
    if let CoreLibrary::FromSource { rustc } = core_library {
        command.args(["-Zbuild-std=core,compiler_builtins", "-Zbuild-std-features=compiler-builtins-mem"]);
        // -Zbuild-std wants a nightly compiler or this; the crates themselves use no nightly feature.
        command.env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1");
    }
    for package in PACKAGES {
        command.args(["--package", package]);
    }
    command
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn words(command: &Command) -> Vec<String> {
        command.get_args().map(|word| word.to_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn every_package_is_checked_for_the_target_either_way() {
        let from_source = CoreLibrary::FromSource { rustc: PathBuf::from(DEBIAN_RUSTC) };
        for core_library in [CoreLibrary::Installed, from_source] {
            let words = words(&check_command(&core_library));
            let target = words.iter().position(|word| word == "--target").unwrap();
            assert_eq!(words[target + 1], TARGET);
            for package in PACKAGES {
                assert!(words.iter().any(|word| word == package), "{package} in {words:?}");
            }
        }
    }

    #[test]
    fn only_the_build_from_source_changes_the_compiler() {
        let installed = check_command(&CoreLibrary::Installed);
        assert!(!words(&installed).iter().any(|word| word.starts_with("-Z")));
        assert_eq!(installed.get_envs().count(), 0);

        let from_source = check_command(&CoreLibrary::FromSource { rustc: PathBuf::from(DEBIAN_RUSTC) });
        assert!(words(&from_source).iter().any(|word| word == "-Zbuild-std=core,compiler_builtins"));
        assert!(from_source.get_envs().any(|(key, value)| key == "RUSTC" && value == Some(DEBIAN_RUSTC.as_ref())));
    }

    #[test]
    fn a_compiler_that_is_not_there_has_no_source() {
        assert!(!has_library_source(Path::new("/nonexistent/rustc")));
    }
}
