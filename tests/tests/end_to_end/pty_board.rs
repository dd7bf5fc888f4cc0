//! A virtual board on a pseudo-terminal, which answers as the firmware does at a port.

use std::cell::RefCell;
use std::fs::OpenOptions;
use std::future::poll_fn;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex};
use std::task::Poll;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::meatpack::Unpacker;
use ferrostep_gcode::{Line, LineError, LineReader, Reply};
use ferrostep_gpre::compact::MAX_FRAME_BYTES;
use ferrostep_gpre::transfer::{FLAG, Report};
use ferrostep_printer::{Host, JobLine, Profile, Replies};
use ferrostep_session::Session;
use ferrostep_session::desk::{Figures, LOOK_AHEAD_BLOCKS};
use ferrostep_virtual_board::{VirtualClock, VirtualDelay};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Time for which the firmware waits for bytes while a job is received, ms.
const LOOK_MS: u32 = 150;

/// Room for a job's bytes, as in the firmware.
const JOB_BYTES: usize = MAX_FRAME_BYTES + 1024;

/// A pseudo-terminal: one end is a port that a program opens by its path, the other is held here.
pub struct Pty {
    master: OwnedFd,
    /// The other end, kept open so that the line does not hang up when a host goes.
    _port: std::fs::File,
    path: PathBuf,
}

impl Pty {
    /// Opens a new one, which passes bytes unchanged.
    pub fn new() -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = PathBuf::from(ptsname(&master, Vec::new()).unwrap().into_string().unwrap());
        let port = OpenOptions::new().read(true).write(true).open(&path).unwrap();
        let mut settings = tcgetattr(&port).unwrap();
        settings.make_raw();
        tcsetattr(&port, OptionalActions::Now, &settings).unwrap();
        Self { master, _port: port, path }
    }

    /// The end that is held here; the other one is open no longer than its programs.
    pub fn into_master(self) -> OwnedFd {
        self.master
    }

    /// The path that a host opens.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The settings of a board.
pub struct Settings {
    /// The machine.
    pub profile: Profile,
    /// True if the board unpacks what its host packs.
    pub unpacks: bool,
    /// True if the board takes prepared jobs.
    pub takes_jobs: bool,
    /// Lines that it has executed before a host comes.
    pub before: &'static [&'static str],
}

impl Settings {
    /// A board that has just been switched on and waits as long as a real one.
    pub fn new(profile: Profile) -> Self {
        Self { profile, unpacks: true, takes_jobs: true, before: &[] }
    }
}

/// State shared by the board's thread and the test.
#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// Bytes that the board has read.
    taken: u64,
    /// Maximum number of bytes that the board reads.
    most: Option<u64>,
    /// All its lines.
    said: Vec<String>,
    /// True if time passes for the board while it waits for bytes, without passing here.
    hurries: bool,
    ended: bool,
}

/// The record of a board.
pub struct Served {
    /// Counts of its motors.
    pub figures: Figures,
    /// Bytes that it has read.
    pub taken: u64,
    /// Number of transfers that began.
    pub jobs: u32,
    /// All lines that it has sent.
    pub said: Vec<String>,
}

/// A board that waits for a host.
pub struct PtyBoard {
    path: PathBuf,
    shared: Arc<Shared>,
    thread: JoinHandle<Served>,
}

impl PtyBoard {
    /// Switches it on.
    pub fn start(settings: Settings) -> Self {
        let pty = Pty::new();
        let path = pty.path.clone();
        let shared = Arc::<Shared>::default();
        let of_board = Arc::clone(&shared);
        Self { path, shared, thread: thread::spawn(move || serve(&pty, &settings, &of_board)) }
    }

    /// The path that a host opens.
    pub fn port(&self) -> &str {
        self.path.to_str().unwrap()
    }

    /// Makes the board stop once it has read `bytes` bytes in all.
    pub fn hold_after(&self, bytes: u64) {
        self.shared.state.lock().unwrap().most = Some(bytes);
    }

    /// Waits until the board is held.
    pub fn wait_until_held(&self) {
        self.wait_for(|state| state.most.is_some_and(|most| state.taken >= most));
    }

    /// Lets the board continue.
    pub fn release(&self) {
        self.shared.state.lock().unwrap().most = None;
        self.shared.changed.notify_all();
    }

    /// Sets whether its seconds are short while it waits for bytes.
    pub fn set_hurries(&self, hurries: bool) {
        self.shared.state.lock().unwrap().hurries = hurries;
    }

    /// Waits until it has sent a line with this beginning.
    pub fn wait_until_said(&self, start: &str) {
        self.wait_for(|state| state.said.iter().any(|line| line.starts_with(start)));
    }

    fn wait_for(&self, is_there: impl Fn(&State) -> bool) {
        let state = self.shared.state.lock().unwrap();
        let patience = Duration::from_secs(60);
        let (state, waited) =
            self.shared.changed.wait_timeout_while(state, patience, |state| !is_there(state)).unwrap();
        assert!(!waited.timed_out(), "the board has read {} bytes and said {:?}", state.taken, state.said);
    }

    /// Switches it off when it has read all that its hosts have sent.
    pub fn end(self) -> Served {
        let mut state = self.shared.state.lock().unwrap();
        (state.ended, state.most) = (true, None);
        drop(state);
        self.shared.changed.notify_all();
        self.thread.join().unwrap()
    }
}

/// The board's end of the line.
struct Port<'a> {
    pty: &'a Pty,
    shared: &'a Shared,
    unpacker: Option<RefCell<Unpacker>>,
}

impl Port<'_> {
    fn has_ended(&self) -> bool {
        self.shared.state.lock().unwrap().ended
    }

    /// Duration of a wait for bytes while the board has nothing else to do.
    fn wait(&self) -> Duration {
        let state = self.shared.state.lock().unwrap();
        if state.hurries || state.ended { Duration::from_millis(1) } else { Duration::from_millis(LOOK_MS.into()) }
    }

    /// Reads the bytes that come within a time.
    fn read(&self, bytes: &mut [u8], within: Duration) -> usize {
        let state = self.shared.state.lock().unwrap();
        let held = |state: &mut State| state.most.is_some_and(|most| state.taken >= most);
        let state = self.shared.changed.wait_while(state, held).unwrap();
        let left = state.most.map_or(usize::MAX, |most| (most - state.taken) as usize);
        let within = if state.ended { Duration::ZERO } else { within };
        drop(state);
        let mut ends = [PollFd::new(&self.pty.master, PollFlags::IN)];
        if poll(&mut ends, Some(&Timespec::try_from(within).unwrap())).unwrap() == 0 {
            return 0;
        }
        // Packed bytes are twice as many characters.
        let mut received = vec![0; (bytes.len() / 2).min(left)];
        let length = rustix::io::read(&self.pty.master, &mut received).unwrap();
        self.shared.state.lock().unwrap().taken += length as u64;
        self.shared.changed.notify_all();
        self.unpacked(&received[..length], bytes)
    }

    /// The host's packed bytes, as text.
    fn unpacked(&self, received: &[u8], text: &mut [u8]) -> usize {
        let Some(unpacker) = &self.unpacker else {
            text[..received.len()].copy_from_slice(received);
            return received.len();
        };
        let mut length = 0;
        for &byte in received {
            let unpacked = unpacker.borrow_mut().feed(byte);
            text[length..length + unpacked.bytes().len()].copy_from_slice(unpacked.bytes());
            length += unpacked.bytes().len();
            if let Some(report) = unpacked.report {
                self.send(Reply::Text(&report.to_string()));
            }
        }
        length
    }
}

impl Replies for Port<'_> {
    fn send(&self, reply: Reply<'_>) {
        for line in reply.to_string().lines() {
            let mut rest = format!("{line}\n").into_bytes();
            while !rest.is_empty() {
                let written = rustix::io::write(&self.pty.master, &rest).unwrap();
                rest.drain(..written);
            }
            self.shared.state.lock().unwrap().said.push(line.to_owned());
        }
        self.shared.changed.notify_all();
    }
}

/// The port while a job comes.
struct JobPort<'a> {
    port: &'a Port<'a>,
    host: &'a mut Host,
    reader: &'a mut LineReader,
    clock: &'a VirtualClock,
}

impl JobLine for JobPort<'_> {
    async fn read(&mut self, bytes: &mut [u8], idle: bool) -> (usize, bool) {
        if idle {
            let length = self.port.read(bytes, self.port.wait());
            if length == 0 {
                VirtualDelay(self.clock).delay_ms(LOOK_MS).await;
            }
            return (length, true);
        }
        let port = self.port;
        let read = poll_fn(|_| match port.read(bytes, Duration::ZERO) {
            0 => Poll::Pending,
            length => Poll::Ready(length),
        });
        (read.await, true)
    }

    fn text<'a>(&'a mut self, bytes: &'a [u8]) -> (usize, Option<(&'a mut Host, Result<Line<'a>, LineError>)>) {
        let (used, line) = self.reader.feed(bytes);
        (used, line.map(|line| (&mut *self.host, line)))
    }

    fn answer_job(&mut self) {}
}

/// The board's main loop.
fn serve(pty: &Pty, settings: &Settings, shared: &Shared) -> Served {
    let unpacker = settings.unpacks.then(RefCell::default);
    let port = Port { pty, shared, unpacker };
    let session = Session::print(settings.profile, LOOK_AHEAD_BLOCKS, (), Silent(RefCell::new(None)));
    // The replies to earlier lines are not read.
    let mut printer = session.printer();
    for line in settings.before {
        let _ = session.run(printer.execute(0, line));
    }
    session.replies().0.replace(Some(&port));
    printer.set_meatpack(settings.unpacks);
    if settings.takes_jobs {
        printer.set_receives_jobs();
    }
    let (mut host, mut reader) = (Host::new(), LineReader::new());
    let (mut mid_line, mut in_frame) = (false, false);
    let (mut jobs, mut last_job) = (0, Report::NONE);
    let mut room = vec![0; JOB_BYTES];
    let mut buffer = [0; 64];
    loop {
        // Bytes that were sent before the end are there.
        let has_ended = port.has_ended();
        let length = port.read(&mut buffer, Duration::from_millis(100));
        if length == 0 && has_ended {
            break;
        }
        let mut bytes = &buffer[..length];
        while !bytes.is_empty() {
            let line_end = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            let (line, rest) = bytes.split_at(line_end.map_or(bytes.len(), |end| end + 1));
            let frame = in_frame || !mid_line && line.first() == Some(&FLAG);
            (mid_line, in_frame) = (line_end.is_none(), frame && line_end.is_none());
            if frame {
                if line_end.is_some() {
                    port.send(Reply::Text(&last_job.to_string()));
                }
                bytes = rest;
                continue;
            }
            let (used, heard) = reader.feed(line);
            bytes = &bytes[used..];
            let Some(heard) = heard else { continue };
            session.run(host.answer(&mut printer, heard));
            if let Some(request) = printer.take_job_request() {
                jobs += 1;
                let clock = session.clock();
                let mut line = JobPort { port: &port, host: &mut host, reader: &mut reader, clock };
                (last_job, in_frame) = session.run(printer.receive_job(request, &mut line, &mut room));
                mid_line = in_frame;
                break;
            }
        }
    }
    let figures = session.figures();
    let state = shared.state.lock().unwrap();
    Served { figures, taken: state.taken, jobs, said: state.said.clone() }
}

/// Replies that go to a port once there is one.
struct Silent<'a>(RefCell<Option<&'a Port<'a>>>);

impl Replies for Silent<'_> {
    fn send(&self, reply: Reply<'_>) {
        if let Some(port) = *self.0.borrow() {
            port.send(reply);
        }
    }
}
