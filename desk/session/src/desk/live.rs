//! A machine on the desk whose time passes by itself, within the time granted: for hosts,
//! which come and go.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use ferrostep_papers::Papers;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::machine::Silence;
use ferrostep_printer::{Profile, SharedMachine, SharedMotion, Signals};

use super::accelerometer::{DeskAccelerometer, Tap};
use super::desk_time::motion_ticks;
use super::drivers::DeskDrivers;
use super::queue_machine::{self, QueueMachine};
use super::session_motion::{Desk, ExtruderNow, let_time_pass};
use super::step_queue::VirtualStepQueue;

/// The planner task looks at the step queue this often, as on a board.
const PLANNER_INTERVAL_NS: u64 = 2_000_000;

/// Silence of the host after which the moves in the ring are executed at standstill, as on a board.
const FLUSH_AFTER_NS: u64 = 100_000_000;

/// A machine that makes every step at its time.
pub struct LiveDesk {
    machine: RefCell<QueueMachine>,
    now_ns: Cell<u64>,
    granted_ns: Cell<u64>,
    /// Time at which the command side began to wait for the host.
    host_awaited_since_ns: Cell<Option<u64>>,
    accelerometer: Option<Rc<DeskAccelerometer>>,
}

impl LiveDesk {
    /// A machine that has just been switched on, with this many blocks in its look-ahead ring, and
    /// perhaps an accelerometer.
    pub fn new(
        profile: &Profile,
        look_ahead: usize,
        drivers: Rc<DeskDrivers>,
        accelerometer: Option<Rc<DeskAccelerometer>>,
    ) -> Self {
        Self {
            machine: queue_machine::machine(profile, look_ahead, drivers, Box::new(Tap(accelerometer.clone()))),
            now_ns: Cell::new(0),
            granted_ns: Cell::new(0),
            host_awaited_since_ns: Cell::new(None),
            accelerometer,
        }
    }

    /// Grants this much time from now on, instead of earlier grants.
    pub fn grant(&self, ns: u64) {
        self.granted_ns.set(self.now_ns.get().saturating_add(ns));
    }

    /// Returns true once the time granted has passed.
    pub fn is_held(&self) -> bool {
        self.now_ns.get() >= self.granted_ns.get()
    }

    /// Sets whether the command side waits for the host.
    pub fn set_host_awaited(&self, is_awaited: bool) {
        let since_ns = self.host_awaited_since_ns.get().unwrap_or(self.now_ns.get());
        self.host_awaited_since_ns.set(is_awaited.then_some(since_ns));
    }

    /// Returns true if all moves taken have been executed.
    pub fn is_idle(&self) -> bool {
        self.machine.borrow().is_idle()
    }

    /// Motion in the step queue, in steps of the queue.
    pub fn queued_entries(&self) -> usize {
        use ferrostep_hal_shim::StepQueue;
        self.machine.borrow().queue().waiting()
    }

    /// Switches all motors off, as a halt does.
    pub fn switch_motors_off(&self) {
        self.machine.borrow_mut().switch_motors_off();
    }

    /// Switches idle motors off as [`QueueMachine::rest`] does.
    pub fn rest(&self, now_ms: u32, timeout_ms: Option<u32>) -> bool {
        self.machine.borrow_mut().rest(now_ms, timeout_ms)
    }

    /// Position of X, Y and Z at the end of all moves taken, units of 10 nm.
    pub fn position_10nm(&self) -> [i64; 3] {
        self.machine.borrow().position_10nm()
    }

    /// Runs the planner task until it has nothing more to do.
    fn plan(&self, machine: &mut QueueMachine) {
        let now_ns = self.now_ns.get();
        let is_silent = |since_ns| now_ns - since_ns >= FLUSH_AFTER_NS;
        let may_flush = self.host_awaited_since_ns.get().is_some_and(is_silent);
        while machine.work(Silence { may_release: true, may_flush }) {}
    }
}

impl Desk for LiveDesk {
    type Motion<'a> = SharedMotion<LiveMachine<'a>>;

    type State = RefCell<QueueMachine>;

    const MAKES_STEPS: bool = true;

    fn motion<'a>(&'a self, signals: &'a Signals) -> SharedMotion<LiveMachine<'a>> {
        SharedMotion::new(LiveMachine { desk: self, signals })
    }

    /// Plays the motion of the time granted, up to the planner task's next look.
    fn pass_motion(&self) {
        let now_ns = self.now_ns.get();
        let until_ns = self.granted_ns.get().clamp(now_ns, now_ns + PLANNER_INTERVAL_NS);
        let mut machine = self.machine.borrow_mut();
        let [now_tick, until_tick] = [now_ns, until_ns].map(motion_ticks);
        if let Some(accelerometer) = &self.accelerometer {
            accelerometer.set_time(now_tick, machine.queue().now_tick());
        }
        machine.queue_mut().pass(until_tick - now_tick);
        if let Some(accelerometer) = &self.accelerometer {
            accelerometer.pass_to(until_tick);
        }
        self.now_ns.set(until_ns);
        self.plan(&mut machine);
    }

    /// Time passes by itself.
    fn wait_until(&self, _wake_ns: u64) {}

    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    fn extruder_now(&self) -> Option<ExtruderNow> {
        let machine = self.machine.borrow();
        let [.., steps] = machine.queue().motors().ledger.motor_steps();
        let steps_per_mm = machine.extruder_steps_per_mm().to_f64();
        Some(ExtruderNow { steps, pushed: machine.pushed_filament(), steps_per_mm })
    }

    fn state(&self) -> &Self::State {
        &self.machine
    }
}

/// The machine, as commands share it with the planner task.
pub struct LiveMachine<'a> {
    desk: &'a LiveDesk,
    signals: &'a Signals,
}

impl SharedMachine for LiveMachine<'_> {
    type Ring = Vec<Slot>;
    type Queue = VirtualStepQueue;
    type Methods = Papers;
    type Servo = ferrostep_printer::Present;
    type ZMotors = ferrostep_printer::Present;
    type Tools = ferrostep_printer::Present;
    type Backlash = ferrostep_printer::Present;
    type SupplySignal = ferrostep_printer::Present;

    fn with<T>(&self, act: impl FnOnce(&mut QueueMachine) -> T) -> T {
        act(&mut self.desk.machine.borrow_mut())
    }

    /// Planning takes no virtual time.
    fn wake_planner(&self) {
        self.desk.plan(&mut self.desk.machine.borrow_mut());
    }

    fn is_halted(&self) -> bool {
        self.signals.is_halted()
    }

    async fn pause(&self) {
        let_time_pass().await;
    }
}
