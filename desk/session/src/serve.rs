//! A printer on the desk that hosts connect to: the board's planner, step queue, heaters and
//! drivers in virtual time, which follows the wall clock.

mod faults;
mod host_side;
mod hosts;
mod ownership;
mod pace;
mod port;

use std::cell::RefCell;
use std::future::{Future, poll_fn};
use std::io;
use std::pin::pin;
use std::task::Poll;
use std::time::{Duration, Instant};

use ferrostep_card::LocalCard;
use ferrostep_gcode::{Emergency, Reply, Temperatures};
use ferrostep_hal_shim::Heater;
use ferrostep_printer::SharedMotion;
use ferrostep_printer::{Heating, Printer, Profile, Replies, temperatures};
use ferrostep_simulator::frame::Mode;
use ferrostep_virtual_board::{VirtualCard, VirtualClock};

use crate::desk::{Desk, Figures, LOOK_AHEAD_BLOCKS, LiveMachine, MotionState};
use crate::session::{DeskPorts, LiveSession, Session};
use crate::settings_file::SettingsFile;

pub use faults::{Fault, FaultKind, KINDS as FAULT_KINDS};
pub use hosts::{Hosts, PageLine};
pub use ownership::Ownership;
pub use pace::{HOST_TURN, Speed};
pub use port::HostPort;

use host_side::{CardHost, HostSide, JobHost};
use pace::{Doing, Next, Pace};

/// Interval at which the host is served while a command is executed.
const EXCHANGE_INTERVAL: Duration = Duration::from_millis(1);

/// Interval of the looks at motors at rest, ns of virtual time, as on a board.
const REST_INTERVAL_NS: u64 = 100_000_000;

/// Interval between two displays of the state.
const STATUS_INTERVAL: Duration = Duration::from_millis(250);

/// Room for the longest frame of a prepared job, and as much as a host may send
/// meanwhile, as on a board.
const JOB_BYTES: usize = ferrostep_gpre::compact::MAX_FRAME_BYTES + 1024;

/// The axis that a probe homes.
const PROBED_AXIS: usize = 2;

/// A card whose blocks are the bytes of an image.
type Card = LocalCard<VirtualCard<Vec<u8>>>;

/// A session with a host's port.
type HostSession = LiveSession<HostPort>;

/// The printer that is served.
type HostPrinter<'a> = Printer<'a, DeskPorts<'a, SharedMotion<LiveMachine<'a>>>>;

/// The settings of a served printer.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The machine.
    pub profile: Profile,
    /// Speed of its time.
    pub speed: Speed,
    /// The faults to make.
    pub faults: Vec<Fault>,
    /// The frame's modes along X and Y, which its accelerometer feels; `None`: the
    /// printer has none.
    pub frame: Option<[Mode; 2]>,
    /// The image of the card in its slot; `None`: the printer has no slot.
    pub card: Option<Vec<u8>>,
}

/// A printer's state, for a person.
#[derive(Clone, Debug)]
pub struct Status {
    /// Activity of the printer.
    pub state: State,
    /// True while a host is connected.
    pub is_connected: bool,
    /// Position of the tool head after all moves taken, mm.
    pub position_mm: [f64; 3],
    /// Temperatures and targets.
    pub temperatures: Temperatures,
    /// Lines executed.
    pub lines: u32,
    /// Entries in the step queue.
    pub queued_entries: usize,
    /// Virtual time since the printer was switched on, s.
    pub time_s: f64,
}

/// The activity of a printer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// No command and no motion.
    Idle,
    /// Motion.
    Moving,
    /// A command without motion: heating, a dwell, a pause.
    Waiting,
    /// M112, or a fault.
    Halted,
}

impl State {
    /// Returns the state's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Moving => "moving",
            Self::Waiting => "waiting",
            Self::Halted => "halted",
        }
    }
}

/// The summary of a served printer.
#[derive(Clone, Debug)]
pub struct Served {
    /// Lines executed.
    pub lines: u32,
    /// The different unknown commands.
    pub unknown_commands: Vec<String>,
    /// Moves, filament.
    pub tally: ferrostep_printer::Tally,
    /// Position as M114 reports it, units of 10 nm.
    pub logical_10nm: [i64; 4],
    /// Counts of the motors.
    pub figures: Figures,
    /// Error with which it ended by itself; `None` if a person ended it.
    pub failed: Option<String>,
    /// The card's image as it is now.
    pub card: Option<Vec<u8>>,
}

/// Serves hosts, one after the other, until `ends` returns `true`. Settings survive in `memory`, if
/// there is one. `show` is called several times a second.
pub fn serve(
    hosts: Hosts,
    settings: &Settings,
    memory: Option<&SettingsFile>,
    ends: impl Fn() -> bool,
    mut show: impl FnMut(&Status),
) -> Served {
    let session = Session::live_with(settings.profile, LOOK_AHEAD_BLOCKS, settings.frame, HostPort::new(hosts));
    let card = settings.card.clone().map(|image| Card::new(VirtualCard::new(image)));
    let mut printer = session.printer();
    if let Some(card) = &card {
        printer.set_card(card);
    }
    printer.set_emergency_parser(true);
    printer.set_meatpack(true);
    printer.set_receives_jobs();
    let port = session.replies();
    port.send(Reply::Start);
    port.say("echo:board: virtual");
    if let Some(memory) = memory {
        printer.set_settings_memory(memory);
        printer.restore_settings();
    }
    let failed = RefCell::new(None);
    let mut conductor = Conductor::new(settings, Instant::now());
    let is_over = || ends() || failed.borrow().is_some();
    session.run_with(until(is_over, answer_hosts(&mut printer, port, session.clock(), card.is_some())), |session| {
        if let Err(error) = conductor.turn(session, card.as_ref()) {
            failed.replace(Some(error.to_string()));
        }
        if let Some(status) = conductor.status(session) {
            show(&status);
        }
    });
    Served {
        lines: port.lines(),
        unknown_commands: port.unknown_commands(),
        tally: printer.tally(),
        logical_10nm: printer.logical_10nm(),
        figures: session.figures(),
        failed: failed.take(),
        card: card.as_ref().map(|card| card.with_slot(|slot| slot.with_image(std::mem::take))),
    }
}

/// Polls a future to its end, or until `is_over`.
async fn until(is_over: impl Fn() -> bool, future: impl Future<Output = ()>) {
    let mut future = pin!(future);
    poll_fn(|context| if is_over() { Poll::Ready(()) } else { future.as_mut().poll(context) }).await;
}

/// The printer task: lines to commands, commands to moves and replies.
async fn answer_hosts(printer: &mut HostPrinter<'_>, port: &HostPort, clock: &VirtualClock, has_card: bool) {
    if has_card {
        printer.mount_card().await;
    }
    let mut room = vec![0; JOB_BYTES];
    let mut side = HostSide::new();
    let mut buffer = [0; 64];
    loop {
        let mut bytes = port.read(&mut buffer).await;
        while !bytes.is_empty() {
            let (used, said) = side.feed(bytes, port);
            bytes = bytes.get(used..).unwrap_or_default();
            let Some((host, line)) = said else { continue };
            host.answer(printer, line).await;
            if let Some(request) = printer.take_job_request() {
                // The host that asks waits for the answer, and sends again what it sent
                // after the question.
                let mut line = JobHost::new(port, &mut side, clock);
                let ended = printer.receive_job(request, &mut line, &mut room).await;
                side.job_ended(ended);
                break;
            }
        }
        if printer.prints_from_card() {
            printer.print_from_card(&mut CardHost::new(port, &mut side), &mut room).await;
        }
    }
}

/// Brings host, printer and time together between two of the printer's steps.
struct Conductor {
    pace: Pace,
    /// The faults to come, the next one last.
    faults: Vec<Fault>,
    exchanged: Instant,
    shown: Option<Instant>,
    rested_ns: u64,
    was_halted: bool,
}

impl Conductor {
    fn new(settings: &Settings, now: Instant) -> Self {
        let mut faults = settings.faults.clone();
        faults.sort_by_key(|fault| std::cmp::Reverse(fault.at));
        Self {
            pace: Pace::new(settings.speed, now),
            faults,
            exchanged: now,
            shown: None,
            rested_ns: 0,
            was_halted: false,
        }
    }

    /// Exchanges bytes with the host and acts on commands that do not wait their turn. Returns how
    /// much time may pass next; if none may, it waits for the host.
    ///
    /// # Errors
    /// The host's line is broken for good.
    fn turn(&mut self, session: &HostSession, card: Option<&Card>) -> io::Result<()> {
        let (desk, port) = (session.desk(), session.replies());
        let now = Instant::now();
        let now_ns = session.clock().now_ns();
        if port.is_awaited() || now.saturating_duration_since(self.exchanged) >= EXCHANGE_INTERVAL {
            self.exchanged = now;
            self.exchange(session)?;
        }
        self.fail(session, card, now_ns);
        self.follow_halt(session);
        self.rest_motors(session, now_ns);
        let is_awaited = port.is_awaited();
        desk.set_host_awaited(is_awaited);
        let doing = Doing {
            command: !is_awaited,
            waits_for_person: session.signals().is_paused_for_user(),
            motion: !desk.is_idle(),
        };
        match self.pace.look(now, now_ns, doing) {
            Next::Pass(ns) => desk.grant(ns),
            Next::Wait(longest) => {
                desk.grant(0);
                port.wait(longest);
            }
        }
        Ok(())
    }

    fn exchange(&mut self, session: &HostSession) -> io::Result<()> {
        let received = session.replies().exchange()?;
        if received.anything {
            self.pace.hear();
        }
        if received.line {
            session.signals().note_host();
        }
        for emergency in received.emergencies {
            match emergency {
                Emergency::Stop => {
                    session.halt();
                    session.replies().send(Reply::Killed);
                }
                // The line goes into a file.
                Emergency::QuickStop | Emergency::EndWait if session.signals().is_writing() => {}
                Emergency::QuickStop => session.desk().state().stop(),
                Emergency::EndWait => session.signals().end_wait(),
                Emergency::PromptAnswer(button) => session.signals().answer_prompt(button),
            }
        }
        Ok(())
    }

    /// Makes the faults that are due.
    fn fail(&mut self, session: &HostSession, card: Option<&Card>, now_ns: u64) {
        while let Some(fault) = self.faults.pop_if(|fault| fault.at <= Duration::from_nanos(now_ns)) {
            match fault.kind {
                FaultKind::Heater(heater, failure) => session.set_heater_failure(heater, Some(failure)),
                FaultKind::Line(fault, share) => session.replies().damage(fault, share),
                FaultKind::FilamentOut => session.set_filament_out(true),
                FaultKind::Fan(fan, is_stuck) => session.set_fan_stuck(fan, is_stuck),
                FaultKind::FilamentStuck(is_stuck) => session.set_filament_stuck(is_stuck),
                FaultKind::EndStop(axis, failure) => session.set_end_stop_failure(axis, failure),
                FaultKind::Pin(failure) => session.set_end_stop_failure(PROBED_AXIS, failure),
                FaultKind::SupplySignal(is_failing) => session.set_supply_failing(is_failing),
                FaultKind::FilamentBack => session.set_filament_out(false),
                FaultKind::CardPulled => drop(card.map(|card| card.with_slot(VirtualCard::pull))),
                FaultKind::CardPutBack => drop(card.map(|card| card.with_slot(VirtualCard::insert))),
            }
        }
    }

    /// A halt takes the motors' current away and is reported here; a heater's fault has been
    /// reported already.
    fn follow_halt(&mut self, session: &HostSession) {
        let is_halted = session.signals().is_halted();
        if is_halted && !std::mem::replace(&mut self.was_halted, is_halted) {
            session.desk().switch_motors_off();
        }
        self.was_halted = is_halted;
    }

    /// Switches motors off that have rested for long enough (M84 S).
    fn rest_motors(&mut self, session: &HostSession, now_ns: u64) {
        if now_ns - self.rested_ns < REST_INTERVAL_NS {
            return;
        }
        self.rested_ns = now_ns;
        let (signals, heating) = (session.signals(), session.heating());
        let keeps_heat = Heater::ALL.into_iter().any(|heater| heating.status(heater).target_celsius > 0.0);
        let timeout_s = Some(signals.idle_timeout_s()).filter(|s| *s > 0 && !keeps_heat && !signals.is_at_work());
        // A clock of milliseconds that wraps.
        let now_ms = (now_ns / 1_000_000) as u32;
        if session.desk().rest(now_ms, timeout_s.map(|seconds| seconds.saturating_mul(1000))) {
            session.replies().say("echo:motors switched off after a rest (M84 S), home before the next move");
        }
    }

    /// Shows the state when it is due.
    fn status(&mut self, session: &HostSession) -> Option<Status> {
        let now = Instant::now();
        if self.shown.is_some_and(|shown| now.saturating_duration_since(shown) < STATUS_INTERVAL) {
            return None;
        }
        self.shown = Some(now);
        let (desk, port) = (session.desk(), session.replies());
        let state = match () {
            () if session.signals().is_halted() => State::Halted,
            () if !desk.is_idle() => State::Moving,
            () if !port.is_awaited() => State::Waiting,
            () => State::Idle,
        };
        Some(Status {
            state,
            is_connected: port.is_connected(),
            position_mm: desk.position_10nm().map(|length| length as f64 / 1e5),
            temperatures: temperatures(&session.heating()),
            lines: port.lines(),
            queued_entries: desk.queued_entries(),
            time_s: desk.now_ns() as f64 / 1e9,
        })
    }
}
