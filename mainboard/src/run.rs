//! A run of an image on a machine, in virtual time.

use std::net::TcpListener;

use rigless::emulator::{self, AccessKind, Driver, Host, Settled, Start, Stop};
use rigless::image::{self, Image};
use rigless::session::Session;
use rigless::snapshot::{self, Reader, Snapshot, Store, Taken, Writer};
use rigless::time::VirtualNanos;

use crate::chip::halt::Halt;
use crate::machine::Machine;

/// What is outside the chip moves in slices of this, ns, and at its own instants in between.
pub const SLICE_NS: u64 = 100_000;

/// Whether to go on after a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Go on.
    GoOn,
    /// Go on after a pulse at the chip's reset pin (RM0090 6.1.1).
    Reset,
    /// The run is over.
    Stop,
}

/// Who stands at the machine: talks on its lines, breaks and mends its parts, and ends the run.
pub trait Operator: Send + 'static {
    /// A slice is over; `now_ns` is virtual time since the run began.
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, host: &mut dyn Host) -> Turn;

    /// The next instant at which it wants a turn, beside the slices.
    fn next_turn_ns(&self) -> Option<u64> {
        None
    }

    /// Whether a snapshot is to be taken at the end of this turn; asked once after each.
    fn wants_snapshot(&mut self) -> bool {
        false
    }

    /// The snapshot that it wanted, of everything but the operator itself: what to keep of that is its own affair.
    fn snapshot_taken(&mut self, snapshot: Result<Taken, snapshot::Error>) {
        let _ = snapshot;
    }
}

/// How to start.
#[derive(Debug, Default)]
pub struct Options<'a> {
    /// Where the core boots, if not at the start of flash: after a boot loader.
    pub boot: Option<u64>,
    /// Serves GDB there.
    pub debugger: Option<&'a TcpListener>,
    /// Waits for GDB before the first instruction.
    pub wait_for_debugger: bool,
}

/// The result of a run.
#[derive(Debug)]
pub struct Finished<O> {
    /// The session, and in it the machine as it stood.
    session: Session<Machine>,
    /// The operator.
    pub operator: O,
    /// How it went.
    pub report: Report,
}

impl<O> Finished<O> {
    /// The machine as it stood.
    #[must_use]
    pub fn machine(&self) -> &Machine {
        self.session.board()
    }
}

/// How a run went.
#[derive(Debug, Default, serde::Serialize)]
pub struct Report {
    /// Virtual time, ns.
    pub virtual_ns: u64,
    /// Instructions that the core retired.
    pub instructions: u64,
    /// Resets after the first start: when (ns), and who asked for it.
    pub resets: Vec<(u64, String)>,
    /// Registers that the firmware reached and that have no model, addresses at which nothing answers, accesses that a closed clock
    /// gate refused, and interrupts without a line.
    pub unmodelled: Vec<String>,
    /// What a model says of a state that its manual forbids or leaves open.
    pub told: Vec<String>,
    /// Accesses to peripherals.
    pub accesses: u64,
}

struct Runner<O> {
    operator: O,
    accesses: u64,
    last_stop: Option<Stop>,
    held: bool,
    /// The instant that it asked for last, ns.
    next_ns: u64,
    firmware: [u8; 32],
}

impl<O> Runner<O> {
    fn new(operator: O, images: &[Image], boot: Option<u64>) -> Self {
        let firmware = image::digest(images, boot);
        Self { operator, accesses: 0, last_stop: None, held: false, next_ns: SLICE_NS, firmware }
    }

    /// The core runs nothing while it enters a handler, or while it is held.
    fn hold(&mut self, session: &Session<Machine>, host: &mut dyn Host) {
        let chip = &session.board().chip;
        let held = chip.is_entering() || chip.halted() != Halt::Runs;
        if held != self.held {
            self.held = held;
            host.hold(held || session.unpowered());
        }
    }
}

/// What a snapshot keeps of a run beside chip and machine; the operator is the caller's.
#[derive(Debug, Default)]
struct Progress {
    accesses: u64,
    next_ns: u64,
    held: bool,
}

impl Store for Progress {
    fn store(&self, to: &mut Writer) -> Result<(), snapshot::Error> {
        to.put(&(self.accesses, self.next_ns, self.held))
    }

    fn load(&mut self, from: &mut Reader) -> Result<(), snapshot::Error> {
        (self.accesses, self.next_ns, self.held) = from.take()?;
        Ok(())
    }
}

impl<O: Operator> Driver<Machine> for Runner<O> {
    fn on_settled(&mut self, session: &mut Session<Machine>, host: &mut dyn Host, settled: Settled) {
        self.hold(session, host);
        if let Settled::Access { access, .. } = settled {
            self.accesses += 1;
            session.board_mut().chip.reached(access.virtual_time, access.kind, access.address);
            if access.kind == AccessKind::Write {
                session.board_mut().stored(access.virtual_time.0, access.address, access.value);
            }
        }
    }

    fn on_stop(&mut self, session: &mut Session<Machine>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        let now_ns = stop.at.0;
        let instructions = stop.instruction_count;
        self.last_stop = Some(stop);
        let resets = session.resets().len();
        let machine = session.board_mut();
        machine.advance(now_ns, resets);
        let turn = self.operator.turn(machine, now_ns, host);
        let next = [machine.plant.next_event_ns(), machine.usb_next_ns(), self.operator.next_turn_ns()]
            .into_iter()
            .flatten()
            .min();
        match turn {
            Turn::GoOn => {}
            Turn::Reset => session.reset_by_pin(VirtualNanos(now_ns), instructions, host),
            Turn::Stop => return None,
        }
        self.hold(session, host);
        let slice = now_ns + SLICE_NS;
        self.next_ns = next.map_or(slice, |next| next.clamp(now_ns + 1, slice));
        if self.operator.wants_snapshot() {
            let progress = Progress { accesses: self.accesses, next_ns: self.next_ns, held: self.held };
            self.operator.snapshot_taken(snapshot::take(session, host, stop, &self.firmware, &progress));
        }
        Some(VirtualNanos(self.next_ns))
    }
}

/// Runs an image until the operator stops.
///
/// # Errors
/// The image does not fit the chip, or the emulator could not go on.
pub fn run<O: Operator>(
    machine: Machine,
    images: &[Image],
    options: &Options<'_>,
    operator: O,
) -> Result<Finished<O>, emulator::Error> {
    let mut start = Start::new(images);
    start.boot = options.boot;
    start.debugger = options.debugger;
    start.wait_for_debugger = options.wait_for_debugger;
    let session = Session::new(Box::new(machine), 0, VirtualNanos(SLICE_NS))?;
    finish(session, &start, Runner::new(operator, images, options.boot))
}

/// Goes on from a snapshot, with a machine built as the one that it was taken of. From there on it is the run that it was taken
/// in, as long as the operator is as it was then.
///
/// # Errors
/// The snapshot is of another machine or image, or the emulator could not go on.
pub fn run_from<O: Operator>(
    snapshot: &Snapshot,
    machine: Machine,
    images: &[Image],
    boot: Option<u64>,
    operator: O,
) -> Result<Finished<O>, String> {
    let mut session = Session::new(Box::new(machine), 0, VirtualNanos(SLICE_NS)).map_err(|error| error.to_string())?;
    let mut runner = Runner::new(operator, images, boot);
    let mut progress = Progress::default();
    let resume = snapshot.restore(&mut session, &runner.firmware, &mut progress).map_err(|error| error.to_string())?;
    (runner.accesses, runner.next_ns, runner.held) = (progress.accesses, progress.next_ns, progress.held);
    session.run_until(VirtualNanos(progress.next_ns));
    let mut start = Start::new(images);
    start.boot = boot;
    start.resume = Some(&resume);
    finish(session, &start, runner).map_err(|error| error.to_string())
}

fn finish<O: Operator>(
    session: Session<Machine>,
    start: &Start<'_>,
    runner: Runner<O>,
) -> Result<Finished<O>, emulator::Error> {
    let finished = emulator::run(session, start, runner)?;
    let mut session = finished.session;
    let report = report(&mut session, finished.driver.last_stop, finished.driver.accesses);
    Ok(Finished { session, operator: finished.driver.operator, report })
}

fn report(session: &mut Session<Machine>, stop: Option<Stop>, accesses: u64) -> Report {
    let mut unmodelled: Vec<String> = session.unmapped().iter().map(ToString::to_string).collect();
    unmodelled.extend(session.refused().iter().map(|(address, fault)| format!("{address:#010x}: {fault}")));
    unmodelled.extend(session.unimplemented().values().map(|register| format!("{register:?}")));
    unmodelled.extend(session.unrouted().iter().map(|(instance, line)| format!("{instance}: interrupt {line}")));
    let told = session.told().map(|told| format!("{} {}: {}", told.instance, told.register, told.reason)).collect();
    Report {
        virtual_ns: stop.map_or(0, |stop| stop.at.0),
        instructions: stop.map_or(0, |stop| stop.instruction_count),
        resets: session.resets().iter().map(|reset| (reset.at.0, format!("{:?}", reset.cause))).collect(),
        unmodelled,
        told,
        accesses,
    }
}
