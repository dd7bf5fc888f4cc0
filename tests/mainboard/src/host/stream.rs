//! A host that prints a file line by line, by the `ok` protocol.
//!
//! Sources: RepRap's "G-code" page (replies, N and *), and the behaviour of OctoPrint and
//! Pronterface with Marlin.
//!
//! | Covered | |
//! |---|---|
//! | `ok`, alone or followed by text | acknowledges the oldest unacknowledged line |
//! | line numbers, checksums | `N1 G28*18`; numbers begin with `N0 M110 N0` |
//! | `Resend: N`, `rs N` | sending continues from line N, after the `ok` that follows (see [`Options::window`]) |
//! | `busy:` | a sign of life ([`Stream::silent_ns`]) |
//! | `wait` | a problem while lines are unacknowledged: one of them or its `ok` was lost |
//! | `start` | a problem after the first line was sent: the printer was reset, and sending ends |
//! | `Error:`, `!!` | collected, including the error of a resend |
//!
//! Left out: sending after a reset, resends of unnumbered lines, prompts (`//action:`), and more
//! than one line from `ADVANCED_OK`'s counters.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

/// Settings of the host's sending.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Options {
    /// Lines carry numbers and checksums.
    pub numbered: bool,
    /// Maximum number of unacknowledged lines; at least 1. With more than 1 a resend waits until
    /// the printer has been silent for `settle_ns`, because every unacknowledged line asks for
    /// the same resend.
    pub window: usize,
    /// The host waits for the printer's `start` before the first line.
    pub wait_for_start: bool,
    /// The silence after which a resend starts, ns.
    pub settle_ns: u64,
}

impl Default for Options {
    /// Unnumbered, one line at a time, without waiting for `start`; 100 ms.
    fn default() -> Self {
        Self { numbered: false, window: 1, wait_for_start: false, settle_ns: 100_000_000 }
    }
}

/// A line from the printer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Heard {
    /// Arrival of its last byte, ns.
    pub at_ns: u64,
    /// The text, without the line's end.
    pub text: String,
    /// The kind of line.
    pub kind: LineKind,
}

/// The kind of a printer's line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LineKind {
    /// A line is executed.
    Ok,
    /// Send again from this line number on.
    Resend(u64),
    /// The printer is still working.
    Busy,
    /// The printer is idle.
    Wait,
    /// The printer has started.
    Start,
    /// An error.
    Error,
    /// Anything else.
    Text,
}

/// A violation of the protocol, or a lost line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// The instant, ns.
    pub at_ns: u64,
    /// A description.
    pub text: String,
}

/// An unacknowledged line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
enum Sent {
    /// A line of the file, by its index.
    Line(usize),
    /// A line that was sent out of turn.
    Urgent,
}

/// A resend that has not started yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Hold {
    /// The printer's last sign of life, ns.
    heard_ns: u64,
    /// The `ok` after the resend request has arrived.
    acknowledged: bool,
}

/// A host that prints a file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Stream {
    options: Options,
    lines: Vec<String>,
    next: usize,
    acknowledged: usize,
    on_the_way: VecDeque<Sent>,
    urgent: VecDeque<String>,
    hold: Option<Hold>,
    started: bool,
    begun: bool,
    reset: bool,
    partial: Vec<u8>,
    heard: Vec<Heard>,
    problems: Vec<Problem>,
    resends: u64,
    last_sign_ns: u64,
}

impl Stream {
    /// A host for these lines. Comments and empty lines are not sent: a printer acknowledges no
    /// empty line. With numbers, `M110 N0` goes first.
    #[must_use]
    pub fn new<T: AsRef<str>>(lines: impl IntoIterator<Item = T>, options: Options) -> Self {
        let mut stream = Self {
            options: Options { window: options.window.max(1), ..options },
            lines: Vec::new(),
            next: 0,
            acknowledged: 0,
            on_the_way: VecDeque::new(),
            urgent: VecDeque::new(),
            hold: None,
            started: false,
            begun: false,
            reset: false,
            partial: Vec::new(),
            heard: Vec::new(),
            problems: Vec::new(),
            resends: 0,
            last_sign_ns: 0,
        };
        if options.numbered {
            stream.push("M110 N0");
        }
        for line in lines {
            stream.push(line.as_ref());
        }
        stream
    }

    /// Appends a line without its comment; ignores an empty one.
    pub fn push(&mut self, line: &str) {
        if let Some(line) = without_comment(line) {
            self.lines.push(line);
        }
    }

    /// Sends a line next, without a number, even if others are unacknowledged: M108, M112, M410.
    /// The printer acknowledges it like any other.
    pub fn push_urgent(&mut self, line: &str) {
        self.urgent.extend(without_comment(line));
    }

    /// Receives bytes from the printer, in pieces of any size; `at_ns` is their time of arrival.
    pub fn received(&mut self, at_ns: u64, bytes: &[u8]) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' if self.partial.is_empty() => {}
                b'\n' | b'\r' => {
                    let text = String::from_utf8_lossy(&self.partial).into_owned();
                    self.partial.clear();
                    self.line(at_ns, text);
                }
                byte => self.partial.push(*byte),
            }
        }
    }

    fn line(&mut self, at_ns: u64, text: String) {
        let kind = classify(&text);
        self.last_sign_ns = at_ns;
        if let Some(hold) = &mut self.hold {
            hold.heard_ns = at_ns;
        }
        match kind {
            LineKind::Ok => self.ok(at_ns),
            LineKind::Resend(number) => self.resend(at_ns, number),
            LineKind::Start => {
                self.started = true;
                if self.begun {
                    self.reset = true;
                    let lines = self.on_the_way.len();
                    self.problem(
                        at_ns,
                        format!("the printer was reset: it sent \"start\" with {lines} lines unacknowledged"),
                    );
                }
            }
            LineKind::Wait if !self.on_the_way.is_empty() && self.hold.is_none() => {
                let lines = self.on_the_way.len();
                self.problem(
                    at_ns,
                    format!("the printer is idle with {lines} lines unacknowledged: a line or its \"ok\" was lost"),
                );
            }
            LineKind::Wait | LineKind::Busy | LineKind::Error | LineKind::Text => {}
        }
        self.heard.push(Heard { at_ns, text, kind });
    }

    fn ok(&mut self, at_ns: u64) {
        if let Some(hold) = &mut self.hold {
            hold.acknowledged = true;
            return;
        }
        match self.on_the_way.pop_front() {
            Some(Sent::Line(index)) => self.acknowledged = index + 1,
            Some(Sent::Urgent) => {}
            None => self.problem(at_ns, "the printer sent an \"ok\" too many".to_owned()),
        }
    }

    fn resend(&mut self, at_ns: u64, number: u64) {
        self.resends += 1;
        if !self.options.numbered {
            self.problem(
                at_ns,
                format!("the printer asks for line {number} again, but lines are sent without numbers"),
            );
            return;
        }
        match usize::try_from(number) {
            // The printer may ask for the line after the last one sent, if the line that it refused
            // was a duplicate.
            Ok(index) if index <= self.next && index >= self.acknowledged => {
                self.next = index;
                self.acknowledged = index;
                self.on_the_way.clear();
                self.hold = Some(Hold { heard_ns: at_ns, acknowledged: false });
            }
            _ => {
                let (from, to) = (self.acknowledged, self.next);
                self.problem(at_ns, format!("the printer asks for line {number} again, expected {from} to {to}"));
            }
        }
    }

    fn problem(&mut self, at_ns: u64, text: String) {
        self.problems.push(Problem { at_ns, text });
    }

    /// The next line to send now, with its end; `None` until one is due. Call it until
    /// it returns `None`.
    pub fn to_send(&mut self, now_ns: u64) -> Option<Vec<u8>> {
        if self.reset || (self.options.wait_for_start && !self.started) {
            return None;
        }
        if let Some(line) = self.urgent.pop_front() {
            self.on_the_way.push_back(Sent::Urgent);
            return Some(self.sent(now_ns, line));
        }
        if let Some(hold) = self.hold {
            let silent = now_ns.saturating_sub(hold.heard_ns) >= self.options.settle_ns;
            if !(silent || (self.options.window == 1 && hold.acknowledged)) {
                return None;
            }
            self.hold = None;
        }
        if self.on_the_way.len() >= self.options.window {
            return None;
        }
        let text = self.lines.get(self.next)?;
        let line = if self.options.numbered { numbered(self.next, text) } else { text.clone() };
        self.on_the_way.push_back(Sent::Line(self.next));
        self.next += 1;
        Some(self.sent(now_ns, line))
    }

    fn sent(&mut self, now_ns: u64, mut line: String) -> Vec<u8> {
        if self.on_the_way.len() == 1 {
            // Silence counts from the instant at which the printer owes an answer.
            self.last_sign_ns = self.last_sign_ns.max(now_ns);
        }
        self.begun = true;
        line.push('\n');
        line.into_bytes()
    }

    /// True if all lines are sent and acknowledged.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.acknowledged == self.lines.len()
            && self.on_the_way.is_empty()
            && self.urgent.is_empty()
            && self.hold.is_none()
    }

    /// Time since the printer's last sign of life while lines are unacknowledged, ns; otherwise 0.
    #[must_use]
    pub fn silent_ns(&self, now_ns: u64) -> u64 {
        if self.on_the_way.is_empty() { 0 } else { now_ns.saturating_sub(self.last_sign_ns) }
    }

    /// The number of acknowledged lines of the file.
    #[must_use]
    pub fn acknowledged(&self) -> usize {
        self.acknowledged
    }

    /// The number of lines of the file, `M110` included.
    #[must_use]
    pub fn lines(&self) -> usize {
        self.lines.len()
    }

    /// The number of resends that the printer requested.
    #[must_use]
    pub fn resends(&self) -> u64 {
        self.resends
    }

    /// True if the printer was reset after the first line was sent.
    #[must_use]
    pub fn was_reset(&self) -> bool {
        self.reset
    }

    /// All lines that the printer sent.
    #[must_use]
    pub fn heard(&self) -> &[Heard] {
        &self.heard
    }

    /// The errors among the printer's lines.
    pub fn errors(&self) -> impl Iterator<Item = &Heard> {
        self.heard.iter().filter(|heard| heard.kind == LineKind::Error)
    }

    /// The problems so far.
    #[must_use]
    pub fn problems(&self) -> &[Problem] {
        &self.problems
    }
}

/// A line without its comment and blanks; `None` if it is empty then.
fn without_comment(line: &str) -> Option<String> {
    let line = line.split(';').next().unwrap_or_default().trim();
    (!line.is_empty()).then(|| line.to_owned())
}

/// A line with number and checksum: the exclusive or of all bytes before the `*`.
fn numbered(number: usize, text: &str) -> String {
    let line = format!("N{number} {text}");
    let checksum = line.bytes().fold(0, |checksum, byte| checksum ^ byte);
    format!("{line}*{checksum}")
}

fn classify(text: &str) -> LineKind {
    let text = text.trim();
    let number = |rest: &str| rest.trim_start_matches([':', ' ', 'N']).split_whitespace().next()?.parse().ok();
    if text == "ok" || text.starts_with("ok ") {
        return LineKind::Ok;
    }
    if let Some(rest) = text.strip_prefix("Resend").or_else(|| text.strip_prefix("rs "))
        && let Some(number) = number(rest)
    {
        return LineKind::Resend(number);
    }
    if text.strip_prefix("echo:").unwrap_or(text).starts_with("busy:") {
        return LineKind::Busy;
    }
    match text {
        "wait" => LineKind::Wait,
        "start" => LineKind::Start,
        _ if text.starts_with("Error:") || text.starts_with("!!") => LineKind::Error,
        _ => LineKind::Text,
    }
}

#[cfg(test)]
mod tests;
