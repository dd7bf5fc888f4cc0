//! Text of a plan's fault.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_planner::Speed;
use ferrostep_planner::look_ahead::PlanFault;

/// Text of a plan's fault, with its figures and the cure.
pub(crate) struct PlanFaultText<'a>(pub &'a PlanFault);

impl fmt::Display for PlanFaultText<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mm_per_s = |speed: Speed| Real::fixed(speed.mm_per_s(), 1);
        match *self.0 {
            PlanFault::TooFast { planned, maximum } => write!(
                out,
                "the planned speed is too high: {} mm/s, where corner and feeds allow {} mm/s; prepare the job again for this machine",
                mm_per_s(planned),
                mm_per_s(maximum)
            ),
            PlanFault::TooSlow { planned, minimum } => write!(
                out,
                "the planned speed is too low: {} mm/s, where the move before slows down to {} mm/s at best; prepare the job again \
                 for this machine",
                mm_per_s(planned),
                mm_per_s(minimum)
            ),
            PlanFault::BeyondLimits => out.write_str(
                "the job asks for more speed or acceleration than an axis of this machine allows: prepare it again with this \
                 machine's profile",
            ),
            PlanFault::NotContinued => out.write_str(
                "the job joins this move to the one before, but direction, speed or acceleration change between them: \
                 prepare the job again for this machine",
            ),
            PlanFault::NotTrapezoid(acceleration) => write!(
                out,
                "prepared jobs need trapezoids, but the machine is set to {}: send M796 A0, then start the job again",
                acceleration.name()
            ),
        }
    }
}
