//! M852 and SET_SKEW: axes that are not at right angles.

use core::num::NonZeroU32;

use ferrostep_gcode::{Decimal, Diagonals, Real, SkewCommand};

use crate::error::CommandError;
use crate::error::skew_refusal::SkewRefusal;
use crate::motion::skew::Skew;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;

/// The planes, in the order of the factors.
const PLANES: [&str; 3] = ["XY", "XZ", "YZ"];

/// Factor of a plane from measured lengths, if a machine may be that skew.
fn measured(plane: usize, lengths: &Diagonals) -> Result<f64, CommandError> {
    let Diagonals { ac_10nm, bd_10nm, ad_10nm } = *lengths;
    let factor = Skew::factor_of_diagonals([ac_10nm, bd_10nm, ad_10nm].map(NonZeroU32::get));
    within(plane, factor.unwrap_or(f32::INFINITY))
}

/// Factor of a plane, if a machine may be that skew.
#[inline(never)]
fn within(plane: usize, factor: f32) -> Result<f64, CommandError> {
    // NaN is in no range.
    if (-Skew::MAX_FACTOR..=Skew::MAX_FACTOR).contains(&factor) {
        return Ok(f64::from(factor));
    }
    let plane = PLANES.get(plane).copied().unwrap_or_default();
    Err(CommandError::TooSkew(SkewRefusal { plane, factor }))
}

impl<P: Ports> Printer<'_, P> {
    /// Executes M852 and its equivalents, at standstill if they change something. The motors do not
    /// move; the coordinates change.
    #[inline(never)]
    pub(crate) fn skew(&mut self, command: &SkewCommand) -> Result<(), CommandError> {
        let mut factors = self.interpreter.skew.factors();
        match *command {
            SkewCommand::Calculate(ref lengths) => {
                let factor = measured(0, lengths)?;
                return self.say_skew("Calculated", factor);
            }
            SkewCommand::Report => {
                return PLANES.into_iter().zip(factors).try_for_each(|(plane, factor)| self.say_skew(plane, factor));
            }
            SkewCommand::Factors([None, None, None]) => {
                let [xy, xz, yz] = factors.map(|factor| Real::fixed(factor, 6));
                self.replies.say(format_args!("echo:  M852 I{xy} J{xz} K{yz} ; XY, XZ, YZ"));
                return Ok(());
            }
            SkewCommand::Clear => factors = [0.0; 3],
            SkewCommand::Factors(words) => {
                for (plane, (factor, word)) in factors.iter_mut().zip(words).enumerate() {
                    *factor = word.map(Decimal::to_f64).map_or(Ok(*factor), |factor| within(plane, factor as f32))?;
                }
            }
            SkewCommand::Measured(ref planes) => {
                for (plane, (factor, lengths)) in factors.iter_mut().zip(planes).enumerate() {
                    *factor = lengths.as_ref().map_or(Ok(*factor), |lengths| measured(plane, lengths))?;
                }
            }
        }
        if self.interpreter.modal.in_prepared_job && factors != [0.0; 3] {
            return Err(CommandError::SkewAndJob);
        }
        self.set_skew(Skew::of_factors(factors));
        Ok(())
    }

    fn say_skew(&self, what: &str, factor: f64) -> Result<(), CommandError> {
        // Klipper also takes the tangent for the angle.
        let (radians, degrees) = (Real::fixed(factor, 6), Real::fixed(f64::from((factor as f32).to_degrees()), 2));
        self.replies.say(format_args!("echo:{what} Skew: {radians} radians, {degrees} degrees"));
        Ok(())
    }

    /// Sets the skew, at standstill: the motors do not move, and the G-code's position becomes
    /// theirs.
    pub(crate) fn set_skew(&mut self, skew: Skew) {
        if skew != self.interpreter.skew {
            self.interpreter.skew = skew;
            self.interpreter.follow_plane(self.motion.position_10nm());
        }
    }

    /// Returns true if the axes are not at right angles.
    pub fn is_skew(&self) -> bool {
        self.interpreter.skew != Skew::NONE
    }

    /// Refuses a prepared job, whose moves are planned for axes at right angles.
    #[inline]
    pub(crate) fn needs_right_angles(&self) -> Result<(), CommandError> {
        if self.is_skew() { Err(CommandError::SkewAndJob) } else { Ok(()) }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
