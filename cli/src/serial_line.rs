//! A serial port of this computer, as a [`Port`].

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Instant;

use rustix::termios::{OptionalActions, isatty, tcgetattr, tcsetattr};

use crate::send::Port;

/// An open port.
#[derive(Debug)]
pub struct SerialLine {
    port: File,
    lines: Receiver<String>,
}

impl SerialLine {
    /// Opens a port. `baud` has no effect on a USB port.
    ///
    /// # Errors
    /// The port does not exist, may not be opened by this user, or does not support the speed.
    pub fn open(path: &Path, baud: u32) -> io::Result<Self> {
        let port = OpenOptions::new().read(true).write(true).open(path)?;
        if isatty(&port) {
            let mut settings = tcgetattr(&port)?;
            settings.make_raw();
            settings.set_speed(baud)?;
            tcsetattr(&port, OptionalActions::Now, &settings)?;
        }
        let mut input = BufReader::new(port.try_clone()?);
        let (heard, lines) = channel();
        thread::spawn(move || {
            let mut line = Vec::new();
            while input.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
                let text = String::from_utf8_lossy(&line).trim_end_matches(['\r', '\n']).to_owned();
                line.clear();
                if heard.send(text).is_err() {
                    break;
                }
            }
        });
        Ok(Self { port, lines })
    }
}

impl Port for SerialLine {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port.write_all(bytes)
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<String>> {
        match self.lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
            Ok(line) => Ok(Some(line)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(io::Error::from(io::ErrorKind::BrokenPipe)),
        }
    }
}
