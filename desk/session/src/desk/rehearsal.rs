//! A print on the desk: the machine of a board, with a step queue in virtual time.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::marker::PhantomData;
use std::rc::Rc;

use ferrostep_papers::Papers;
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::machine::Silence;
use ferrostep_printer::{Profile, SharedMachine, SharedMotion, Signals};

use super::desk_time::DeskTime;
use super::drivers::DeskDrivers;
use super::line_ends::LineEnds;
use super::queue_machine::{self, QueueMachine};
use super::session_motion::{Desk, MotionState, let_time_pass};
use super::step_queue::VirtualStepQueue;
use crate::record::Observer;

/// Longest motion at once while a command waits for it; in between temperatures and the
/// host get their turn.
const LONGEST_LEAP_TICKS: u64 = TICKS_PER_SECOND as u64 / 2;

/// A machine that makes every step, seen by `O`.
pub struct Rehearsal<O> {
    steps: Steps,
    observer: PhantomData<O>,
}

/// The machine without its observer's type, so that the printer's code is compiled once.
struct Steps {
    machine: RefCell<QueueMachine>,
    time: DeskTime,
    /// True while a command waits for motion.
    awaits_motion: Cell<bool>,
}

impl<O: Observer> Rehearsal<O> {
    /// A machine that has just been switched on, with this many blocks in its look-ahead ring.
    pub fn new(profile: &Profile, look_ahead: usize, drivers: Rc<DeskDrivers>, observer: O) -> Self {
        let steps = Steps {
            machine: queue_machine::machine(profile, look_ahead, drivers, Box::new(observer)),
            time: DeskTime::default(),
            awaits_motion: Cell::new(false),
        };
        Self { steps, observer: PhantomData }
    }

    /// True position of the tool head, units of 10 nm.
    pub fn true_position_10nm(&self) -> [i64; 3] {
        self.steps.machine.borrow().queue().motors().true_position_10nm()
    }

    /// Distance that the motors have pushed against the frame past end stops that did not
    /// trigger, units of 10 nm.
    pub fn pushed_10nm(&self) -> [i64; 3] {
        self.steps.machine.borrow().queue().motors().pushed_10nm()
    }

    /// Step counters of all motors.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.steps.machine.borrow().motor_steps()
    }

    /// Gives access to the observer of the motors.
    pub fn with_observer<T>(&self, act: impl FnOnce(&mut O) -> T) -> T {
        let mut machine = self.steps.machine.borrow_mut();
        let observer: &mut dyn Any = machine.queue_mut().observer_mut();
        match observer.downcast_mut() {
            Some(observer) => act(observer),
            None => unreachable!("it was made with one of this type"),
        }
    }

    /// The observer of the motors.
    pub fn into_observer(self) -> O {
        let observer: Box<dyn Any> = self.steps.machine.into_inner().into_queue().into_observer();
        match observer.downcast() {
            Ok(observer) => *observer,
            Err(_) => unreachable!("it was made with one of this type"),
        }
    }
}

impl<O: Observer> Desk for Rehearsal<O> {
    type Motion<'a>
        = SharedMotion<DeskMachine<'a>>
    where
        O: 'a;

    type State = RefCell<QueueMachine>;

    const MAKES_STEPS: bool = true;

    fn motion<'a>(&'a self, signals: &'a Signals) -> SharedMotion<DeskMachine<'a>> {
        SharedMotion::new(DeskMachine { steps: &self.steps, signals })
    }

    /// Plans and plays until a move fits that did not before, all motion has ended, or the longest
    /// leap is over. Then the waiting command looks, and waits again if it must.
    fn pass_motion(&self) {
        if !self.steps.awaits_motion.take() {
            return;
        }
        let mut machine = self.steps.machine.borrow_mut();
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
        self.steps.time.wait_until(self.steps.machine.tick(), wake_ns);
    }

    fn now_ns(&self) -> u64 {
        self.steps.time.now_ns(self.steps.machine.tick())
    }

    fn follow_lines(&self, ends: Rc<LineEnds>) -> bool {
        self.steps.machine.borrow_mut().queue_mut().follow_lines(ends);
        true
    }

    fn state(&self) -> &Self::State {
        &self.steps.machine
    }
}

/// The machine, as commands share it with the desk.
pub struct DeskMachine<'a> {
    steps: &'a Steps,
    signals: &'a Signals,
}

impl SharedMachine for DeskMachine<'_> {
    type Ring = Vec<Slot>;
    type Queue = VirtualStepQueue;
    type Methods = Papers;
    type Servo = ferrostep_printer::Present;
    type ZMotors = ferrostep_printer::Present;
    type Tools = ferrostep_printer::Present;
    type Backlash = ferrostep_printer::Present;
    type SupplySignal = ferrostep_printer::Present;

    fn with<T>(&self, act: impl FnOnce(&mut QueueMachine) -> T) -> T {
        act(&mut self.steps.machine.borrow_mut())
    }

    /// The desk plans when a command waits: only then does time pass.
    fn wake_planner(&self) {}

    fn is_halted(&self) -> bool {
        self.signals.is_halted()
    }

    async fn pause(&self) {
        self.steps.awaits_motion.set(true);
        let_time_pass().await;
    }
}
