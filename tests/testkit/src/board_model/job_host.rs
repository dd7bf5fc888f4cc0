//! A host that sends a prepared job and lines between its frames, in the board's time.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::ops::Range;
use std::task::Poll;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{EmergencyScanner, Line, LineError, LineReader};
use ferrostep_gpre::compact::MAX_FRAME_BYTES;
use ferrostep_gpre::transfer::{Report, Sender};
use ferrostep_printer::{Host, JobLine, JobRequest};
use ferrostep_step_player::Stepping;
use ferrostep_virtual_board::VirtualDelay;

use super::time::{CYCLES_A_MS, CYCLES_PER_S};
use super::{Board, BoardPrinter, LONGEST_COMMAND};

/// A line of 115,200 baud: ten bits a byte.
const CYCLES_A_BYTE: u64 = CYCLES_PER_S / 11_520;

/// Silence of the host, s, after which a waiting board gives it up.
pub const JOB_SILENCE_S: u16 = 30;

/// Time without an answer after which a host asks, cycles.
const ASK_CYCLES: u64 = 250 * CYCLES_A_MS;

/// Time for which the firmware waits for bytes, and the longest portion of it here, ms.
const WAIT_MS: u32 = 150;
const LOOK_MS: u32 = 1;

/// Room for a job's bytes, as in the firmware.
const JOB_BYTES: usize = MAX_FRAME_BYTES + 1024;

/// A host at a serial line.
pub struct JobHost {
    sender: Sender,
    /// Lines to send, and their cycles.
    lines: VecDeque<(u64, String)>,
    /// Times at which it sends no data, only questions.
    pauses: Vec<Range<u64>>,
    /// Times of absence: it neither sends nor hears anything.
    absence: Range<u64>,
    /// The bytes on the line, with the times of their arrival.
    wire: VecDeque<(u64, u8)>,
    last_arrival: u64,
    scanner: EmergencyScanner,
    /// Replies of the board that were heard.
    heard: usize,
    asked: u64,
}

impl JobHost {
    /// A host with a job.
    pub fn new(job: Vec<u8>) -> Self {
        Self {
            sender: Sender::new(job),
            lines: VecDeque::new(),
            pauses: Vec::new(),
            absence: 0..0,
            wire: VecDeque::new(),
            last_arrival: 0,
            scanner: EmergencyScanner::new(),
            heard: 0,
            asked: 0,
        }
    }

    /// Makes the host send a line at a cycle, between two frames. To be called in the order of the
    /// cycles.
    pub fn says(mut self, at: u64, line: &str) -> Self {
        self.lines.push_back((at, format!("{line}\n")));
        self
    }

    /// Makes the host send no data for some time.
    pub fn pauses(mut self, cycles: Range<u64>) -> Self {
        self.pauses.push(cycles);
        self
    }

    /// Makes the host absent for some time, even in the middle of a frame; the board's
    /// lines are lost then.
    pub fn leaves(mut self, cycles: Range<u64>) -> Self {
        self.absence = cycles;
        self
    }

    /// Hears the board's lines up to now, and sends its own.
    fn converse<M: Stepping>(&mut self, board: &Board<'_, M>) {
        let now = board.now();
        if self.absence.contains(&now) {
            self.heard = board.replies.0.borrow().len();
            return;
        }
        for reply in board.replies.0.borrow().iter().skip(self.heard) {
            self.heard += 1;
            self.sender.hear(reply);
        }
        while let Some((_, line)) = self.lines.pop_front_if(|(at, _)| *at <= now) {
            self.put(board, line.as_bytes());
        }
        if !self.pauses.iter().any(|pause| pause.contains(&now)) {
            while let Some(frame) = self.sender.next_frame() {
                self.put(board, &frame);
                self.asked = now;
            }
        }
        if now - self.asked >= ASK_CYCLES {
            self.put(board, &self.sender.question());
            self.asked = now;
        }
    }

    /// Puts bytes onto the line. Emergency commands act as their bytes arrive,
    /// whatever the board does.
    fn put<M: Stepping>(&mut self, board: &Board<'_, M>, bytes: &[u8]) {
        for &byte in bytes {
            self.last_arrival = self.last_arrival.max(board.now()) + CYCLES_A_BYTE;
            if self.absence.contains(&self.last_arrival) {
                continue;
            }
            self.wire.push_back((self.last_arrival, byte));
            if let Some(emergency) = self.scanner.feed(byte) {
                board.act_at(self.last_arrival, emergency);
            }
        }
    }

    /// Reads what has arrived.
    fn read<M: Stepping>(&mut self, board: &Board<'_, M>, bytes: &mut [u8]) -> usize {
        self.converse(board);
        let mut length = 0;
        for place in bytes {
            let Some((_, byte)) = self.wire.pop_front_if(|(at, _)| *at <= board.now()) else { break };
            *place = byte;
            length += 1;
        }
        length
    }
}

/// The board's end.
struct JobPort<'b, 'a, M> {
    board: &'b Board<'a, M>,
    sender: &'b mut JobHost,
    host: Host,
    reader: LineReader,
}

impl<M: Stepping> JobLine for JobPort<'_, '_, M> {
    async fn read(&mut self, bytes: &mut [u8], idle: bool) -> (usize, bool) {
        let (board, sender) = (self.board, &mut *self.sender);
        if !idle {
            let read = poll_fn(|_| match sender.read(board, bytes) {
                0 => Poll::Pending,
                length => Poll::Ready(length),
            });
            return (read.await, true);
        }
        let mut length = sender.read(board, bytes);
        board.awaits_since.set((length == 0).then(|| board.now()));
        for _ in 0..WAIT_MS / LOOK_MS {
            if length > 0 {
                break;
            }
            VirtualDelay(&board.clock).delay_ms(LOOK_MS).await;
            length = sender.read(board, bytes);
        }
        board.awaits_since.set(None);
        (length, true)
    }

    fn text<'a>(&'a mut self, bytes: &'a [u8]) -> (usize, Option<(&'a mut Host, Result<Line<'a>, LineError>)>) {
        let (used, line) = self.reader.feed(bytes);
        (used, line.map(|line| (&mut self.host, line)))
    }

    fn answer_job(&mut self) {}
}

impl<'a, M: Stepping> Board<'a, M> {
    /// Receives a host's job and executes it as it comes.
    pub fn receive_job(&self, printer: &mut BoardPrinter<'_, 'a, M>, sender: &mut JobHost) -> Report {
        let report = self.receive_job_by(printer, sender, self.now() + LONGEST_COMMAND);
        report.unwrap_or_else(|| panic!("a job without an end"))
    }

    /// Receives a host's job and executes it as it comes; `None` if it has not ended by a cycle.
    pub fn receive_job_by(
        &self,
        printer: &mut BoardPrinter<'_, 'a, M>,
        sender: &mut JobHost,
        cycle: u64,
    ) -> Option<Report> {
        let size = u32::try_from(sender.sender.size()).unwrap_or(u32::MAX);
        // M790 has had its `ok`.
        sender.asked = self.now();
        let request = JobRequest { size, silence_s: JOB_SILENCE_S };
        let mut line = JobPort { board: self, sender, host: Host::new(), reader: LineReader::new() };
        let mut room = vec![0; JOB_BYTES];
        let ended = self.poll_by(printer.receive_job(request, &mut line, &mut room), cycle);
        ended.map(|(report, _)| report)
    }
}
