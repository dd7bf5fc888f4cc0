//! Scripted printer for tests of the sent lines.

use std::collections::VecDeque;
use std::io;
use std::time::Instant;

use super::port::Port;

/// Returns a printer's answer to M118 with its `ok`; `None` for any other line.
pub(super) fn echo(line: &str) -> Option<Vec<String>> {
    let text = line.split_once("M118 ")?.1.split('*').next()?;
    Some(vec![text.to_owned(), "ok".to_owned()])
}

/// Printer whose answers are a function of the line and of how often it was sent before; its clock
/// runs only while the host waits.
pub(super) struct Scripted<F> {
    answer: F,
    said: VecDeque<String>,
    pub(super) heard: Vec<String>,
    pub(super) now: Instant,
}

impl<L: Into<String>, F: FnMut(&str, usize) -> Vec<L>> Scripted<F> {
    pub(super) fn new(answer: F) -> Self {
        Self { answer, said: VecDeque::new(), heard: Vec::new(), now: Instant::now() }
    }

    /// Returns the number of lines that the host has not read.
    pub(super) fn unheard(&self) -> usize {
        self.said.len()
    }
}

impl<L: Into<String>, F: FnMut(&str, usize) -> Vec<L>> Port for Scripted<F> {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        // The bytes that switch packing off are not text.
        let text = String::from_utf8_lossy(bytes);
        for line in text.lines().filter(|line| !line.is_empty()) {
            let times = self.heard.iter().filter(|heard| *heard == line).count();
            self.heard.push(line.to_owned());
            self.said.extend((self.answer)(line, times).into_iter().map(Into::into));
        }
        Ok(())
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<String>> {
        let said = self.said.pop_front();
        if said.is_none() {
            self.now = until;
        }
        Ok(said)
    }

    fn now(&mut self) -> Instant {
        self.now
    }
}
