//! A printer on the desk with a card, and a host that says its lines at given places of a print.

use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::rc::Rc;
use std::task::Poll;

use embedded_hal_async::delay::DelayNs;
use ferrostep_card::LocalCard;
use ferrostep_gcode::{LineReader, Reply};
use ferrostep_planner::{StepDigests, StepObserver};
use ferrostep_printer::{Host, HostLines, HostText, Profile, Replies};
use ferrostep_session::record::Observer;
use ferrostep_session::{DeskPrinter, PrintSession, Session};
use ferrostep_virtual_board::{EndStopFailure, VirtualCard, VirtualDelay};

pub type Slot = VirtualCard<Vec<u8>>;
pub type Card = LocalCard<Slot>;
type Desk = PrintSession<StepLog, Said>;

/// An event of the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Motors in the first mask step, backwards in the second.
    Step(u8, u8),
    /// A move of this line has ended.
    MoveEnded(u32),
}

/// Log of the motors' events; `None` records nothing.
#[derive(Clone, Default)]
pub struct StepLog(pub Option<Rc<RefCell<Vec<Event>>>>);

impl StepLog {
    fn note(&self, event: Event) {
        if let Some(events) = &self.0 {
            events.borrow_mut().push(event);
        }
    }
}

impl StepObserver for StepLog {
    fn stepped(&mut self, _tick: u64, axes: u8, directions: u8) {
        self.note(Event::Step(axes, directions & axes));
    }
}

impl Observer for StepLog {
    fn redefined(&mut self, _tick: u64, _motor_steps: [i64; 4]) {}

    fn move_ended(&mut self, _tick: u64, line: u32) {
        self.note(Event::MoveEnded(line));
    }
}

/// The printer's replies.
#[derive(Default)]
pub struct Said(pub RefCell<Vec<String>>);

impl Replies for Said {
    fn send(&self, reply: Reply<'_>) {
        self.0.borrow_mut().extend(reply.to_string().lines().map(str::to_owned));
    }
}

pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

pub fn profile(name: &str) -> Profile {
    ferrostep_profiles::load(name).unwrap()
}

pub fn gunzip(path: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(std::fs::File::open(repository().join(path)).unwrap())
        .read_to_end(&mut bytes)
        .unwrap();
    bytes
}

/// The card made by mkfs.fat and mtools.
pub fn image() -> Vec<u8> {
    gunzip("printer/card/tests/images/fat16.img.gz")
}

/// A printer with a card, and its replies.
pub struct Setup {
    session: Desk,
    pub card: Card,
    host: RefCell<Host>,
    /// Virtual time that passes whenever the print has nothing to do, ms.
    pub idle_ms: Cell<u32>,
}

/// Called every time that the hosts are asked for lines, with the place of the print.
/// Returns their lines.
pub type Beside<'b> = dyn FnMut(&Card, Option<(u32, u32)>) -> Vec<String> + 'b;

impl Setup {
    pub fn new(profile: Profile, image: Vec<u8>) -> Self {
        Self::logged(profile, image, StepLog::default())
    }

    /// A printer whose motors are observed.
    pub fn logged(profile: Profile, image: Vec<u8>, log: StepLog) -> Self {
        let session = Session::print(profile, 128, log, Said::default());
        Self {
            session,
            card: Card::new(VirtualCard::new(image)),
            host: RefCell::new(Host::new()),
            idle_ms: Cell::new(0),
        }
    }

    /// Puts a file on the card, as a host does.
    pub fn put(&self, name: &str, bytes: &[u8]) {
        use ferrostep_card::{CardPort, Put, Request};
        let ask = |request: Request| {
            self.card.with(&mut |mailbox| mailbox.ask(request.clone()));
            self.card.with(&mut |mailbox| {
                mailbox.take_answer().unwrap().unwrap();
            });
        };
        ask(Request::Mount);
        ask(Request::Create(name.try_into().unwrap()));
        let mut rest = bytes;
        while !rest.is_empty() {
            self.card.with(&mut |mailbox| match mailbox.put(rest) {
                Put::Bytes(length) => rest = &rest[length..],
                Put::Wait => {}
                Put::Failed(failure) => panic!("{failure}"),
            });
        }
        ask(Request::Finish);
        ask(Request::Release);
    }

    /// Sends lines to the printer and lets it print what they start. Each element of `lines`
    /// is a host's line.
    pub fn say(&self, lines: &[&str], beside: &mut Beside<'_>) -> Vec<String> {
        let mut printer = self.printer();
        self.converse(&mut printer, lines, beside)
    }

    /// Makes the supply's signal report a failure; the power stays, as with a module.
    pub fn fail_supply(&self) {
        self.session.set_supply_failing(true);
    }

    /// Makes the supply's signal report that it is back.
    pub fn mend_supply(&self) {
        self.session.set_supply_failing(false);
    }

    /// Virtual time since the start, s.
    pub fn now_s(&self) -> f64 {
        self.session.clock().now_ns() as f64 * 1e-9
    }

    /// Positions of the motors, by their steps.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.session.desk().motor_steps()
    }

    /// The nozzle's true place, mm.
    pub fn true_mm(&self) -> [f64; 3] {
        self.session.desk().true_position_10nm().map(|units| units as f64 / 1e5)
    }

    /// Breaks the sensor with which an axis homes, or mends it.
    pub fn set_end_stop_failure(&self, axis: usize, failure: Option<EndStopFailure>) {
        self.session.set_end_stop_failure(axis, failure);
    }

    /// Returns true if this line has been sent in the present conversation.
    pub fn has_said(&self, text: &str) -> bool {
        self.session.replies().0.borrow().iter().any(|line| line == text)
    }

    pub fn printer(&self) -> DeskPrinter<'_> {
        let mut printer = self.session.printer();
        printer.set_card(&self.card);
        printer.set_receives_jobs();
        printer
    }

    pub fn converse(&self, printer: &mut DeskPrinter<'_>, lines: &[&str], beside: &mut Beside<'_>) -> Vec<String> {
        let mut hosts = Hosts {
            setup: self,
            host: *self.host.borrow(),
            reader: LineReader::new(),
            bytes: Vec::new(),
            at: 0,
            beside,
            polls: 0,
        };
        let mut room = vec![0; ferrostep_gpre::compact::MAX_FRAME_BYTES + 1024];
        let said = self.session.replies();
        said.0.borrow_mut().clear();
        self.session.run(async {
            for line in lines {
                hosts.bytes = format!("{line}\n").into_bytes();
                hosts.at = 0;
                loop {
                    match hosts.next_line() {
                        HostText::Line(host, line) => host.answer(printer, line).await,
                        HostText::Part => {}
                        HostText::Nothing => break,
                    }
                }
                if printer.prints_from_card() {
                    printer.print_from_card(&mut hosts, &mut room).await;
                }
            }
        });
        *self.host.borrow_mut() = hosts.host;
        said.0.take()
    }

    pub fn digests(&self) -> StepDigests {
        self.session.figures().digests
    }
}

struct Hosts<'a, 'b> {
    setup: &'a Setup,
    host: Host,
    reader: LineReader,
    bytes: Vec<u8>,
    at: usize,
    beside: &'a mut Beside<'b>,
    polls: u32,
}

impl Hosts<'_, '_> {
    fn next_line(&mut self) -> HostText<'_> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return HostText::Nothing;
        }
        let (used, line) = self.reader.feed(rest);
        self.at += used;
        match line {
            Some(line) => HostText::Line(&mut self.host, line),
            None => HostText::Part,
        }
    }
}

impl HostLines for Hosts<'_, '_> {
    fn next(&mut self) -> HostText<'_> {
        if self.at == self.bytes.len() {
            self.polls += 1;
            assert!(self.polls < 10_000_000, "the print does not end: {:?}", self.setup.session.replies().0);
            let progress = self.setup.session.signals().card_progress();
            let lines = (self.beside)(&self.setup.card, progress);
            self.at = 0;
            self.bytes = lines.iter().flat_map(|line| format!("{line}\n").into_bytes()).collect();
        }
        self.next_line()
    }

    fn tell_all(&mut self) {}

    async fn wait(&mut self, _idle: bool) {
        let idle_ms = self.setup.idle_ms.get();
        if idle_ms > 0 {
            return VirtualDelay(self.setup.session.clock()).delay_ms(idle_ms).await;
        }
        // Pending once, so that virtual time may pass.
        let waited = Cell::new(false);
        let mut once = pin!(poll_fn(|_| if waited.replace(true) { Poll::Ready(()) } else { Poll::Pending }));
        once.as_mut().await;
    }
}

/// Silent hosts.
pub fn nothing(_: &Card, _: Option<(u32, u32)>) -> Vec<String> {
    Vec::new()
}
