//! The machine with the desk's step queue: one for all desks that make steps.

use std::cell::RefCell;
use std::rc::Rc;

use ferrostep_papers::Papers;
use ferrostep_planner::StepDigests;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::machine::{Machine, Silence};
use ferrostep_printer::{FanDemand, Profile};

use super::drivers::DeskDrivers;
use super::figures::{Figures, seconds};
use super::session_motion::MotionState;
use super::step_queue::VirtualStepQueue;
use super::z_motors::DeskZMotors;
use crate::record::AnyObserver;

/// Planner, step queue and motors.
pub type QueueMachine = Machine<Vec<Slot>, VirtualStepQueue, Papers>;

/// A machine that has just been switched on, with this many blocks in its look-ahead ring.
pub(super) fn machine(
    profile: &Profile,
    look_ahead: usize,
    drivers: Rc<DeskDrivers>,
    observer: AnyObserver,
) -> RefCell<QueueMachine> {
    let mut motors = profile.virtual_motors();
    motors.set_framed(profile.framed_axes());
    let queue = VirtualStepQueue::new(motors, DeskZMotors::new(profile), drivers, observer);
    let mut machine = Machine::new(profile, vec![Slot::EMPTY; look_ahead], queue);
    // A choice that the profile cannot have was refused when it was read.
    machine.set_motion_choice(&profile.motion).ok();
    if let Some(backlash) = &profile.backlash {
        machine.set_backlash(backlash);
    }
    RefCell::new(machine)
}

impl MotionState for RefCell<QueueMachine> {
    fn tick(&self) -> u64 {
        self.borrow().queue().motors().ledger.tick()
    }

    fn stop(&self) {
        let mut machine = self.borrow_mut();
        machine.request_stop();
        machine.work(Silence::default());
    }

    fn fan_demand(&self) -> FanDemand {
        self.borrow().fan_demand()
    }

    fn enabled_motors(&self) -> u8 {
        self.borrow().enabled_motors()
    }

    fn plan_block_by_block(&self) -> bool {
        self.borrow_mut().plan_block_by_block()
    }

    fn figures(&self) -> Figures {
        let machine = self.borrow();
        let (figures, queue) = (machine.figures(), machine.queue());
        Figures {
            print_time_s: 0.0,
            motion_time_s: seconds(machine.motion_ticks()),
            motor_steps: figures.issued_steps,
            max_event_rate_hz: queue.max_event_rate_hz(),
            underruns: figures.underruns,
            starvation_flushes: figures.starvation_flushes,
            slowed_moves: figures.slowed_moves,
            merged_moves: figures.merged_moves,
            digests: StepDigests { order: figures.order_digest, step: figures.step_digest },
        }
    }
}
