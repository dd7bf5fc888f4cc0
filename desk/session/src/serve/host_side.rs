//! The served printer's host: its lines, also beside a print from the card, and its prepared jobs.

use std::cell::Cell;
use std::future::poll_fn;
use std::task::Poll;

use ferrostep_gcode::{Line, LineError};
use ferrostep_gpre::transfer::{Report, StrayFrames, Stretch};
use ferrostep_hal_shim::Clock;
use ferrostep_printer::{Host, HostLines, HostText, JobLine};
use ferrostep_usb::{Heard, Lines};
use ferrostep_virtual_board::VirtualClock;

use super::port::HostPort;

/// Maximum number of bytes taken from the port at once.
const CHUNK_BYTES: usize = 64;

/// A job's reader waits for bytes this long at most, as on a board, ms.
const WAIT_MS: u64 = 150;

/// A line or why it cannot be read, and its host.
type Said<'a> = Option<(&'a mut Host, Result<Line<'a>, LineError>)>;

/// The host, and the state of its port's text and frames.
pub struct HostSide {
    host: Host,
    lines: Lines,
    frames: StrayFrames,
    /// Result of the last prepared job.
    last_job: Report,
}

impl HostSide {
    /// A host that has sent nothing yet.
    pub fn new() -> Self {
        Self { host: Host::new(), lines: Lines::new(), frames: StrayFrames::new(), last_job: Report::NONE }
    }

    /// Reads up to the end of a line. Returns how many bytes that took, and the line.
    pub fn feed<'a>(&'a mut self, bytes: &'a [u8], port: &HostPort) -> (usize, Said<'a>) {
        let (length, stretch) = self.frames.next(bytes);
        if let Stretch::Frame { ends } = stretch {
            // This host has not heard how its job ended.
            if ends {
                port.say(&self.last_job.to_string());
            }
            return (length, None);
        }
        self.text(&bytes[..length], port)
    }

    /// Reads text, outside frames.
    fn text<'a>(&'a mut self, bytes: &'a [u8], port: &HostPort) -> (usize, Said<'a>) {
        let (used, heard) = self.lines.feed(bytes);
        let said = match heard {
            Some(Heard::Line(line)) => {
                port.count_line();
                Some((&mut self.host, line))
            }
            // Its host is gone, or has sent too fast.
            Some(Heard::HalfALine(_)) => {
                port.say("echo:serial: half a line dropped");
                None
            }
            None => None,
        };
        (used, said)
    }

    /// A job has ended, perhaps in the middle of a frame.
    pub fn job_ended(&mut self, (report, in_frame): (Report, bool)) {
        self.last_job = report;
        self.frames.job_ended(in_frame);
    }
}

/// The host's lines beside a print from the card.
pub struct CardHost<'a> {
    port: &'a HostPort,
    host: &'a mut HostSide,
    chunk: [u8; CHUNK_BYTES],
    at: usize,
    end: usize,
}

impl<'a> CardHost<'a> {
    /// Takes the card's bytes from the host at the port.
    pub fn new(port: &'a HostPort, host: &'a mut HostSide) -> Self {
        Self { port, host, chunk: [0; CHUNK_BYTES], at: 0, end: 0 }
    }
}

impl HostLines for CardHost<'_> {
    fn next(&mut self) -> HostText<'_> {
        if self.at == self.end {
            (self.at, self.end) = (0, self.port.take(&mut self.chunk));
            if self.end == 0 {
                return HostText::Nothing;
            }
        }
        let rest = &self.chunk[self.at..self.end];
        let (used, said) = self.host.feed(rest, self.port);
        self.at += used.clamp(1, rest.len());
        said.map_or(HostText::Part, |(host, line)| HostText::Line(host, line))
    }

    // This port has one host.
    fn tell_all(&mut self) {}

    async fn wait(&mut self, idle: bool) {
        let waited = Cell::new(false);
        let port = self.port;
        poll_fn(|_| {
            let has_waited = waited.replace(true);
            port.set_awaited(idle && !has_waited);
            if has_waited { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

/// The port while a prepared job comes.
pub struct JobHost<'a> {
    port: &'a HostPort,
    host: &'a mut HostSide,
    clock: &'a VirtualClock,
}

impl<'a> JobHost<'a> {
    /// Takes a prepared job from the host at the port.
    pub fn new(port: &'a HostPort, host: &'a mut HostSide, clock: &'a VirtualClock) -> Self {
        Self { port, host, clock }
    }
}

impl JobLine for JobHost<'_> {
    async fn read(&mut self, bytes: &mut [u8], idle: bool) -> (usize, bool) {
        let (port, clock) = (self.port, self.clock);
        let end_ms = clock.now_ms() + WAIT_MS;
        let length = poll_fn(|_| {
            let length = port.take(bytes);
            let is_over = length > 0 || clock.now_ms() >= end_ms;
            port.set_awaited(idle && !is_over);
            if is_over { Poll::Ready(length) } else { Poll::Pending }
        })
        .await;
        (length, true)
    }

    fn text<'a>(&'a mut self, bytes: &'a [u8]) -> (usize, Said<'a>) {
        self.host.text(bytes, self.port)
    }

    // This port has one host.
    fn answer_job(&mut self) {}
}
