//! M92: extruder steps per mm of filament.
//!
//! The steps of X, Y and Z are the profile's: the plan of a job depends on them. The extruder's are
//! measured anew for every drive gear, and M500 stores them.

use ferrostep_gcode::{AxisWords, Real};
use ferrostep_planner::StepsPerMm;

use crate::error::CommandError;
use crate::motion::axis_names::AXIS_NAMES;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;

/// Maximum relative deviation of the extruder's steps from the profile's. A larger one belongs to
/// another machine, gear or microstep setting, as in start code that a slicer writes for many
/// machines.
const FARTHEST: f64 = 0.25;

/// Steps per mm in the form of reports.
fn shown(steps_per_mm: StepsPerMm) -> Real {
    Real::fixed(steps_per_mm.to_f64(), 2)
}

/// Returns true if an extruder can have these steps at its fastest feed: no motor may step faster
/// than the minimum event interval.
fn fits(steps_per_mm: f64, max_feed_mm_per_s: f64, minimum_interval_ticks: u32) -> bool {
    steps_per_mm * max_feed_mm_per_s * f64::from(minimum_interval_ticks)
        <= f64::from(ferrostep_planner::TICKS_PER_SECOND)
}

impl<P: Ports> Printer<'_, P> {
    /// Reports the steps for M92 without words.
    #[inline(never)]
    pub(crate) fn report_steps_per_mm(&self) {
        let [x, y, z, _] = self.profile.steps_per_mm.map(shown);
        let e = shown(self.motion.extruder_steps_per_mm());
        self.replies.say(format_args!("echo:  M92 X{x} Y{y} Z{z} E{e} ; (steps/mm)"));
    }

    /// Executes M92, at standstill. Values that cannot be set are named, and the old ones stay.
    #[inline(never)]
    pub(crate) fn set_steps_per_mm(&mut self, tool: Option<u8>, words: &AxisWords) -> Result<(), CommandError> {
        let of_profile = self.profile.steps_per_mm;
        for ((word, of_profile), name) in [words.x, words.y, words.z].into_iter().zip(of_profile).zip(AXIS_NAMES) {
            if word.is_some_and(|word| StepsPerMm::nearest(word.to_f64()) != of_profile) {
                let steps = shown(of_profile);
                self.replies.say(format_args!("echo:M92: {name} stays at the profile's steps_per_mm, {steps}"));
            }
        }
        let Some(asked) = words.e.map(|word| word.to_f64()) else { return Ok(()) };
        let of_tool = self.steps_of_profile(tool);
        if self.are_steps_near(of_tool, asked) {
            if let Some(resting) = self.resting_tool(tool)? {
                resting.steps_per_mm = StepsPerMm::nearest(asked);
                return Ok(());
            }
            return self.set_extruder_steps(StepsPerMm::nearest(asked));
        }
        let [now, of_profile] = [self.motion.extruder_steps_per_mm(), of_tool].map(shown);
        self.replies.say(format_args!(
            "echo:M92: E stays at {now}: expected what is within a quarter of the profile's {of_profile}, and at E's largest feed (M203) no \
             faster than its motor may step"
        ));
        Ok(())
    }

    /// Returns true if the extruder of a tool may have these steps.
    pub(crate) fn are_extruder_steps(&self, tool: u8, steps_per_mm: f64) -> bool {
        self.are_steps_near(self.steps_of_profile(Some(tool)), steps_per_mm)
    }

    fn are_steps_near(&self, of_profile: StepsPerMm, steps_per_mm: f64) -> bool {
        let of_profile = of_profile.to_f64();
        let is_near = (steps_per_mm - of_profile).abs() <= FARTHEST * of_profile;
        let [.., max_feed_mm_per_s] = self.motion.limits().max_feed_mm_per_s;
        // Values that the profile itself allows are always accepted.
        is_near
            && (steps_per_mm <= of_profile
                || fits(steps_per_mm, max_feed_mm_per_s, self.profile.minimum_event_interval_ticks))
    }

    /// Returns true if M92 with these words changes the extruder's steps.
    pub fn changes_extruder_steps(&self, tool: Option<u8>, words: &AxisWords) -> bool {
        let asked = words.e.map(|steps_per_mm| steps_per_mm.to_f64());
        tool.unwrap_or(0) == 0
            && asked.is_some_and(|steps_per_mm| {
                self.are_extruder_steps(self.selected_tool(), steps_per_mm)
                    && StepsPerMm::nearest(steps_per_mm) != self.motion.extruder_steps_per_mm()
            })
    }

    /// Sets the extruder's steps, at standstill. A prepared job is planned with the profile's.
    fn set_extruder_steps(&mut self, steps_per_mm: StepsPerMm) -> Result<(), CommandError> {
        if self.interpreter.modal.in_prepared_job && steps_per_mm != self.profile.steps_per_mm[3] {
            return Err(CommandError::StepsAndJob);
        }
        self.motion.set_extruder_steps_per_mm(steps_per_mm).map_err(CommandError::MotionChoice)
    }

    /// Refuses a prepared job if the extruder's steps differ from those it is planned with.
    pub(crate) fn needs_profiles_steps(&self) -> Result<(), CommandError> {
        self.needs_first_tool()?;
        if self.motion.extruder_steps_per_mm() == self.profile.steps_per_mm[3] {
            Ok(())
        } else {
            Err(CommandError::StepsAndJob)
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use ferrostep_planner::StepsPerMm;

    use crate::error::{CommandError, Failure};
    use crate::motion::homing::tests::rig::{Rig, RigPrinter, execute};
    use crate::ports::Motion as _;

    const PROFILES: f64 = 100.0;

    fn rig() -> Rig {
        Rig::new(|profile| {
            profile.steps_per_mm = profile.steps_per_mm.map(|_| StepsPerMm::nearest(PROFILES));
            profile.limits.max_feed_mm_per_s = [50.0; 4];
            profile.minimum_event_interval_ticks = 100;
        })
    }

    fn steps(printer: &RigPrinter<'_>) -> f64 {
        printer.motion.extruder_steps_per_mm().to_f64()
    }

    #[test]
    fn the_extruders_steps_are_set_and_reported() {
        let rig = rig();
        let mut printer = rig.printer();
        for (line, expected) in [("M92 E104.57", 104.57), ("M92 X100 Y100 Z100 E125", 125.0), ("M92 E75", 75.0)] {
            execute(&mut printer, line).unwrap();
            assert_eq!((steps(&printer), rig.last_texts()), (expected, vec![]), "{line}");
        }
        execute(&mut printer, "M92").unwrap();
        assert_eq!(rig.last_texts(), ["echo:  M92 X100.00 Y100.00 Z100.00 E75.00 ; (steps/mm)"]);
    }

    #[test]
    fn those_of_another_machine_are_named_and_stay_out() {
        let rig = rig();
        let mut printer = rig.printer();
        for line in ["M92 E125.1", "M92 E74.9", "M92 E420", "M92 E0.00001", "M92 E99999999"] {
            execute(&mut printer, line).unwrap();
            let said = rig.last_texts().concat();
            assert!(said.contains("within a quarter of the profile's 100.00"), "{line}: {said}");
            assert_eq!(steps(&printer), PROFILES);
        }
        execute(&mut printer, "M92 X81 Z100 E101").unwrap();
        assert_eq!(rig.last_texts(), ["echo:M92: X stays at the profile's steps_per_mm, 100.00"]);
        assert_eq!(steps(&printer), 101.0);
    }

    #[test]
    fn a_motor_is_not_asked_for_more_than_its_step_rate() {
        let rig = Rig::new(|profile| {
            profile.steps_per_mm = profile.steps_per_mm.map(|_| StepsPerMm::nearest(PROFILES));
            profile.minimum_event_interval_ticks = ferrostep_planner::TICKS_PER_SECOND / (105 * 200);
            profile.limits.max_feed_mm_per_s = [200.0; 4];
        });
        let mut printer = rig.printer();
        execute(&mut printer, "M92 E105").unwrap();
        assert_eq!(steps(&printer), 105.0);
        execute(&mut printer, "M92 E106").unwrap();
        assert!(rig.last_texts().concat().contains("no faster than its motor may step"));
        assert_eq!(steps(&printer), 105.0);
    }

    #[test]
    fn a_prepared_job_has_the_profiles() {
        let rig = rig();
        let mut printer = rig.printer();
        printer.interpreter.modal.in_prepared_job = true;
        execute(&mut printer, "M92 E100").unwrap();
        let refused = execute(&mut printer, "M92 E101").unwrap_err();
        assert!(matches!(refused, Failure::Command(CommandError::StepsAndJob)), "{refused:?}");
        printer.interpreter.modal.in_prepared_job = false;
        execute(&mut printer, "M92 E101").unwrap();
        printer.set_receives_jobs();
        assert!(execute(&mut printer, "M790 S100").is_err());
        execute(&mut printer, "M92 E100").unwrap();
        execute(&mut printer, "M790 S100").unwrap();
    }
}
