//! The motion of a session, as traits.

use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

use ferrostep_printer::machine::PushedFilament;
use ferrostep_printer::{FanDemand, Motion, Signals};

use super::figures::Figures;
use super::line_ends::LineEnds;
use crate::limit_shares::RulesReport;
use crate::rules::Refusals;

/// The state of planner and motors, independent of how time passes.
pub trait MotionState {
    /// The motion clock: ticks of all motion so far. It stops between motions.
    fn tick(&self) -> u64;
    /// Stops motion at once.
    fn stop(&self);
    /// Demand on the fans at the present point of the motion.
    fn fan_demand(&self) -> FanDemand;
    /// Mask of the motors that have current.
    fn enabled_motors(&self) -> u8;
    /// Plans block by block, for comparison: see
    /// [`ferrostep_planner::Planner::plan_block_by_block`].
    fn plan_block_by_block(&self) -> bool;
    /// The counts so far, without the print's time.
    fn figures(&self) -> Figures;
}

/// State of the extruder at present.
#[derive(Clone, Copy, Debug)]
pub struct ExtruderNow {
    /// Position of its motor, steps.
    pub steps: i64,
    /// Filament it has pushed, as the printer knows it.
    pub pushed: PushedFilament,
    /// Steps in a millimetre of filament.
    pub steps_per_mm: f64,
}

/// Motion of a session, in virtual time.
pub trait Desk {
    /// The motion, as commands see it.
    type Motion<'a>: Motion
    where
        Self: 'a;

    /// Planner and motors.
    type State: MotionState;

    /// True if it makes every step. Otherwise it is an estimate, whose cost must not grow with
    /// the print's time.
    const MAKES_STEPS: bool;

    /// The motion, as commands see it; a halt ends their waits.
    fn motion<'a>(&'a self, signals: &'a Signals) -> Self::Motion<'a>;
    /// Advances time until something changes, or for a while, if a command waits for motion.
    fn pass_motion(&self);
    /// A command waits for a moment: lets time pass up to it.
    fn wait_until(&self, wake_ns: u64);
    /// Virtual time since the machine was switched on.
    fn now_ns(&self) -> u64;
    /// Returns the extruder's present state; `None` where time leaps, so that no sensor
    /// could follow it.
    fn extruder_now(&self) -> Option<ExtruderNow> {
        None
    }
    /// Returns what another firmware's rules made of the motion; `None` if this
    /// firmware has planned it.
    fn rules(&self) -> Option<RulesReport> {
        None
    }
    /// Returns the commands that another firmware does not have or refuses, if the job is
    /// planned by its rules.
    fn refusals(&self) -> Option<Rc<Refusals>> {
        None
    }
    /// Notes from now on where the motion of each source line ends; `false` if the desk does not
    /// know it.
    fn follow_lines(&self, _ends: Rc<LineEnds>) -> bool {
        false
    }
    /// Planner and motors.
    fn state(&self) -> &Self::State;
}

/// Returns to the session once, so that it lets time pass.
pub(crate) async fn let_time_pass() {
    let mut is_first = true;
    poll_fn(|_| if std::mem::take(&mut is_first) { Poll::Pending } else { Poll::Ready(()) }).await;
}
