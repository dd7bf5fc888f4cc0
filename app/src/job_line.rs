//! The hosts, each at its port, and the port that receives a prepared job.

use ferrostep_gcode::{Line, LineError, Reply};
use ferrostep_gpre::transfer::{Report, StrayFrames, Stretch};
use ferrostep_printer::{Host, JobLine, Replies};
use ferrostep_usb::{Heard, Lines};
use rtic::Mutex;

use crate::host_line::{Port, Reader, Writers};
use crate::ports::BoardReplies;

/// Size of the buffer for a job's bytes: the longest frame, and as much as a host may send
/// meanwhile.
pub const JOB_BYTES: usize = ferrostep_gpre::compact::MAX_FRAME_BYTES + 1024;

/// A line, or the reason for which it cannot be read, with its host.
type Said<'a> = Option<(&'a mut Host, Result<Line<'a>, LineError>)>;

/// Hosts connected to the board.
pub struct Hosts {
    serial: (Host, Lines),
    usb: (Host, Lines),
    serial_frames: StrayFrames,
    usb_frames: StrayFrames,
    /// Report on the last job.
    last_job: Report,
}

impl Hosts {
    /// Creates hosts that have not sent anything yet.
    pub const fn new() -> Self {
        Self {
            serial: (Host::new(), Lines::new()),
            usb: (Host::new(), Lines::new()),
            serial_frames: StrayFrames::new(),
            usb_frames: StrayFrames::new(),
            last_job: Report::NONE,
        }
    }

    /// Reads up to the end of a port's line. Returns the number of bytes consumed, and the line.
    pub fn feed<'a, W: Mutex<T = Writers>>(
        &'a mut self,
        port: Port,
        bytes: &'a [u8],
        replies: &BoardReplies<W>,
    ) -> (usize, Said<'a>) {
        let (length, stretch) = self.frames(port).next(bytes);
        if let Stretch::Frame { ends } = stretch {
            // This host has not been told yet how its job ended.
            if ends {
                replies.report(&self.last_job);
            }
            return (length, None);
        }
        self.text(port, bytes.get(..length).unwrap_or_default(), replies)
    }

    /// Reads a port's text, outside frames.
    fn text<'a, W: Mutex<T = Writers>>(
        &'a mut self,
        port: Port,
        bytes: &'a [u8],
        replies: &BoardReplies<W>,
    ) -> (usize, Said<'a>) {
        let (host, lines) = match port {
            Port::Serial => &mut self.serial,
            Port::Usb => &mut self.usb,
        };
        let (used, heard) = lines.feed(bytes);
        let said = match (heard, port) {
            (Some(Heard::Line(line)), _) => Some((host, line)),
            // The bytes came too fast; their host is waiting for an answer.
            (Some(Heard::HalfALine(incomplete)), Port::Serial) => Some((host, Err(incomplete))),
            // Usually the host has disconnected.
            (Some(Heard::HalfALine(_)), Port::Usb) => {
                replies.half_a_line();
                None
            }
            (None, _) => None,
        };
        (used, said)
    }

    /// Notes that a port's job has ended, perhaps in the middle of a frame.
    pub fn job_ended(&mut self, port: Port, (report, in_frame): (Report, bool)) {
        self.last_job = report;
        self.frames(port).job_ended(in_frame);
    }

    fn frames(&mut self, port: Port) -> &mut StrayFrames {
        match port {
            Port::Serial => &mut self.serial_frames,
            Port::Usb => &mut self.usb_frames,
        }
    }
}

/// The port that receives a job.
pub struct JobPort<'a, W> {
    reader: &'a mut Reader,
    port: Port,
    last: Port,
    hosts: &'a mut Hosts,
    replies: &'a BoardReplies<W>,
}

impl<'a, W> JobPort<'a, W> {
    /// Creates the view of the port.
    pub fn new(reader: &'a mut Reader, port: Port, hosts: &'a mut Hosts, replies: &'a BoardReplies<W>) -> Self {
        Self { reader, port, last: port, hosts, replies }
    }
}

impl<W: Mutex<T = Writers>> JobLine for JobPort<'_, W> {
    async fn read(&mut self, bytes: &mut [u8], idle: bool) -> (usize, bool) {
        let (port, read) = self.reader.read_in_time(bytes, idle).await;
        self.last = port;
        (read.len(), port == self.port)
    }

    fn text<'a>(&'a mut self, bytes: &'a [u8]) -> (usize, Said<'a>) {
        self.replies.answer(self.last);
        self.hosts.text(self.last, bytes, self.replies)
    }

    fn answer_job(&mut self) {
        self.replies.answer(self.port);
    }
}

impl<W: Mutex<T = Writers>> BoardReplies<W> {
    fn report(&self, report: &Report) {
        let mut line = heapless::String::<48>::new();
        if core::fmt::write(&mut line, format_args!("{report}")).is_ok() {
            self.send(Reply::Text(&line));
        }
    }
}
