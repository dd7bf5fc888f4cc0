//! The log of a program, as a debug probe shows it.
//!
//! The emulator finds the program's RTT buffer and passes the bytes to a TCP port, and the program
//! `ferrostep-mainboard-log`, which lies beside this one, writes them as text to standard error.

use std::fmt::Display;
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};

/// Name of the program that knows the log's format.
const PROGRAM: &str = "ferrostep-mainboard-log";

/// Shows the log from an emulator's RTT port until the emulator closes it; `elf` is
/// the image's file.
///
/// # Errors
/// The port fails, or the log cannot be shown.
pub fn show(rtt: SocketAddr, elf: &Path) -> Result<(), String> {
    let mut log = TcpStream::connect(rtt).map_err(|error| format!("the log lost the emulator: {error}"))?;
    let program = std::env::current_exe().map_err(|error| error.to_string())?.with_file_name(PROGRAM);
    let cannot = |error: &dyn Display| format!("the log cannot be shown: {}: {error}", program.display());
    let mut child = Command::new(&program).arg(elf).stdin(Stdio::piped()).spawn().map_err(|error| cannot(&error))?;
    if let Some(mut input) = child.stdin.take() {
        std::io::copy(&mut log, &mut input).map_err(|error| cannot(&error))?;
    }
    let status = child.wait().map_err(|error| cannot(&error))?;
    if status.success() { Ok(()) } else { Err(cannot(&status)) }
}
