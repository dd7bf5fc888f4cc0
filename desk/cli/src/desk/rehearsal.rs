//! A print on the desk: the machine of a board, with a step queue in virtual time.

use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

use ferrostep_papers::Papers;
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::machine::Silence;
use ferrostep_printer::{Profile, SharedMachine, SharedMotion, Signals};

use super::desk_time::DeskTime;
use super::drivers::DeskDrivers;
use super::queue_machine::{self, QueueMachine};
use super::session_motion::{Desk, MotionState};
use super::step_queue::VirtualStepQueue;
use crate::record::Observer;

/// Longest motion at once while a command waits for it; in between temperatures and the host get their turn.
const LONGEST_LEAP_TICKS: u64 = TICKS_PER_SECOND as u64 / 2;

/// A machine that makes every step, seen by `O`.
pub struct Rehearsal<O> {
    machine: RefCell<QueueMachine<O>>,
    time: DeskTime,
    /// Whether a command waits for motion.
    awaits_motion: Cell<bool>,
}

impl<O: Observer> Rehearsal<O> {
    /// A machine that has just been switched on, with this many blocks in its look-ahead ring.
    pub fn new(profile: &Profile, look_ahead: usize, drivers: Rc<DeskDrivers>, observer: O) -> Self {
        Self {
            machine: queue_machine::machine(profile, look_ahead, drivers, observer),
            time: DeskTime::default(),
            awaits_motion: Cell::new(false),
        }
    }

    /// Where the tool head truly is, units of 10 nm.
    pub fn true_position_10nm(&self) -> [i64; 3] {
        self.machine.borrow().queue().motors().true_position_10nm()
    }

    /// How far the motors have pushed against the frame behind end stops that did not trigger, units of 10 nm.
    pub fn pushed_10nm(&self) -> [i64; 3] {
        self.machine.borrow().queue().motors().pushed_10nm()
    }

    /// Step counters of all motors.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.machine.borrow().motor_steps()
    }

    /// Gives access to the observer of the motors.
    pub fn with_observer<T>(&self, act: impl FnOnce(&mut O) -> T) -> T {
        act(self.machine.borrow_mut().queue_mut().observer_mut())
    }

    /// The observer of the motors.
    pub fn into_observer(self) -> O {
        self.machine.into_inner().into_queue().into_observer()
    }
}

impl<O: Observer> Desk for Rehearsal<O> {
    type Motion<'a>
        = SharedMotion<DeskMachine<'a, O>>
    where
        O: 'a;

    type State = RefCell<QueueMachine<O>>;

    const MAKES_STEPS: bool = true;

    fn motion<'a>(&'a self, signals: &'a Signals) -> SharedMotion<DeskMachine<'a, O>> {
        SharedMotion::new(DeskMachine { desk: self, signals })
    }

    /// Plans and plays until a move fits that did not before, all motion has ended, or the longest leap is over. Then the
    /// waiting command looks, and waits again if it must.
    fn pass_motion(&self) {
        if !self.awaits_motion.take() {
            return;
        }
        let mut machine = self.machine.borrow_mut();
        let had_room = machine.has_room();
        let tick = machine.queue().motors().ledger.tick();
        machine.queue_mut().set_pause_tick(tick + LONGEST_LEAP_TICKS);
        loop {
            while machine.work(Silence::default()) {}
            if machine.is_idle() || !had_room && machine.has_room() {
                break;
            }
            let queue = machine.queue_mut();
            if !queue.play() || queue.is_paused() {
                break;
            }
        }
        if machine.is_idle() {
            machine.queue_mut().tell_move_ends(u64::MAX);
        }
    }

    fn wait_until(&self, wake_ns: u64) {
        self.time.wait_until(self.machine.tick(), wake_ns);
    }

    fn now_ns(&self) -> u64 {
        self.time.now_ns(self.machine.tick())
    }

    fn state(&self) -> &Self::State {
        &self.machine
    }
}

/// The machine, as commands share it with the desk.
pub struct DeskMachine<'a, O> {
    desk: &'a Rehearsal<O>,
    signals: &'a Signals,
}

impl<O: Observer> SharedMachine for DeskMachine<'_, O> {
    type Ring = Vec<Slot>;
    type Queue = VirtualStepQueue<O>;
    type Methods = Papers;
    type Servo = ferrostep_printer::Present;
    type ZMotors = ferrostep_printer::Present;
    type Tools = ferrostep_printer::Present;
    type Backlash = ferrostep_printer::Present;
    type SupplySignal = ferrostep_printer::Present;

    fn with<T>(&self, act: impl FnOnce(&mut QueueMachine<O>) -> T) -> T {
        act(&mut self.desk.machine.borrow_mut())
    }

    /// The desk plans when a command waits: only then does time pass.
    fn wake_planner(&self) {}

    fn is_halted(&self) -> bool {
        self.signals.is_halted()
    }

    async fn pause(&self) {
        let mut is_first = true;
        poll_fn(|_| {
            if !std::mem::take(&mut is_first) {
                return Poll::Ready(());
            }
            self.desk.awaits_motion.set(true);
            Poll::Pending
        })
        .await;
    }
}
