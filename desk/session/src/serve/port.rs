//! The printer's port: bytes from the host by way of the firmware's own rings, and
//! whole lines back.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeSet, VecDeque};
use std::fmt::Write;
use std::future::poll_fn;
use std::io;
use std::task::Poll;
use std::time::{Duration, Instant};

use ferrostep_gcode::{Emergency, Reply, meatpack};
use ferrostep_printer::Replies;
use ferrostep_usb::{Buffers, Incoming};

use ferrostep_host_line::damage::{DamagedLine, LineFault};

use super::hosts::{HostBytes, Hosts};

/// Bytes that wait to be read, as on a board: a host that does not wait for each `ok` may keep
/// this much in flight.
const RECEIVE_BYTES: usize = 2048;

/// Maximum bytes that are received at once, so that the printer reads them before
/// the next ones come.
const RECEIVED_AT_ONCE: usize = 1024;

/// Interval of the looks whether a host is there.
const LOOK_INTERVAL: Duration = Duration::from_millis(20);

/// Maximum number of unknown commands remembered; a host could send any number.
const MAX_UNKNOWN_COMMANDS: usize = 100;

/// Bytes that a host has not read, above which only replies are sent to it.
const MAX_UNREAD_BYTES: usize = 4096;

/// Received bytes, and the commands that act before they are read.
#[derive(Default)]
struct Ring {
    bytes: VecDeque<u8>,
    emergencies: Vec<Emergency>,
    has_line: bool,
    packing_reports: Vec<meatpack::Settings>,
}

impl Buffers for Ring {
    fn put(&mut self, byte: u8) -> bool {
        let has_room = self.bytes.len() < RECEIVE_BYTES;
        if has_room {
            self.bytes.push_back(byte);
        }
        has_room
    }

    fn take(&mut self) -> Option<u8> {
        None
    }

    fn emergency(&mut self, emergency: Emergency) {
        self.emergencies.push(emergency);
    }

    fn note_line(&mut self) {
        self.has_line = true;
    }

    fn report_packing(&mut self, settings: meatpack::Settings) {
        self.packing_reports.push(settings);
    }
}

/// A summary of the bytes that have come from the host.
#[derive(Default)]
pub struct Received {
    /// True if any bytes have come.
    pub anything: bool,
    /// True if a line has ended.
    pub line: bool,
    /// Commands that act at once.
    pub emergencies: Vec<Emergency>,
}

/// The port.
pub struct HostPort {
    hosts: RefCell<Hosts>,
    damage: RefCell<DamagedLine>,
    incoming: RefCell<Incoming>,
    ring: RefCell<Ring>,
    out: RefCell<String>,
    is_connected: Cell<bool>,
    /// Time of the last look whether a host is there.
    looked: Cell<Instant>,
    /// True while the printer waits for bytes.
    is_awaited: Cell<bool>,
    unknown: RefCell<BTreeSet<String>>,
    lines: Cell<u32>,
}

impl HostPort {
    /// A port of these hosts.
    pub fn new(mut hosts: Hosts) -> Self {
        Self {
            is_connected: Cell::new(hosts.connected()),
            looked: Cell::new(Instant::now()),
            hosts: RefCell::new(hosts),
            damage: RefCell::default(),
            incoming: RefCell::new(Incoming::new()),
            ring: RefCell::default(),
            out: RefCell::default(),
            is_awaited: Cell::new(false),
            unknown: RefCell::default(),
            lines: Cell::new(0),
        }
    }

    /// Damages a share of the bytes, or lines, that the host sends.
    pub fn damage(&self, fault: LineFault, share: f64) {
        self.damage.borrow_mut().add(fault, share);
    }

    /// Sends the waiting lines, and receives the host's bytes.
    ///
    /// # Errors
    /// The line is broken for good.
    pub fn exchange(&self) -> io::Result<Received> {
        let mut hosts = self.hosts.borrow_mut();
        let mut out = self.out.borrow_mut();
        let HostBytes { mut bytes, is_stop } = hosts.read(RECEIVED_AT_ONCE)?;
        if !bytes.is_empty() {
            self.is_connected.set(true);
        } else if self.looked.get().elapsed() >= LOOK_INTERVAL {
            self.looked.set(Instant::now());
            self.is_connected.set(hosts.connected());
        }
        if hosts.take_change() {
            self.incoming.borrow_mut().break_off();
        }
        if self.is_connected.get() && !out.is_empty() {
            hosts.write(out.as_bytes())?;
        }
        // Bytes without a listener are lost, as on a wire.
        out.clear();
        let anything = !bytes.is_empty();
        self.damage.borrow_mut().carry(&mut bytes);
        let ring = &mut *self.ring.borrow_mut();
        let lost = self.incoming.borrow_mut().take_in(&bytes, ring);
        if lost > 0 {
            // Writing to a string cannot fail.
            let _ = writeln!(out, "echo:serial: {lost} bytes lost");
        }
        for report in ring.packing_reports.drain(..) {
            let _ = writeln!(out, "{report}");
        }
        let mut emergencies = std::mem::take(&mut ring.emergencies);
        if is_stop {
            emergencies.push(Emergency::Stop);
        }
        Ok(Received { anything, line: std::mem::take(&mut ring.has_line), emergencies })
    }

    /// Waits for the host, at most this long.
    pub fn wait(&self, timeout: Duration) {
        self.hosts.borrow().wait(timeout);
    }

    /// Waits for bytes, and takes as many as have come and fit.
    pub async fn read<'a>(&self, buffer: &'a mut [u8]) -> &'a [u8] {
        poll_fn(|_| {
            let is_empty = self.ring.borrow().bytes.is_empty();
            self.is_awaited.set(is_empty);
            if is_empty { Poll::Pending } else { Poll::Ready(()) }
        })
        .await;
        let length = self.take(buffer);
        &buffer[..length]
    }

    /// Takes as many bytes as have come and fit, without waiting.
    pub fn take(&self, buffer: &mut [u8]) -> usize {
        let bytes = &mut self.ring.borrow_mut().bytes;
        let length = bytes.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(bytes.drain(..length)) {
            *place = byte;
        }
        length
    }

    /// Sets whether the printer only waits for bytes.
    pub fn set_awaited(&self, is_awaited: bool) {
        self.is_awaited.set(is_awaited);
    }

    /// Returns true if the printer waits for bytes and none have come.
    pub fn is_awaited(&self) -> bool {
        self.is_awaited.get() && self.ring.borrow().bytes.is_empty()
    }

    /// Returns true if a host has the line open.
    pub fn is_connected(&self) -> bool {
        self.is_connected.get()
    }

    /// Another line is executed.
    pub fn count_line(&self) {
        self.lines.set(self.lines.get().saturating_add(1));
    }

    /// Lines executed so far.
    pub fn lines(&self) -> u32 {
        self.lines.get()
    }

    /// The different unknown commands so far, in alphabetical order.
    pub fn unknown_commands(&self) -> Vec<String> {
        self.unknown.borrow().iter().cloned().collect()
    }

    /// Sends a line of text.
    pub fn say(&self, text: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.out.borrow_mut(), "{text}");
    }
}

impl Replies for HostPort {
    fn send(&self, reply: Reply<'_>) {
        if let Reply::UnknownCommand(text) = reply {
            let mut unknown = self.unknown.borrow_mut();
            if unknown.len() < MAX_UNKNOWN_COMMANDS && !unknown.contains(text) {
                unknown.insert(text.to_owned());
            }
        }
        let is_report = matches!(reply, Reply::Temperatures(_) | Reply::Waiting(..) | Reply::Busy);
        if is_report && self.out.borrow().len() + self.hosts.borrow().waiting() > MAX_UNREAD_BYTES {
            return;
        }
        // A reply of several lines and its line end are one write.
        let _ = writeln!(self.out.borrow_mut(), "{reply}");
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::fs::OpenOptions;
    use std::io::Write as _;

    use ferrostep_host_line::Line;

    use super::*;

    /// Longest wait for anything: only a fault takes as long.
    const PATIENCE: Duration = Duration::from_secs(60);

    /// Exchanges bytes with the host until something is so.
    #[track_caller]
    fn exchange_until(port: &HostPort, mut is_so: impl FnMut() -> bool) {
        let end = Instant::now() + PATIENCE;
        while !is_so() {
            assert!(Instant::now() < end, "it does not become so");
            port.exchange().unwrap();
        }
    }

    #[test]
    fn half_a_line_is_not_the_beginning_of_the_next_hosts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("port");
        let port = HostPort::new(Hosts::new(Some(Line::pty(&path).unwrap()), None));
        let host = || OpenOptions::new().read(true).write(true).open(&path).unwrap();
        let mut first = host();
        first.write_all(b"G1 X12").unwrap();
        exchange_until(&port, || port.ring.borrow().bytes.len() == 6);
        drop(first);
        exchange_until(&port, || !port.is_connected());
        let mut next = host();
        next.write_all(b"M114\n").unwrap();
        // One byte separates the two lines.
        exchange_until(&port, || port.ring.borrow().bytes.len() == "G1 X12".len() + 1 + "M114\n".len());
        let mut bytes = [0; 32];
        let length = port.take(&mut bytes);
        let mut lines = ferrostep_usb::Lines::new();
        let (used, half) = lines.feed(&bytes[..length]);
        assert!(half.is_none() && used == 6, "{half:?}");
        let (used, half) = lines.feed(&bytes[6..length]);
        assert!(matches!(half, Some(ferrostep_usb::Heard::HalfALine(_))), "{half:?}");
        let (_, line) = lines.feed(&bytes[6 + used..length]);
        assert!(matches!(line, Some(ferrostep_usb::Heard::Line(Ok(line))) if line.text == "M114"), "{line:?}");
    }
}
