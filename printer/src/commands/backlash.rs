//! M425: backlash of the drives.

use ferrostep_gcode::{BacklashWords, Decimal, Real};
use ferrostep_planner::backlash::Backlash;

use crate::error::CommandError;
use crate::motion::axis_names::AXIS_NAMES;
use crate::part::Part;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::in_range;

/// Units of 10 nm in a millimetre.
const MM: f64 = 100_000.0;

impl<P: Ports> Printer<'_, P> {
    /// Returns true if the machine can compensate backlash.
    pub(crate) const fn has_backlash(&self) -> bool {
        <P::Motion as Motion>::Backlash::PRESENT && self.profile.backlash.is_some()
    }

    /// Executes M425, at standstill. The motors do not move.
    #[inline(never)]
    pub(crate) fn backlash(&mut self, words: &BacklashWords) -> Result<(), CommandError> {
        if !self.has_backlash() {
            return Ok(());
        }
        let mut backlash = self.motion.backlash();
        if *words == BacklashWords::default() {
            let [x, y, z] = backlash.play_mm.map(|mm| Real::short(mm, 4));
            let [part, way] = [backlash.correction, backlash.smoothing_mm].map(|number| Real::fixed(number, 2));
            self.replies.say(format_args!("echo:  M425 F{part} S{way} X{x} Y{y} Z{z} ; (mm)"));
            return Ok(());
        }
        for (axis, (place, word)) in backlash.play_mm.iter_mut().zip(words.play).enumerate() {
            if let Some(word) = word {
                *place = in_range(AXIS_NAMES[axis], self.length_mm(word)?, 0.0, Backlash::MAX_MM)?;
            }
        }
        if let Some(word) = words.correction {
            backlash.correction = in_range('F', word.to_f64(), 0.0, 1.0)?;
        }
        if let Some(word) = words.smoothing {
            backlash.smoothing_mm = in_range('S', self.length_mm(word)?, 0.0, Backlash::MAX_SMOOTHING_MM)?;
        }
        if let Some(axis) = backlash.shared_axis(self.profile.kinematics) {
            return Err(CommandError::SharedPlay { axis });
        }
        self.motion.set_backlash(&backlash);
        Ok(())
    }

    /// Length of a word, mm.
    fn length_mm(&self, word: Decimal) -> Result<f64, CommandError> {
        let length_10nm = self.interpreter.modal.length_10nm(word).ok_or(CommandError::TooFar)?;
        Ok(length_10nm as f64 / MM)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
