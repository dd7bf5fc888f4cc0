//! Runs the `ferrostep` command as a person would.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;

use serde_json::Value;
use tempfile::TempDir;

/// The result of one run.
#[derive(Debug)]
pub struct Outcome {
    /// Exit status; `None` after a signal.
    pub status: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Outcome {
    /// Standard output as one JSON value; anything beside it fails the test.
    #[track_caller]
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error} in {self:#?}"))
    }
}

/// The command, built with the profile and into the directory of this test. Cargo finds out whether it is stale.
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

/// Runs the command from the repository's root.
#[track_caller]
pub fn ferrostep<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Outcome {
    Command::new(program()).current_dir(repository()).args(arguments).output().unwrap().into()
}

/// Starts the command and does not wait for its end.
#[cfg(unix)]
pub fn start<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Child {
    start_with(arguments, Stdio::null(), Stdio::piped())
}

/// The same, with other ends of its standard input and output.
#[cfg(unix)]
pub fn start_with<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>, input: Stdio, output: Stdio) -> Child {
    let mut command = Command::new(program());
    command.current_dir(repository()).args(arguments).stdin(input);
    command.stdout(output).stderr(Stdio::piped()).spawn().unwrap()
}

impl From<Output> for Outcome {
    fn from(output: Output) -> Self {
        Self {
            status: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

/// The repository's root.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// An empty directory that goes away with the test.
pub fn directory() -> TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

/// Writes a file into a directory and names it.
pub fn file(directory: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = directory.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Bytes packed by gzip.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut encoder, bytes).unwrap();
    encoder.finish().unwrap()
}

/// The text of one of the repository's examples.
pub fn example(name: &str) -> Vec<u8> {
    let bytes = std::fs::read(repository().join("examples").join(name)).unwrap();
    ferrostep_oracle::gcode_text(&bytes).unwrap()
}
