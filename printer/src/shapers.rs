//! M593 and SET_INPUT_SHAPER: the filters of X and Y.

use core::fmt;

use ferrostep_gcode::{Real, Reply, ShaperState, ShaperWords, ShortText};
use ferrostep_planner::{AxisShaper, ChoiceError, ShaperError, ShaperKind};

use crate::axis_names::AXIS_NAMES;
use crate::error::CommandError;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;

/// What RepRapFirmware calls two and three humps.
const OTHER_NAMES: [(&str, ShaperKind); 2] = [("ei2", ShaperKind::TwoHumpEi), ("ei3", ShaperKind::ThreeHumpEi)];

/// The kind of this name, in upper or lower case.
fn kind_of(name: &str) -> Result<ShaperKind, CommandError> {
    let names = ShaperKind::ALL.map(|kind| (kind.name(), kind)).into_iter().chain(OTHER_NAMES);
    let mut found = names.filter(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, kind)| kind);
    found.next().ok_or_else(|| CommandError::UnknownShaper(ShortText::new(name)))
}

/// What becomes of an axis's filter; `usual` is the kind where it has none and gets a frequency.
fn changed(
    axis: u8,
    present: AxisShaper,
    words: &ShaperWords<'_>,
    usual: ShaperKind,
) -> Result<AxisShaper, CommandError> {
    let mut shaper = present;
    if let Some(damping) = words.damping {
        shaper.damping = damping.to_f64();
    }
    if let Some(name) = words.kind {
        shaper.kind = kind_of(name)?;
    }
    match words.frequency {
        Some(frequency) if frequency.nanos() == 0 => shaper.kind = ShaperKind::None,
        Some(frequency) => {
            shaper.frequency_hz = frequency.to_f64();
            if words.kind.is_none() && shaper.kind == ShaperKind::None {
                shaper.kind = usual;
            }
        }
        None => {}
    }
    // The numbers of an axis without a filter are those of its next one.
    let checked = AxisShaper { kind: if shaper.kind == ShaperKind::None { usual } else { shaper.kind }, ..shaper };
    match checked.kernel() {
        Ok(_) => Ok(shaper),
        Err(ShaperError::TooLong { .. }) if shaper.kind == ShaperKind::None => Ok(shaper),
        Err(error) => Err(CommandError::Shaper(ShaperRefusal { axis, error, shaper: checked })),
    }
}

impl<P: Ports> Printer<'_, P> {
    /// M593, SET_INPUT_SHAPER. The machine stands still before its filters change, and they change together.
    pub(crate) async fn shape(&mut self, axes: &[ShaperWords<'_>; 2], usual: &str) -> Result<(), CommandError> {
        let mut choice = self.motion.motion_choice();
        if *axes == [ShaperWords::default(); 2] {
            let state = |shaper: AxisShaper| ShaperState {
                kind: shaper.kind.name(),
                frequency_hz: shaper.frequency_hz,
                damping: shaper.damping,
            };
            self.replies.send(Reply::InputShaper(choice.shapers.map(state)));
            return Ok(());
        }
        let usual = kind_of(usual)?;
        for (axis, (shaper, words)) in (0..).zip(choice.shapers.iter_mut().zip(axes)) {
            *shaper = changed(axis, *shaper, words, usual)?;
        }
        self.set_motion_choice(&choice).await?.map_err(CommandError::Shaping)
    }
}

/// The names of filters that there are.
pub(crate) struct KnownShapers;

impl fmt::Display for KnownShapers {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for kind in ShaperKind::ALL {
            out.write_str(kind.name())?;
            out.write_str(", ")?;
        }
        out.write_str("ei2 (2hump_ei) or ei3 (3hump_ei) in M593 P or SHAPER_TYPE")
    }
}

/// Why a filter cannot be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaperRefusal {
    /// Index of the axis, 0 or 1.
    axis: u8,
    /// What is wrong with it.
    error: ShaperError,
    /// What was asked for.
    shaper: AxisShaper,
}

impl fmt::Display for ShaperRefusal {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = AXIS_NAMES.get(usize::from(self.axis)).copied().unwrap_or('?');
        write!(out, "input shaper of {axis}: ")?;
        match self.error {
            ShaperError::Frequency => self.write_frequency(out, axis),
            ShaperError::Damping => self.write_damping(out, axis),
            ShaperError::TooLong { lowest_hundredths_hz } => {
                self.write_too_long(out, axis, f64::from(lowest_hundredths_hz) / 100.0)
            }
            // Of the machine, whatever the filter.
            ShaperError::Methods | ShaperError::UnequalMotors => {
                out.write_str(choice_text(ChoiceError::Shaper(self.error)))
            }
        }
    }
}

/// One function for each text, so that not all their arguments are on the stack together.
impl ShaperRefusal {
    #[inline(never)]
    fn write_frequency(&self, out: &mut fmt::Formatter<'_>, axis: char) -> fmt::Result {
        let [lowest, highest] = AxisShaper::FREQUENCY_HZ.map(|limit| Real::short(limit, 6));
        write!(
            out,
            "{} Hz is out of range, expected {lowest} to {highest} Hz",
            Real::short(self.shaper.frequency_hz, 6)
        )?;
        write!(out, ", or 0 for none (M593 F, SHAPER_FREQ_{axis})")
    }

    #[inline(never)]
    fn write_damping(&self, out: &mut fmt::Formatter<'_>, axis: char) -> fmt::Result {
        let AxisShaper { kind, damping, .. } = self.shaper;
        let [damping, most] = [damping, kind.max_damping()].map(|ratio| Real::short(ratio, 6));
        write!(out, "a damping ratio of {damping} is out of range, expected 0 to {most} for {}", kind.name())?;
        write!(out, " (M593 D or S, DAMPING_RATIO_{axis})")
    }

    #[inline(never)]
    fn write_too_long(&self, out: &mut fmt::Formatter<'_>, axis: char, lowest_hz: f64) -> fmt::Result {
        let AxisShaper { kind, frequency_hz, damping } = self.shaper;
        write!(out, "{} for {} Hz", kind.name(), Real::short(frequency_hz, 6))?;
        write!(out, " and a damping ratio of {} is longer than 100 ms", Real::short(damping, 6))?;
        write!(out, ", expected at least {} Hz", Real::short(lowest_hz, 6))?;
        write!(out, " (M593 F, SHAPER_FREQ_{axis}) or a shorter kind")
    }
}

/// Why a machine has no filters at all now.
pub(crate) const fn choice_text(error: ChoiceError) -> &'static str {
    match error {
        ChoiceError::Shaper(ShaperError::UnequalMotors) => {
            "input shapers and pressure advance need the same steps/mm of the motors that move an axis together, expected that of the profile"
        }
        ChoiceError::InMotion => "input shapers and pressure advance change at standstill only, expected M400 before",
        ChoiceError::Shaper(
            ShaperError::Methods | ShaperError::Frequency | ShaperError::Damping | ShaperError::TooLong { .. },
        )
        | ChoiceError::NotContained
        | ChoiceError::Parameter
        | ChoiceError::PressureAdvance(_) => {
            "input shapers and pressure advance need step-bresenham with trapezoid or s-curve, expected M796 I0 A0 before"
        }
    }
}

#[cfg(test)]
mod tests;
