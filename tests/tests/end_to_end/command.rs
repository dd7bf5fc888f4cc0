//! Runs the `ferrostep` command as a person would.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};

pub use ferrostep_testkit::program::{program, repository};
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
