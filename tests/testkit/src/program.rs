//! The `ferrostep` command as a program.
#![allow(clippy::unwrap_used, reason = "without the program no test can say anything")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use tempfile::TempDir;

/// The command, built with the profile and into the directory of this test; Cargo rebuilds
/// it if it is stale.
///
/// # Panics
/// The command cannot be built.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let this = std::env::current_exe().unwrap();
        let profile_directory = this.parent().and_then(Path::parent).unwrap();
        let profile = if profile_directory.ends_with("release") { "release" } else { "test" };
        let built = Command::new(env!("CARGO"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(["build", "--quiet", "--package", "ferrostep", "--profile", profile, "--target-dir"])
            .arg(profile_directory.parent().unwrap())
            .output()
            .unwrap();
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        profile_directory.join(format!("ferrostep{}", std::env::consts::EXE_SUFFIX))
    })
}

/// The repository's root.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap().to_path_buf()
}

/// An empty folder below that of the builds, which goes away with its owner.
///
/// # Panics
/// The folder cannot be made.
pub fn scratch() -> TempDir {
    let folder = std::env::current_exe().unwrap().ancestors().nth(3).unwrap().join("tmp");
    std::fs::create_dir_all(&folder).unwrap();
    tempfile::tempdir_in(folder).unwrap()
}

/// Sends a signal, by its name without `SIG`, to a process. The shell does it, because a program
/// `kill` does not exist everywhere.
///
/// # Panics
/// The process does not exist.
#[track_caller]
pub fn send_signal(name: &str, process: u32) {
    let sent = Command::new("sh").args(["-c", "kill -s \"$0\" \"$1\"", name, &process.to_string()]).status().unwrap();
    assert!(sent.success(), "SIG{name} to {process}");
}
