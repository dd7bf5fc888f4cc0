//! A run of an image on a machine, in virtual time.

use std::net::TcpListener;

use rigless::emulator::{self, AccessKind, Driver, Host, Settled, Start, Stop};
use rigless::image::{self, Image};
use rigless::session::Session;
use rigless::snapshot::{self, Reader, Snapshot, Store, Taken, Writer};
use rigless::time::VirtualNanos;

use crate::chip::Halt;
use crate::machine::Machine;

/// Length of a slice, ns: everything outside the chip advances once a slice, and at its own
/// events in between.
pub const SLICE_NS: u64 = 500_000;

/// Decision of an operator about the run after its turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Continue.
    Continue,
    /// Pulse the chip's reset pin and continue (RM0090 6.1.1).
    Reset,
    /// End the run.
    Stop,
}

/// The person at the machine: talks on its lines, breaks and mends its parts, and ends the run.
pub trait Operator: Send + 'static {
    /// Acts at the end of a slice; `now_ns` is virtual time since the run began.
    fn turn(&mut self, machine: &mut Machine, now_ns: u64, host: &mut dyn Host) -> Turn;

    /// The next instant at which the operator wants a turn besides the slices, ns.
    fn next_turn_ns(&self) -> Option<u64> {
        None
    }

    /// True to take a snapshot at the end of this turn; called once after each.
    fn wants_snapshot(&mut self) -> bool {
        false
    }

    /// Receives the requested snapshot. It contains everything except the operator, which
    /// saves its own state.
    fn snapshot_taken(&mut self, snapshot: Result<Taken, snapshot::Error>) {
        let _ = snapshot;
    }
}

/// Options of a run.
#[derive(Debug, Default)]
pub struct Options<'a> {
    /// The address of the vector table, for an image after a boot loader; `None` for
    /// the start of flash.
    pub boot: Option<u64>,
    /// Serves GDB on this listener.
    pub debugger: Option<&'a TcpListener>,
    /// Waits for GDB before the first instruction.
    pub wait_for_debugger: bool,
}

/// A run that has ended.
#[derive(Debug)]
pub struct Finished<O> {
    /// The session with the machine in its last state.
    session: Session<Machine>,
    /// The operator.
    pub operator: O,
    /// The report of the run.
    pub report: Report,
}

impl<O> Finished<O> {
    /// The machine in its last state.
    #[must_use]
    pub fn machine(&self) -> &Machine {
        self.session.board()
    }
}

/// The report of a run.
#[derive(Debug, Default, serde::Serialize)]
pub struct Report {
    /// Virtual time, ns.
    pub virtual_ns: u64,
    /// Instructions retired by the core.
    pub instructions: u64,
    /// Resets after the first start: instant (ns) and cause.
    pub resets: Vec<(u64, String)>,
    /// Registers without a model that the firmware accessed, addresses without a device, accesses
    /// refused by a closed clock gate, and interrupts without a line.
    pub unmodelled: Vec<String>,
    /// Messages of models about states that their manual forbids or leaves open.
    pub told: Vec<String>,
    /// Number of accesses to peripherals.
    pub accesses: u64,
}

struct Runner<O> {
    operator: O,
    accesses: u64,
    last_stop: Option<Stop>,
    held: bool,
    /// The next turn, ns.
    next_ns: u64,
    firmware: [u8; 32],
}

impl<O> Runner<O> {
    fn new(operator: O, images: &[Image], boot: Option<u64>) -> Self {
        let firmware = image::digest(images, boot);
        Self { operator, accesses: 0, last_stop: None, held: false, next_ns: SLICE_NS, firmware }
    }

    /// Holds the core while it enters a handler or is halted.
    fn hold(&mut self, session: &Session<Machine>, host: &mut dyn Host) {
        let chip = &session.board().chip;
        let held = chip.is_entering() || chip.halted() != Halt::Runs;
        if held != self.held {
            self.held = held;
            host.hold(held || session.unpowered());
        }
    }
}

/// The part of a snapshot that belongs to the run, besides chip and machine.
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
                session.board_mut().record_store(access.virtual_time.0, access.address, access.value);
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
        // What the operator has done at a switch is there at once.
        machine.drive_inputs(now_ns);
        let next = [machine.plant.next_event_ns(), machine.usb_next_ns(), self.operator.next_turn_ns()]
            .into_iter()
            .flatten()
            .min();
        match turn {
            Turn::Continue => {}
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
/// The image does not fit the chip, or the emulator failed.
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

/// Continues from a snapshot, on a machine built like the one in the snapshot. The run repeats the
/// original one as long as the operator has the same state as then.
///
/// # Errors
/// The snapshot is of another machine or image, or the emulator failed.
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
