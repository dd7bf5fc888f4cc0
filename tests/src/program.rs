//! The `ferrostep` command as a program.
#![allow(clippy::unwrap_used, reason = "without the program no test can say anything")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The command, built with the profile and into the directory of this test; Cargo rebuilds it if it is stale.
///
/// # Panics
/// It cannot be built.
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
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}
