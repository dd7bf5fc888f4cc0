//! The host of a run with a fault: sends a file, polls temperatures while idle, and
//! reconnects after a reset.

use crate::host::{Heard, LineKind, Options, Stream};
use crate::machine::{HOST_PORT, Machine};

/// Interval of polls while the host is idle, ns.
const POLL_NS: u64 = 500_000_000;
/// Maximum number of bytes that wait for the chip's receiver.
const WAITING_BYTES: usize = 200;

/// A host on the serial line.
#[derive(Debug, Clone)]
pub struct HostSide {
    stream: Stream,
    polled_ns: u64,
    /// Lines received by all streams, before and after resets.
    heard: Vec<Heard>,
    last_heard_ns: u64,
    last_sent_ns: u64,
    seen: usize,
    gone: bool,
    /// The file's lines, numbered as the stream counts them.
    lines: Vec<String>,
}

fn options(wait_for_start: bool) -> Options {
    Options { numbered: true, wait_for_start, ..Options::default() }
}

impl HostSide {
    /// A host that sends these lines after the printer's `start`.
    #[must_use]
    pub fn new<T: AsRef<str>>(lines: impl IntoIterator<Item = T>) -> Self {
        let lines: Vec<String> = lines.into_iter().map(|line| line.as_ref().to_owned()).collect();
        Self {
            stream: Stream::new(&lines, options(true)),
            polled_ns: 0,
            heard: Vec::new(),
            last_heard_ns: 0,
            last_sent_ns: 0,
            seen: 0,
            gone: false,
            // Numbered lines begin with one that sets the number.
            lines: std::iter::once("M110 N0".to_owned()).chain(lines).collect(),
        }
    }

    /// The first line of the file that is not acknowledged.
    #[must_use]
    pub fn line_on_its_way(&self) -> Option<&str> {
        self.lines.get(self.stream.acknowledged()).map(String::as_str)
    }

    /// Falls silent; bytes that the chip has not received yet are lost.
    pub fn vanish(&mut self, machine: &mut Machine) {
        self.gone = true;
        if let Some(mailbox) = machine.mailbox(HOST_PORT) {
            mailbox.cut();
        }
    }

    /// Sends a line before all others.
    pub fn push_urgent(&mut self, line: &str) {
        self.stream.push_urgent(line);
    }

    /// Appends a line.
    pub fn push(&mut self, line: &str) {
        self.stream.push(line);
        self.lines.push(line.to_owned());
    }

    /// Receives and sends.
    pub fn turn(&mut self, machine: &mut Machine, now_ns: u64) {
        let Some(mailbox) = machine.mailbox(HOST_PORT) else { return };
        let bytes: Vec<u8> = mailbox.take().map(|(_, word)| word as u8).collect();
        if !bytes.is_empty() {
            self.last_heard_ns = now_ns;
            self.stream.received(now_ns, &bytes);
            for heard in self.stream.heard().iter().skip(self.seen) {
                self.heard.push(heard.clone());
            }
            self.seen = self.stream.heard().len();
        }
        if self.gone {
            return;
        }
        if self.stream.was_reset() {
            self.stream = Stream::new(["M105"], options(false));
            self.seen = 0;
        }
        if self.stream.finished() && now_ns >= self.polled_ns + POLL_NS {
            self.polled_ns = now_ns;
            self.stream.push("M105");
            self.lines.push("M105".to_owned());
        }
        while mailbox.waiting() < WAITING_BYTES {
            let Some(line) = self.stream.to_send(now_ns) else { break };
            self.last_sent_ns = now_ns;
            line.into_iter().for_each(|byte| mailbox.send(now_ns, u16::from(byte)));
        }
    }

    /// All lines from the printer, those before a reset included.
    #[must_use]
    pub fn heard(&self) -> &[Heard] {
        &self.heard
    }

    /// True if all lines are sent and acknowledged, except polls.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.stream.finished()
    }

    /// The time since the printer's last byte, ns.
    #[must_use]
    pub fn silent_ns(&self, now_ns: u64) -> u64 {
        now_ns.saturating_sub(self.last_heard_ns)
    }

    /// True if the host still sends.
    #[must_use]
    pub fn is_there(&self) -> bool {
        !self.gone
    }

    /// The latest temperatures that the printer reported since this instant.
    #[must_use]
    pub fn temperatures(&self, since_ns: u64) -> Option<Temperatures> {
        self.heard
            .iter()
            .rev()
            .take_while(|heard| heard.at_ns >= since_ns)
            .find_map(|heard| Temperatures::parse(&heard.text))
    }

    /// Errors since this instant, and starts after a reset.
    pub fn alarms(&self, since_ns: u64) -> impl Iterator<Item = &Heard> {
        let from = self.heard.partition_point(|heard| heard.at_ns < since_ns);
        self.heard[from..].iter().filter(|heard| {
            matches!(heard.kind, LineKind::Error | LineKind::Start)
                || heard.text.starts_with("echo:reset")
                || heard.text.starts_with("echo:last ")
                || heard.text.starts_with("echo:heaters switched off")
                || heard.text.contains("no longer homed")
        })
    }

    /// True if the host has read since this instant that a command was not executed as sent.
    #[must_use]
    pub fn read_a_warning(&self, since_ns: u64) -> bool {
        let from = self.heard.partition_point(|heard| heard.at_ns < since_ns);
        self.heard[from..].iter().any(|heard| heard.text.starts_with("echo:line"))
    }

    /// The first `max` lines since this instant, without temperatures and acknowledgements.
    #[must_use]
    pub fn notable_lines(&self, since_ns: u64, max: usize) -> Vec<String> {
        let from = self.heard.partition_point(|heard| heard.at_ns < since_ns);
        let notable = self.heard[from..].iter().filter(|heard| {
            !matches!(heard.kind, LineKind::Ok | LineKind::Busy) && Temperatures::parse(&heard.text).is_none()
        });
        notable.take(max).map(|heard| format!("{:.3} {}", heard.at_ns as f64 / 1e9, heard.text)).collect()
    }
}

/// The temperatures of a printer: RepRap's reply to M105.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Temperatures {
    /// Nozzle, target of the nozzle, bed, target of the bed, degrees Celsius.
    pub celsius: [f64; 4],
}

impl Temperatures {
    /// Parses `T:22.17 /0.00 B:22.21 /0.00 @:0 B@:0`, with or without a leading `ok`.
    #[must_use]
    pub fn parse(line: &str) -> Option<Self> {
        let mut numbers = [None; 4];
        let mut place = None;
        for word in line.split_whitespace() {
            if let Some(rest) = word.strip_prefix("T:") {
                (numbers[0], place) = (rest.parse().ok(), Some(1));
            } else if let Some(rest) = word.strip_prefix("B:") {
                (numbers[2], place) = (rest.parse().ok(), Some(3));
            } else if let (Some(rest), Some(at)) = (word.strip_prefix('/'), place.take()) {
                let at: usize = at;
                numbers[at] = rest.parse().ok();
            }
        }
        let [Some(nozzle), Some(nozzle_target), Some(bed), Some(bed_target)] = numbers else { return None };
        Some(Self { celsius: [nozzle, nozzle_target, bed, bed_target] })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn marlin_s_temperature_reports_are_parsed() {
        let line = "ok T:199.98 /200.00 B:40.05 /41.00 @:77 B@:12";
        assert_eq!(Temperatures::parse(line).unwrap().celsius, [199.98, 200.0, 40.05, 41.0]);
        assert_eq!(Temperatures::parse("ok"), None);
        assert_eq!(Temperatures::parse("T:1.0 B:2.0"), None);
    }
}
