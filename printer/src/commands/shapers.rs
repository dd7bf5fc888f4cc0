//! M593 and SET_INPUT_SHAPER: the input shapers of X and Y.

use core::fmt::Write as _;

use ferrostep_gcode::{Reply, ShaperState, ShaperWords, ShortText};
use ferrostep_planner::{AxisShaper, ShaperError, ShaperKind, smooth_ticks};

use crate::error::CommandError;
use crate::error::shaper_refusal::ShaperRefusal;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;

/// RepRapFirmware's names for two and three humps.
const OTHER_NAMES: [(&str, ShaperKind); 2] = [("ei2", ShaperKind::TwoHumpEi), ("ei3", ShaperKind::ThreeHumpEi)];

/// Shaper kind of this name, in upper or lower case.
fn kind_of(name: &str) -> Result<ShaperKind, CommandError> {
    let mut others =
        OTHER_NAMES.into_iter().filter(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, kind)| kind);
    let kind = ShaperKind::from_name(name).or_else(|| others.next());
    kind.ok_or_else(|| CommandError::UnknownShaper(ShortText::new(name)))
}

/// The name of a kind: at most `mzv(5,1.999)`.
fn name_of(kind: ShaperKind) -> heapless::String<12> {
    let mut name = heapless::String::new();
    // Every name fits.
    let _ = write!(name, "{kind}");
    name
}

/// The changed filter of an axis; `usual` is the kind that an axis without a filter gets together
/// with a frequency.
fn changed(
    axis: u8,
    present: AxisShaper,
    words: &ShaperWords<'_>,
    usual: ShaperKind,
    smooth_time_s: Option<f64>,
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
    // An axis without a filter keeps the numbers for its next one.
    let checked = AxisShaper { kind: if shaper.kind == ShaperKind::None { usual } else { shaper.kind }, ..shaper };
    match smooth_ticks(smooth_time_s).and_then(|ticks| checked.kernel_beside(ticks)) {
        Ok(_) => Ok(shaper),
        Err(ShaperError::TooLong { .. }) if shaper.kind == ShaperKind::None => Ok(shaper),
        Err(error) => Err(CommandError::Shaper(ShaperRefusal { axis, error, shaper: checked })),
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Executes M593 and SET_INPUT_SHAPER. The machine stops before its filters change, and they
    /// change together.
    pub(crate) async fn shape(&mut self, axes: &[ShaperWords<'_>; 2], usual: &str) -> Result<(), CommandError> {
        let mut choice = self.motion.motion_choice();
        if *axes == [ShaperWords::default(); 2] {
            let kinds = choice.shapers.map(|shaper| name_of(shaper.kind));
            let [x, y] = &choice.shapers;
            let [kind_x, kind_y] = &kinds;
            self.replies.send(Reply::InputShaper([(kind_x, x), (kind_y, y)].map(|(kind, shaper)| ShaperState {
                kind,
                frequency_hz: shaper.frequency_hz,
                damping: shaper.damping,
            })));
            return Ok(());
        }
        let usual = kind_of(usual)?;
        for (axis, (shaper, words)) in (0..).zip(choice.shapers.iter_mut().zip(axes)) {
            *shaper = changed(axis, *shaper, words, usual, choice.smooth_time_s)?;
        }
        self.set_motion_choice(&choice).await?.map_err(CommandError::Shaping)
    }
}

#[cfg(test)]
mod tests;
