//! The core library of the boards' processor: found, or installed, or compiled on the way.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::Failure;
use crate::system;

/// The processor of every supported board: Cortex-M4 with its floating-point unit.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Where Debian installs its compiler. By path: the name alone would find rustup's.
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";

/// Debian's compiler and the library source that matches it.
const DEBIAN_PACKAGES: [&str; 2] = ["rustc-web", "rust-web-src"];

/// Where the target's core library comes from.
pub enum CoreLibrary {
    /// Installed by rustup, used as ever.
    Installed,
    /// Compiled on the way, by a compiler that has the matching source.
    FromSource {
        /// That compiler.
        rustc: PathBuf,
    },
}

/// Finds the core library, or installs it: by rustup, else from Debian.
pub fn find() -> Result<CoreLibrary, Failure> {
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

impl CoreLibrary {
    /// Makes a cargo command build for [`TARGET`] with this library.
    pub fn apply(&self, command: &mut Command) {
        command.args(["--target", TARGET]);
        if let CoreLibrary::FromSource { rustc } = self {
            command.args(["-Zbuild-std=core,compiler_builtins", "-Zbuild-std-features=compiler-builtins-mem"]);
            // -Zbuild-std wants a nightly compiler or this; the crates themselves use no nightly feature.
            command.env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1");
        }
    }

    /// Name and version of the compiler that builds with this library.
    pub fn compiler_version(&self) -> Result<String, Failure> {
        let mut rustc = match self {
            CoreLibrary::Installed => Command::new("rustc"),
            CoreLibrary::FromSource { rustc } => Command::new(rustc),
        };
        rustc.arg("--version").current_dir(system::root());
        system::output(&mut rustc).ok_or_else(|| "`rustc --version` fails".to_owned())
    }

    /// Makes a cargo command that [`CoreLibrary::apply`] has prepared also link.
    ///
    /// # Errors
    /// Debian's compiler comes without a linker for the target, and rustup's could not be found either.
    pub fn apply_linker(&self, command: &mut Command) -> Result<(), Failure> {
        if let CoreLibrary::FromSource { .. } = self {
            command.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", rust_lld()?);
        }
        Ok(())
    }
}

/// The linker that rustup installs with every toolchain.
fn rust_lld() -> Result<PathBuf, Failure> {
    let mut rustc = Command::new("rustc");
    rustc.args(["--print", "sysroot"]).current_dir(system::root());
    let sysroot = system::output(&mut rustc).ok_or("`rustc --print sysroot` fails")?;
    let targets = Path::new(&sysroot).join("lib/rustlib");
    let folders = std::fs::read_dir(&targets).map_err(|error| format!("{}: {error}", targets.display()))?;
    folders
        .flatten()
        .map(|folder| folder.path().join("bin/rust-lld"))
        .find(|linker| linker.is_file())
        .ok_or_else(|| format!("no rust-lld under {}: install a toolchain with rustup", targets.display()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn words(command: &Command) -> Vec<String> {
        command.get_args().map(|word| word.to_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn only_the_build_from_source_changes_the_compiler() {
        let mut installed = Command::new("cargo");
        CoreLibrary::Installed.apply(&mut installed);
        CoreLibrary::Installed.apply_linker(&mut installed).unwrap();
        assert_eq!(words(&installed), ["--target", TARGET]);
        assert_eq!(installed.get_envs().count(), 0);

        let mut from_source = Command::new("cargo");
        CoreLibrary::FromSource { rustc: PathBuf::from(DEBIAN_RUSTC) }.apply(&mut from_source);
        assert!(words(&from_source).iter().any(|word| word == "-Zbuild-std=core,compiler_builtins"));
        assert!(from_source.get_envs().any(|(key, value)| key == "RUSTC" && value == Some(DEBIAN_RUSTC.as_ref())));
    }

    #[test]
    fn the_toolchain_in_use_has_a_linker() {
        assert!(rust_lld().unwrap().ends_with("bin/rust-lld"));
    }

    #[test]
    fn a_compiler_that_is_not_there_has_no_source() {
        assert!(!has_library_source(Path::new("/nonexistent/rustc")));
    }
}
