//! The board in virtual time: the firmware's own parts, and a clock that advances with
//! work and waiting.
//!
//! G-code executor, planner, look-ahead ring, step queue, step interrupt and emergency stop are
//! those that the firmware runs. The model adds the parts of RTIC and the processor: the step
//! interrupt comes at each update of its timer, whatever else runs; the planner task every 2 ms
//! and after each move; the executor in the remaining time. The speed of the host and the cost of
//! work can be chosen.

mod host_line;
mod impatience;
mod interrupts;
mod job_host;
mod ports;
mod queue;
mod recording;
mod time;

use std::cell::{Cell, RefCell};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use ferrostep_gcode::{Emergency, MotionFigures};
use ferrostep_hal_shim::FanOutput;
use ferrostep_papers::Papers;
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::SharedMotion;
use ferrostep_printer::machine::{Machine, Silence};
use ferrostep_printer::{Failure, Printer, Profile};
use ferrostep_step_player::{Signals as StepSignals, StepFeeder, Stepping};
use ferrostep_virtual_board::{ModelledSensors, VirtualClock, VirtualDelay, VirtualPort, VirtualUpdateTimer};
pub use host_line::HostLine;
pub use impatience::Ended;
use interrupts::{Interrupts, Player};
pub use job_host::{JOB_SILENCE_S, JobHost};
pub use ports::{ColdHeaters, Transcript};
pub use queue::Queue;
pub use recording::Watch;
use recording::WatchedPort;
pub use time::{CYCLES_A_MS, CYCLES_A_US, CYCLES_PER_S, Costs};
use time::{from_ns, to_ns};

/// Blocks in the look-ahead ring, as in the firmware.
pub const LOOK_AHEAD_BLOCKS: usize = 128;

/// Slots in the step queue, as in the firmware.
const STEP_QUEUE_SLOTS: usize = 2048;

/// Interval at which the planner task looks at the step queue, cycles, as in the firmware.
const PLANNER_INTERVAL: u64 = 2 * CYCLES_A_MS;

/// Silence after which the waiting moves are executed at standstill, cycles, as in the firmware.
const FLUSH_AFTER: u64 = 100 * CYCLES_A_MS;

/// Longest time of a command, cycles: one that takes longer hangs.
const LONGEST_COMMAND: u64 = 3_600 * CYCLES_PER_S;

/// Planner, motors and step queue of the board.
pub type BoardMachine<'a, M> = Machine<Vec<Slot>, ModelledSensors<Queue<'a, M>>, Papers>;

/// The printer on the board.
pub type BoardPrinter<'b, 'a, M> =
    Printer<'b, (SharedMotion<&'b Board<'a, M>>, ColdHeaters, VirtualDelay<'b>, Transcript)>;

/// The board.
pub struct Board<'a, M> {
    profile: &'a Profile,
    interrupts: &'a Interrupts<'a, M>,
    machine: RefCell<BoardMachine<'a, M>>,
    clock: VirtualClock,
    replies: Transcript,
    costs: Costs,
    /// Cycle at which the planner task looks again.
    next_plan: Cell<u64>,
    /// Cycle at which the executor began to wait for a line.
    awaits_since: Cell<Option<u64>>,
    stop_reports: RefCell<Vec<StopReport>>,
}

/// Positions right after the machine has followed a stop: as it believes, and as its signals say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopReport {
    /// Positions of the motors as the machine believes them, steps.
    pub motor_steps: [i64; 4],
    /// Position by the machine, units of 10 nm.
    pub position_10nm: [i64; 3],
    /// Positions of the motors by their signals, steps.
    pub counted_steps: [i64; 4],
    /// True if a motor stepped between the stop and now.
    pub stepped_after: bool,
}

/// Runs `job` with a board that has just been switched on, with a look-ahead ring of
/// this many blocks.
pub fn with_board<M: Stepping, T>(
    profile: &Profile,
    look_ahead: usize,
    costs: Costs,
    job: impl FnOnce(&Board<'_, M>) -> T,
) -> T {
    let (player, timer) = (Box::new(Player::<M>::new()), VirtualUpdateTimer::default());
    let port = WatchedPort::new(&timer, M::EVENTS_A_STEP == 1);
    let interrupts = Interrupts::new(&player, &timer, &port);
    let ticks = |ns: u32| (u64::from(ns) * u64::from(TICKS_PER_SECOND)).div_ceil(1_000_000_000) as u32;
    let signals = StepSignals {
        pulse_ticks: ticks(profile.driver.pulse_width_ns),
        direction_setup_ticks: ticks(profile.driver.direction_setup_ns),
    };
    let feeder = StepFeeder::new(&player, VirtualPort::pins(), signals);
    let queue = ModelledSensors::new(Queue::new(feeder, &interrupts, costs), profile.virtual_motors());
    let mut machine = Machine::new(profile, vec![Slot::EMPTY; look_ahead], queue);
    assert!(machine.set_motion_choice(&profile.motion).is_ok(), "the model has no such methods");
    job(&Board {
        profile,
        interrupts: &interrupts,
        machine: RefCell::new(machine),
        clock: VirtualClock::default(),
        replies: Transcript::default(),
        costs,
        next_plan: Cell::new(PLANNER_INTERVAL),
        awaits_since: Cell::new(None),
        stop_reports: RefCell::default(),
    })
}

impl<'a, M: Stepping> Board<'a, M> {
    /// The executor of G-code; a board has one.
    pub fn printer(&self) -> BoardPrinter<'_, 'a, M> {
        let clock = VirtualDelay(&self.clock);
        let mut printer = Printer::new(
            self.profile,
            SharedMotion::new(self),
            ColdHeaters::default(),
            clock,
            &self.replies,
            self.interrupts.signals(),
        );
        printer.set_emergency_parser(true);
        printer
    }

    /// Present time, cycles since the start.
    pub fn now(&self) -> u64 {
        self.interrupts.now()
    }

    /// Runs the planner task once.
    fn plan(&self) {
        let may_flush = self.awaits_since.get().is_some_and(|since| self.now() - since >= FLUSH_AFTER);
        let silence = Silence { may_release: true, may_flush };
        while self.work(silence) {}
        self.next_plan.set(self.now() + PLANNER_INTERVAL);
        self.clock.advance_to(to_ns(self.now()));
    }

    /// Does a portion of the planner's work; returns whether there is more. The positions after a
    /// stop are noted before anything else happens.
    fn work(&self, silence: Silence) -> bool {
        let mut machine = self.machine.borrow_mut();
        let stops = machine.stops();
        let more = machine.work(silence);
        if machine.stops() != stops {
            self.stop_reports.borrow_mut().push(StopReport {
                motor_steps: machine.motor_steps(),
                position_10nm: machine.position_10nm(),
                counted_steps: self.counted_steps(),
                stepped_after: self.interrupts.take_events_at_stop().is_some_and(|events| events != self.events()),
            });
        }
        more
    }

    /// Advances time to a cycle; the executor is idle.
    fn pass_to(&self, cycle: u64) {
        while self.next_plan.get() <= cycle {
            self.interrupts.pass_to(self.next_plan.get());
            self.plan();
        }
        self.interrupts.pass_to(cycle);
        self.clock.advance_to(to_ns(self.now()));
    }

    /// Runs the executor for this number of cycles; the planner task's time is added.
    fn work_for(&self, cycles: u64) {
        let mut end = self.now() + cycles;
        while self.next_plan.get() <= end {
            self.interrupts.pass_to(self.next_plan.get());
            let before = self.now();
            self.plan();
            end += self.now() - before;
        }
        self.pass_to(end);
    }

    /// Makes the executor wait for a line that comes at a cycle.
    pub fn wait_for_line(&self, cycle: u64) {
        self.awaits_since.set(Some(self.now()));
        self.pass_to(cycle);
        self.awaits_since.set(None);
    }

    /// Keeps the host silent for `milliseconds`.
    pub fn stay_silent(&self, milliseconds: u64) {
        self.wait_for_line(self.now() + milliseconds * CYCLES_A_MS);
    }

    /// Executes a line.
    ///
    /// # Errors
    /// The printer refuses the line.
    pub fn execute(&self, printer: &mut BoardPrinter<'_, 'a, M>, number: u32, text: &str) -> Result<(), Failure> {
        self.work_for(self.costs.line);
        self.poll(printer.execute_for_host(number, text, true))
    }

    /// Executes a line; `None` if it has no answer by a cycle.
    pub fn execute_by(
        &self,
        printer: &mut BoardPrinter<'_, 'a, M>,
        number: u32,
        text: &str,
        cycle: u64,
    ) -> Option<Result<(), Failure>> {
        self.work_for(self.costs.line);
        self.poll_by(printer.execute_for_host(number, text, true), cycle)
    }

    /// Polls to the end; time passes in between.
    fn poll<T>(&self, future: impl Future<Output = T>) -> T {
        let ended = self.poll_by(future, self.now() + LONGEST_COMMAND);
        ended.unwrap_or_else(|| panic!("a command without an end, at {} of virtual time", self.now()))
    }

    /// Polls to the end, or until a cycle has come: `None`.
    fn poll_by<T>(&self, future: impl Future<Output = T>, cycle: u64) -> Option<T> {
        let mut future = pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(outcome) = future.as_mut().poll(&mut context) {
                return Some(outcome);
            }
            if self.now() >= cycle {
                return None;
            }
            let wake = self.clock.take_wake_ns().map_or(self.now() + 1, from_ns);
            self.pass_to(wake.max(self.now()).min(cycle));
        }
    }

    /// Prints the lines of a text as they arrive, then waits in silence until all motion has ended,
    /// as after a host's file.
    ///
    /// # Errors
    /// The number of the line that was refused, with the reason.
    pub fn print(&self, text: &str, host: &mut HostLine) -> Result<(), (u32, Failure)> {
        let mut printer = self.printer();
        for (number, line) in (1..).zip(text.lines()) {
            self.wait_for_line(host.next_at(self.now()));
            self.execute(&mut printer, number, line).map_err(|failure| (number, failure))?;
        }
        while !self.machine.borrow().is_idle() {
            self.awaits_since.set(self.awaits_since.get().or(Some(self.now())));
            self.pass_to(self.now() + CYCLES_A_MS);
        }
        self.awaits_since.set(None);
        Ok(())
    }

    /// Sends M108, M112 or M410 at a cycle; the interrupt that receives it acts on it, whatever
    /// the tasks do. The caller sends the line itself.
    pub fn act_at(&self, cycle: u64, emergency: Emergency) {
        self.interrupts.act_at(cycle, emergency);
    }

    /// Takes the records of the stops so far.
    pub fn take_stop_reports(&self) -> Vec<StopReport> {
        self.stop_reports.take()
    }

    /// Returns true if all motion has ended.
    pub fn is_idle(&self) -> bool {
        self.machine.borrow().is_idle()
    }

    /// Positions of the motors at the end of the queue as the machine believes them, steps.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.machine.borrow().motor_steps()
    }

    /// Machine position at the end of all moves taken, units of 10 nm.
    pub fn position_10nm(&self) -> [i64; 3] {
        self.machine.borrow().position_10nm()
    }

    /// The fan's power with the motion that has ended, 0 to 255.
    pub fn fan_power(&self) -> u8 {
        self.machine.borrow().fan_demand().powers[FanOutput::Part.index()]
    }

    /// The figures of M797.
    pub fn figures(&self) -> MotionFigures {
        self.machine.borrow().figures()
    }

    /// Positions of the motors by their signals, steps.
    pub fn counted_steps(&self) -> [i64; 4] {
        self.interrupts.port().port().motor_steps()
    }

    /// Moments at which motors stepped.
    pub fn events(&self) -> u64 {
        self.interrupts.port().port().events()
    }

    /// The shortest time between two such moments, cycles.
    pub fn shortest_interval(&self) -> u64 {
        self.interrupts.port().port().shortest_cycles()
    }

    /// The record of the motors.
    pub fn watch(&self) -> Watch {
        self.interrupts.port().watch()
    }

    /// Returns true if M112 has stopped everything, until M999.
    pub fn is_halted(&self) -> bool {
        self.interrupts.signals().is_halted()
    }

    /// Number of answers to the host.
    pub fn answers(&self) -> u32 {
        self.replies.1.get()
    }

    /// The lines sent to the host, without `ok`.
    pub fn replies(&self) -> Vec<String> {
        self.replies.0.borrow().clone()
    }
}
