//! The filament that the extruder has pushed, for those who watch it.

use ferrostep_hal_shim::StepOutput;
use ferrostep_planner::MotionMethods;
use ferrostep_planner::look_ahead::Slot;

use super::Machine;
use crate::motion::machine::pushed::PushedFilament;

impl<R: AsRef<[Slot]> + AsMut<[Slot]>, Q: StepOutput, M: MotionMethods> Machine<R, Q, M> {
    /// The new filament that the extruder has pushed up to now, of a queue that follows it
    /// ([`MotionWatch::FOLLOWS_FILAMENT`]): between two marks, which are a thirtieth of the motion
    /// in the queue apart, or a millisecond.
    ///
    /// [`MotionWatch::FOLLOWS_FILAMENT`]: ferrostep_hal_shim::MotionWatch::FOLLOWS_FILAMENT
    pub fn pushed_filament(&self) -> PushedFilament {
        self.feeder.pushed_filament()
    }
}
