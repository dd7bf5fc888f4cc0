//! The served printer's hosts: one outside the program, at a pseudo-terminal or TCP port,
//! and the web page's.
//!
//! One of them owns the line: the page while it prints or waits for an answer, the host outside
//! from its first line until it goes. Only M112 is heard of the other one's bytes.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use ferrostep_gcode::{Emergency, EmergencyScanner};
use ferrostep_host_line::Line;

use super::ownership::Ownership;

/// Reply to each line of an outside host while the page owns the printer. It has no `ok`, so that
/// the host does not continue.
const REFUSED: &str =
    "Error:the web page owns this printer until its print has ended: this line is refused (M112 acts)\n";

/// The hosts of a printer.
pub struct Hosts {
    outside: Option<Line>,
    page: Option<PageLine>,
    is_outside_open: bool,
    /// The bytes that follow belong to another host's line than those before.
    has_changed: bool,
}

/// The page's end of the line.
pub struct PageLine {
    /// The line itself.
    pub line: Line,
    /// Owner of the printer.
    pub ownership: Arc<Ownership>,
    outside_scanner: EmergencyScanner,
    page_scanner: EmergencyScanner,
    /// The beginning of a line of the outside host was refused, and so is its rest.
    is_refusing_line: bool,
}

impl PageLine {
    /// A page at a line.
    pub fn new(line: Line, ownership: Arc<Ownership>) -> Self {
        Self {
            line,
            ownership,
            outside_scanner: EmergencyScanner::new(),
            page_scanner: EmergencyScanner::new(),
            is_refusing_line: false,
        }
    }
}

/// Bytes that the hosts have sent.
#[derive(Default)]
pub struct HostBytes {
    /// The owner's bytes.
    pub bytes: Vec<u8>,
    /// True if a host other than the owner has sent M112.
    pub is_stop: bool,
}

impl Hosts {
    /// Creates the hosts of a printer; either may be missing.
    pub fn new(outside: Option<Line>, page: Option<PageLine>) -> Self {
        let mut hosts = Self { outside, page, is_outside_open: false, has_changed: false };
        hosts.connected();
        hosts
    }

    /// Returns true if any host is connected.
    pub fn connected(&mut self) -> bool {
        if let Some(outside) = &mut self.outside {
            self.is_outside_open = outside.connected();
            if outside.take_departure() {
                self.outside_departs();
            }
        }
        self.is_outside_open || self.page.is_some()
    }

    fn outside_departs(&mut self) {
        self.has_changed = true;
        if let Some(page) = &mut self.page {
            page.is_refusing_line = false;
            page.outside_scanner = EmergencyScanner::new();
            self.has_changed = page.ownership.is_outsides();
            page.ownership.release_outside();
        }
    }

    /// Returns true once after the bytes begin to come from another host.
    pub fn take_change(&mut self) -> bool {
        std::mem::take(&mut self.has_changed)
    }

    /// Reads the owner's bytes, at most this many.
    ///
    /// # Errors
    /// A line is broken for good.
    pub fn read(&mut self, max_bytes: usize) -> io::Result<HostBytes> {
        let mut heard = HostBytes::default();
        if let Some(page) = &mut self.page {
            let bytes = page.line.read(max_bytes)?;
            // The page writes only while it owns the printer, and may have let go since.
            if !page.ownership.is_outsides() {
                heard.bytes = bytes;
            } else {
                heard.is_stop |= has_stop(&mut page.page_scanner, &bytes);
            }
        }
        let Some(outside) = &mut self.outside else { return Ok(heard) };
        let mut bytes = outside.read(max_bytes)?;
        if outside.take_departure() {
            self.outside_departs();
        }
        self.is_outside_open |= !bytes.is_empty();
        let Some(page) = &mut self.page else {
            heard.bytes = bytes;
            return Ok(heard);
        };
        if bytes.is_empty() {
            return Ok(heard);
        }
        if page.is_refusing_line && !page.ownership.is_pages() {
            let rest = bytes.iter().position(|byte| *byte == b'\n').map_or(bytes.len(), |end| end + 1);
            page.is_refusing_line = !bytes.drain(..rest).any(|byte| byte == b'\n');
        }
        if bytes.is_empty() {
            return Ok(heard);
        }
        if page.ownership.take_for_outside() {
            heard.bytes = bytes;
            return Ok(heard);
        }
        heard.is_stop |= has_stop(&mut page.outside_scanner, &bytes);
        page.is_refusing_line = !bytes.ends_with(b"\n");
        let lines = bytes.iter().filter(|byte| **byte == b'\n').count();
        if let Some(outside) = &mut self.outside {
            outside.write(REFUSED.repeat(lines).as_bytes())?;
        }
        Ok(heard)
    }

    /// Sends what the printer says: to the page, and to the host outside unless the page
    /// owns the printer.
    ///
    /// # Errors
    /// A line is broken for good.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut is_pages = false;
        if let Some(page) = &mut self.page {
            is_pages = page.ownership.is_pages();
            page.line.write(bytes)?;
        }
        match &mut self.outside {
            // Bytes without a listener are lost, as on a wire.
            Some(outside) if !is_pages && self.is_outside_open => outside.write(bytes),
            _ => Ok(()),
        }
    }

    /// Number of bytes that the slower host has not taken yet.
    pub fn waiting(&self) -> usize {
        let outside = self.outside.as_ref().map_or(0, Line::waiting);
        self.page.as_ref().map_or(0, |page| page.line.waiting()).max(outside)
    }

    /// Waits for a host, at most this long.
    pub fn wait(&self, timeout: Duration) {
        let lines: Vec<&Line> = self.outside.iter().chain(self.page.as_ref().map(|page| &page.line)).collect();
        Line::wait_any(&lines, timeout);
    }
}

/// Returns true if bytes that are not executed contain an M112.
fn has_stop(scanner: &mut EmergencyScanner, bytes: &[u8]) -> bool {
    bytes.iter().filter_map(|byte| scanner.feed(*byte)).any(|emergency| emergency == Emergency::Stop)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpStream;
    use std::time::Instant;

    use super::*;

    /// Reads until the expected bytes or a stop have come; returns true for a stop.
    fn read(hosts: &mut Hosts, expected: &[u8]) -> bool {
        let end = Instant::now() + Duration::from_secs(60);
        let (mut bytes, mut is_stop) = (Vec::new(), false);
        loop {
            assert!(Instant::now() < end, "{bytes:?}");
            hosts.wait(Duration::from_secs(1));
            let heard = hosts.read(1024).unwrap();
            bytes.extend(heard.bytes);
            is_stop |= heard.is_stop;
            if bytes == expected || is_stop {
                return is_stop;
            }
        }
    }

    /// The page writes only while it owns the printer: later bytes were written
    /// before it let go.
    #[test]
    fn a_line_that_the_page_has_sent_is_read_after_it_has_let_go() {
        let (line, mut page) = Line::pair().unwrap();
        let ownership = Arc::new(Ownership::default());
        let mut hosts = Hosts::new(None, Some(PageLine::new(line, Arc::clone(&ownership))));
        assert!(ownership.take_for_page());
        page.write_all(b"M999\n").unwrap();
        ownership.release_page();
        assert!(!read(&mut hosts, b"M999\n"));
    }

    #[test]
    fn while_the_page_prints_a_host_is_refused_but_for_m112() {
        let outside = Line::tcp(0).unwrap();
        let mut host = TcpStream::connect(outside.address()).unwrap();
        let (line, mut page) = Line::pair().unwrap();
        let ownership = Arc::new(Ownership::default());
        let mut hosts = Hosts::new(Some(outside), Some(PageLine::new(line, Arc::clone(&ownership))));
        assert!(ownership.take_for_page());
        page.write_all(b"G28\n").unwrap();
        assert!(!read(&mut hosts, b"G28\n"));
        host.write_all(b"G1 X5\nM112\nG1 X1").unwrap();
        assert!(read(&mut hosts, b"nothing but the stop"));
        hosts.write(b"ok\n").unwrap();
        let mut said = vec![0; 2 * REFUSED.len()];
        host.read_exact(&mut said).unwrap();
        assert_eq!(String::from_utf8(said).unwrap(), REFUSED.repeat(2));
        let mut said = [0; 3];
        page.read_exact(&mut said).unwrap();
        assert_eq!(&said, b"ok\n");
        // The rest of a refused line is not a line.
        ownership.release_page();
        host.write_all(b"00\nM105\n").unwrap();
        assert!(!read(&mut hosts, b"M105\n"));
        assert!(ownership.is_outsides() && !ownership.take_for_page());
        page.write_all(b"G28\nM112\n").unwrap();
        assert!(read(&mut hosts, b"nothing but the stop"));
        drop(host);
        while ownership.is_outsides() {
            hosts.wait(Duration::from_secs(1));
            hosts.read(1024).unwrap();
        }
        assert!(hosts.take_change() && ownership.take_for_page());
    }
}
