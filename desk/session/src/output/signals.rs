//! Signals that ask a process to end: the temporary files go first.

use std::sync::OnceLock;
use std::{fs, io};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

use super::parts;

/// Starts a thread, once, that removes all temporary files when a signal arrives and then lets the
/// signal end the process, so that a shell sees the process ended by that signal.
pub fn watch() -> io::Result<()> {
    static STARTED: OnceLock<Result<(), io::ErrorKind>> = OnceLock::new();
    let outcome = STARTED.get_or_init(|| start().map_err(|error| error.kind()));
    outcome.map_err(io::Error::from)
}

fn start() -> io::Result<()> {
    let ignored = ignored();
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| !is_in(ignored, *signal)))?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        let Some(signal) = signals.forever().next() else { return };
        // Held until the process ends: no temporary file is made or renamed from here on.
        let parts = parts::lock();
        for part in parts.iter() {
            let _ = fs::remove_file(part);
        }
        let _ = emulate_default_handler(signal);
        std::process::exit(128 + signal);
    })?;
    Ok(())
}

/// The signals that this process was started to ignore (`nohup`, a shell's background job), one
/// bit each from signal 1: a handler would stop ignoring them. Read from Linux's /proc;
/// elsewhere empty.
fn ignored() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

fn is_in(set: u64, signal: i32) -> bool {
    u32::try_from(signal - 1).is_ok_and(|bit| set.checked_shr(bit).is_some_and(|set| set & 1 == 1))
}
