//! M900, M572 and SET_PRESSURE_ADVANCE: the lead of the extruder over the flow.

use ferrostep_gcode::{AdvanceState, AdvanceWords, Decimal, Reply};
use ferrostep_planner::{MotionChoice, PressureAdvance, SecondSlope};

use crate::error::CommandError;
use crate::error::advance_refusal::AdvanceRefusal;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;

/// Filament of 1.75 mm in a line of 0.45 x 0.2 mm, mm per mm.
const FILAMENT_IN_COMMON_LINE: f64 = 0.0374;

/// The advance that a command asks for.
fn changed(present: PressureAdvance, words: &AdvanceWords) -> PressureAdvance {
    let number = |word: Option<Decimal>| word.map(Decimal::to_f64);
    let smooth_time_s = number(words.smooth_time).or(present.smooth_time_s);
    let Some(seconds) = number(words.slow) else { return PressureAdvance { smooth_time_s, ..present } };
    let above = match (number(words.speed), number(words.fast)) {
        (Some(filament_mm_per_s), Some(seconds)) => Some(SecondSlope { filament_mm_per_s, seconds }),
        _ => None,
    };
    PressureAdvance { seconds, above, smooth_time_s }
}

impl<P: Ports> Printer<'_, P> {
    /// Changes the advance. An existing advance changes at its place among the moves; a new one, or
    /// another averaging time, needs a standstill first.
    pub(crate) async fn advance(&mut self, tool: Option<u8>, words: &AdvanceWords) -> Result<(), CommandError> {
        if self.advance_of_resting(tool, words)? {
            return Ok(());
        }
        let mut choice = self.motion.motion_choice();
        if *words == AdvanceWords::default() {
            self.report_advance(&choice.pressure_advance);
            return Ok(());
        }
        let advance = changed(choice.pressure_advance, words);
        advance.check().map_err(|error| CommandError::Advance(AdvanceRefusal::new(error, &advance)))?;
        if advance == choice.pressure_advance {
            return Ok(());
        }
        choice.pressure_advance = advance;
        if !self.motion.set_pressure_advance(&advance).await? {
            self.set_motion_choice(&choice).await?.map_err(CommandError::Shaping)?;
        }
        let limits = self.motion.limits();
        let followed = choice.followed_filament_acceleration_mm_per_s2(&limits);
        let acceleration_mm_per_s2 = followed.map(|followed| followed / FILAMENT_IN_COMMON_LINE);
        if let Some(acceleration_mm_per_s2) = acceleration_mm_per_s2
            && acceleration_mm_per_s2 < limits.print_acceleration_mm_per_s2
        {
            self.replies.send(Reply::AdvanceLimits { acceleration_mm_per_s2 });
        }
        Ok(())
    }

    fn report_advance(&self, advance: &PressureAdvance) {
        let PressureAdvance { seconds, above, smooth_time_s } = *advance;
        let above = above.map(|above| (above.seconds, above.filament_mm_per_s));
        self.replies.send(Reply::PressureAdvance(AdvanceState { seconds, above, smooth_time_s }));
    }

    /// Changes the advance of a tool that is not selected; `false` if the words concern the
    /// selected one.
    #[inline(never)]
    fn advance_of_resting(&mut self, tool: Option<u8>, words: &AdvanceWords) -> Result<bool, CommandError> {
        let Some(resting) = self.resting_tool(tool)? else { return Ok(false) };
        let advance = changed(resting.advance, words);
        if *words == AdvanceWords::default() {
            self.report_advance(&advance);
        } else {
            advance.check().map_err(|error| CommandError::Advance(AdvanceRefusal::new(error, &advance)))?;
            resting.advance = advance;
        }
        Ok(true)
    }

    /// Restores the profile's advance: a prepared job begins with the one under which its speeds
    /// were planned.
    pub(crate) async fn take_advance_of_profile(&mut self) -> Result<(), CommandError> {
        let pressure_advance = self.profile.motion.pressure_advance;
        let choice = self.motion.motion_choice();
        if choice.pressure_advance != pressure_advance {
            let choice = MotionChoice { pressure_advance, ..choice };
            self.set_motion_choice(&choice).await?.map_err(CommandError::Shaping)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
