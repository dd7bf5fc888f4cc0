//! The printer's ports, as views of the resources it shares with other tasks.
//!
//! A lock lasts for one call into a library. The views are used by one task only and no borrow outlives a call, so the
//! cells are never found borrowed.

use core::cell::RefCell;

use ferrostep_gcode::{MotionFigures, Reply};
use ferrostep_hal_shim::Heater;
use ferrostep_hal_shim::stepping::StepPlayer;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{Limits, MotionChoice, Move, MoveError, Moved};
use ferrostep_printer::heat::HeatFault;
use ferrostep_printer::machine::Machine;
use ferrostep_printer::{HeaterStatus, Heating, Motion, MotionError, Replies, Seek, Signals};
use ferrostep_stm32f4::bench::BenchPins;
use ferrostep_stm32f4::step_timer::{StepQueue, StepTimer};
use rtic::Mutex;
use rtic_monotonics::systick::prelude::*;
use rtic_sync::signal::Signal;

use crate::clock::Mono;
use crate::heat::Heat;
use crate::host_line::Writer;
use crate::profile::StepSignals;

/// Blocks in the look-ahead ring, as on the desk.
pub const LOOK_AHEAD_BLOCKS: usize = 128;

/// Slots in the step queue, about as many as entries on the desk: 32 KiB.
pub const STEP_QUEUE_SLOTS: usize = 2048;

/// Ports that carry the board's step and direction signals.
const MOTOR_PORTS: usize = 1;

/// The step queue and the state of the step interrupt.
pub static STEPS: StepPlayer<StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS> = StepPlayer::new();

/// The step interrupt of this board.
pub type BoardStepTimer = StepTimer<StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS>;

/// The machine of this board.
pub type BoardMachine = Machine<&'static mut [Slot], StepQueue<BenchPins, StepSignals, MOTOR_PORTS, STEP_QUEUE_SLOTS>>;

/// There is something for the planner task to do.
pub static PLANNER_WORK: Signal<()> = Signal::new();

/// How often a command that waits for motion looks whether it has come.
const LOOK_MS: u32 = 1;

/// Planner and motors.
pub struct BoardMotion<'a, M> {
    machine: RefCell<M>,
    signals: &'a Signals,
}

impl<'a, M: Mutex<T = BoardMachine>> BoardMotion<'a, M> {
    /// The view of a machine. M112 ends every wait.
    pub fn new(machine: M, signals: &'a Signals) -> Self {
        Self { machine: RefCell::new(machine), signals }
    }

    fn with<T>(&self, act: impl FnOnce(&mut BoardMachine) -> T) -> T {
        self.machine.borrow_mut().lock(act)
    }

    /// Tries until it succeeds, then wakes the planner task; that is above the caller's, so what it makes of the change
    /// is there before the next try.
    async fn wait<T>(&self, mut attempt: impl FnMut(&mut BoardMachine) -> Option<T>) -> Result<T, MotionError> {
        let stops = self.with(|machine| machine.stops());
        loop {
            if self.signals.is_halted() || self.with(|machine| machine.stops()) != stops {
                return Err(MotionError::Stopped);
            }
            if let Some(value) = self.with(&mut attempt) {
                PLANNER_WORK.writer().write(());
                return Ok(value);
            }
            Mono::delay(LOOK_MS.millis()).await;
        }
    }
}

impl<M: Mutex<T = BoardMachine>> Motion for BoardMotion<'_, M> {
    async fn add(&mut self, request: Move) -> Result<Moved, MotionError> {
        self.wait(|machine| match machine.add(&request) {
            Err(MoveError::NoRoom) => None,
            Err(error) => Some(Err(MotionError::Move(error))),
            Ok(moved) => Some(Ok(moved)),
        })
        .await?
    }

    async fn set_fan_power(&mut self, power: u8) -> Result<(), MotionError> {
        self.wait(|machine| machine.add_fan_power(power).then_some(())).await
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.with(|machine| machine.flush());
        PLANNER_WORK.writer().write(());
        self.wait(|machine| machine.is_idle().then_some(())).await
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<Seek, MotionError> {
        self.finish().await?;
        if self.add(request).await? == Moved::Nothing {
            return Ok(Seek::Missed);
        }
        self.with(|machine| machine.begin_seek(axis));
        PLANNER_WORK.writer().write(());
        self.wait(|machine| machine.take_sought()).await
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.with(|machine| machine.position_10nm())
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.with(|machine| machine.set_position(position_10nm));
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.with(|machine| machine.motor_steps())
    }

    fn figures(&self) -> MotionFigures {
        self.with(|machine| machine.figures())
    }

    fn limits(&self) -> Limits {
        self.with(|machine| machine.limits())
    }

    fn set_limits(&mut self, limits: Limits) {
        self.with(|machine| machine.set_limits(limits));
    }

    fn motion_choice(&self) -> MotionChoice {
        self.with(|machine| machine.motion_choice())
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) {
        self.with(|machine| machine.set_motion_choice(choice));
    }

    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        self.with(|machine| machine.set_motors_enabled(axes, enabled));
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.with(|machine| machine.is_end_stop_triggered(axis))
    }

    fn stop(&mut self) -> i64 {
        self.with(|machine| {
            machine.request_stop();
            machine.work(Default::default());
        });
        self.with(|machine| machine.take_dropped_100pm())
    }
}

/// Heater control.
pub struct BoardHeating<H>(pub RefCell<H>);

impl<H: Mutex<T = Heat>> BoardHeating<H> {
    /// Why the heaters are off for good, if they are.
    pub fn fault(&self) -> Option<HeatFault> {
        self.0.borrow_mut().lock(|heat| heat.fault())
    }
}

impl<H: Mutex<T = Heat>> Heating for BoardHeating<H> {
    fn set_target(&mut self, heater: Heater, celsius: f32) {
        self.0.get_mut().lock(|heat| heat.set_target(heater, celsius));
    }

    fn status(&self, heater: Heater) -> HeaterStatus {
        self.0.borrow_mut().lock(|heat| heat.status(heater))
    }

    fn all_off(&mut self) {
        self.0.get_mut().lock(|heat| heat.all_off());
    }
}

/// The serial line's sending end. A reply is whole: the lock keeps others out until its last byte.
pub struct BoardReplies<W>(pub RefCell<W>);

impl<W: Mutex<T = Writer>> BoardReplies<W> {
    /// Says that the machine is halted, and the heater fault that did it: adjacent lines, as hosts expect.
    pub fn halted(&self, fault: Option<HeatFault>) {
        self.0.borrow_mut().lock(|writer| {
            if let Some(fault) = fault {
                writer.line(fault);
            }
            writer.line(Reply::Killed);
        });
    }

    /// Says how many bytes came too fast, if any did.
    pub fn lost_bytes(&self, lost: u32) {
        if lost > 0 {
            self.0.borrow_mut().lock(|writer| writer.line(format_args!("echo:serial: {lost} bytes lost")));
        }
    }
}

/// How often something could not keep up, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overload {
    /// Blocks that left the look-ahead ring early because steps ran out.
    starvation_flushes: u64,
    planning_slowdowns: u64,
    underruns: u64,
    made_up_updates: u64,
    refused_entries: u64,
}

impl Overload {
    /// Its part of all figures.
    pub fn of(figures: &MotionFigures) -> Self {
        let MotionFigures {
            starvation_flushes, planning_slowdowns, underruns, made_up_updates, refused_entries, ..
        } = *figures;
        Self { starvation_flushes, planning_slowdowns, underruns, made_up_updates, refused_entries }
    }
}

impl<W: Mutex<T = Writer>> BoardReplies<W> {
    /// Says what could not keep up so far.
    pub fn overload(&self, overload: Overload) {
        let Overload { starvation_flushes, planning_slowdowns, underruns, made_up_updates, refused_entries } = overload;
        self.0.borrow_mut().lock(|writer| {
            writer.line(format_args!(
                "echo:overload starvation_flushes:{starvation_flushes} planning_slowdowns:{planning_slowdowns} \
                 underruns:{underruns} made_up_updates:{made_up_updates} refused_entries:{refused_entries}"
            ));
        });
    }
}

impl<W: Mutex<T = Writer>> Replies for BoardReplies<W> {
    fn send(&self, reply: Reply<'_>) {
        self.0.borrow_mut().lock(|writer| writer.line(reply));
    }
}
