//! A served printer, and a host at its port.
#![allow(clippy::unwrap_used, reason = "without the printer no test can say anything")]

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde_json::Value;
use tempfile::TempDir;

use super::page::Page;
use crate::host_side::numbered;
use crate::program::{program, repository, scratch, send_signal};

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(60);

/// `ferrostep serve`.
#[derive(Debug)]
pub struct Printer {
    process: Child,
    /// Standard error, its first line read.
    messages: BufReader<std::process::ChildStderr>,
    _folder: TempDir,
    port: PathBuf,
    first_line: String,
}

impl Printer {
    /// Switches a printer on at a pseudo-terminal.
    ///
    /// # Panics
    /// The printer does not start.
    pub fn at_pty(arguments: &[&str]) -> Self {
        let folder = scratch();
        let port = folder.path().join("port");
        let line = ["--pty", port.to_str().unwrap()].map(str::to_owned);
        Self::start(folder, port, &line, arguments)
    }

    /// Switches a printer on at a free TCP port.
    ///
    /// # Panics
    /// The printer does not start.
    pub fn at_tcp(arguments: &[&str]) -> Self {
        let folder = scratch();
        Self::start(folder, PathBuf::new(), &["--tcp", "0"].map(str::to_owned), arguments)
    }

    /// Switches a printer on whose only host is the page.
    ///
    /// # Panics
    /// The printer does not start.
    pub fn at_page(arguments: &[&str]) -> Self {
        let folder = scratch();
        Self::start(folder, PathBuf::new(), &["--web", "127.0.0.1:0"].map(str::to_owned), arguments)
    }

    /// Switches a printer on whose only host is the page, with this folder for temporary files.
    ///
    /// # Panics
    /// The printer does not start.
    pub fn with_temporary_folder(temporary: &Path, arguments: &[&str]) -> Self {
        let line = ["serve", "--web", "127.0.0.1:0", "--json"];
        let mut serve = Command::new(program());
        Self::run(scratch(), PathBuf::new(), serve.args(line).args(arguments).env("TMPDIR", temporary))
    }

    /// A page in front of a printer's port.
    ///
    /// # Panics
    /// The page does not start.
    pub fn before_port(port: &Path) -> Self {
        let arguments = ["serve", "--web", "127.0.0.1:0", "--port", port.to_str().unwrap()];
        let folder = scratch();
        Self::run(folder, PathBuf::new(), Command::new(program()).args(arguments))
    }

    /// Ends a page in front of a port by Ctrl-C; returns its last messages.
    ///
    /// # Panics
    /// The command's exit status is not 0.
    pub fn end_front(mut self) -> String {
        self.interrupt();
        let mut messages = String::new();
        self.messages.read_to_string(&mut messages).unwrap();
        assert_eq!(self.process.wait().unwrap().code(), Some(0), "{messages}");
        messages
    }

    fn interrupt(&self) {
        send_signal("INT", self.process.id());
    }

    /// The page of a printer that is served with `--web`, from the printer's next message, which
    /// comes at its start.
    ///
    /// # Panics
    /// The message is not a page's address.
    pub fn page(&mut self) -> Page {
        let mut said = String::new();
        self.messages.read_line(&mut said).unwrap();
        let page = Page::at(said.trim().strip_prefix("page: ").unwrap_or_else(|| panic!("{said}")));
        page.wait_until_connected();
        page
    }

    fn start(folder: TempDir, port: PathBuf, line: &[String], arguments: &[&str]) -> Self {
        Self::run(folder, port, Command::new(program()).arg("serve").args(line).arg("--json").args(arguments))
    }

    fn run(folder: TempDir, port: PathBuf, command: &mut Command) -> Self {
        let mut process =
            command.current_dir(repository()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut messages = BufReader::new(process.stderr.take().unwrap());
        // The line is there before this is said.
        let mut first_line = String::new();
        messages.read_line(&mut first_line).unwrap();
        Self { process, messages, _folder: folder, port, first_line }
    }

    /// The path of its pseudo-terminal.
    pub fn port(&self) -> &Path {
        &self.port
    }

    /// TCP address of the printer.
    ///
    /// # Panics
    /// The printer has no TCP port.
    pub fn address(&self) -> &str {
        self.first_line.split(" on ").nth(1).unwrap().split(',').next().unwrap()
    }

    /// Connects a host to the printer's port.
    ///
    /// # Panics
    /// The port cannot be opened.
    pub fn connect(&self) -> Host {
        if !self.port.as_os_str().is_empty() {
            return Host::new(std::fs::OpenOptions::new().read(true).write(true).open(&self.port).unwrap());
        }
        Host::new(File::from(OwnedFd::from(TcpStream::connect(self.address()).unwrap())))
    }

    /// Ends the printer by Ctrl-C; returns its report.
    ///
    /// # Panics
    /// The command's exit status is not 0.
    pub fn end(mut self) -> Value {
        self.interrupt();
        let mut out = String::new();
        self.process.stdout.take().unwrap().read_to_string(&mut out).unwrap();
        let mut messages = String::new();
        self.messages.read_to_string(&mut messages).unwrap();
        assert_eq!(self.process.wait().unwrap().code(), Some(0), "{messages}");
        assert!(!self.port.exists(), "the port is removed");
        serde_json::from_str(&out).unwrap()
    }
}

impl Drop for Printer {
    /// Ends the printer, also after a test that failed.
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A host that waits for each `ok`.
#[derive(Debug)]
pub struct Host {
    port: File,
    /// Bytes after the last whole line.
    heard: Vec<u8>,
    number: u32,
}

impl Host {
    fn new(port: File) -> Self {
        Self { port, heard: Vec::new(), number: 0 }
    }

    /// Sends bytes.
    ///
    /// # Panics
    /// The printer is gone.
    pub fn send(&mut self, text: &str) {
        self.port.write_all(text.as_bytes()).unwrap();
    }

    /// The next line; `None` if none comes in time.
    fn next_line(&mut self, end: Instant) -> Option<String> {
        loop {
            if let Some(length) = self.heard.iter().position(|byte| *byte == b'\n') {
                let line = self.heard.drain(..=length).take(length).collect();
                return Some(String::from_utf8(line).unwrap());
            }
            let left = Timespec::try_from(end.saturating_duration_since(Instant::now())).unwrap();
            if poll(&mut [PollFd::new(&self.port, PollFlags::IN)], Some(&left)).unwrap() == 0 {
                return None;
            }
            let mut bytes = [0; 4096];
            let length = self.port.read(&mut bytes).unwrap();
            assert!(length > 0, "the printer is gone");
            self.heard.extend_from_slice(&bytes[..length]);
        }
    }

    /// Hears lines up to one that is `expected`; returns all of them.
    ///
    /// # Panics
    /// The line does not come in time.
    #[track_caller]
    pub fn hear_until(&mut self, expected: impl Fn(&str) -> bool) -> Vec<String> {
        let end = Instant::now() + PATIENCE;
        let mut heard = Vec::new();
        loop {
            let Some(line) = self.next_line(end) else { panic!("silence after {heard:#?}") };
            let is_last = expected(&line);
            heard.push(line);
            if is_last {
                return heard;
            }
        }
    }

    /// Sends a line and hears its answer, up to `ok`.
    ///
    /// # Panics
    /// The answer does not come in time.
    #[track_caller]
    pub fn say(&mut self, line: &str) -> Vec<String> {
        self.send(&format!("{line}\n"));
        self.hear_until(|line| line.starts_with("ok"))
    }

    /// Sends a line with number and checksum, and hears its answer.
    ///
    /// # Panics
    /// The answer does not come in time.
    #[track_caller]
    pub fn say_numbered(&mut self, text: &str) -> Vec<String> {
        let line = numbered(self.number, text);
        self.number += 1;
        self.say(&line)
    }

    /// Value that M797 reports for a name.
    ///
    /// # Panics
    /// The name is missing in the report.
    #[track_caller]
    pub fn figure(&mut self, name: &str) -> String {
        let said = self.say("M797").join(" ");
        let value = said.split_once(&format!("{name}:")).unwrap_or_else(|| panic!("no {name} in {said}")).1;
        value.split(' ').next().unwrap().to_owned()
    }
}
