//! M900 and M572: how far the extruder runs ahead of the flow.

use super::code::Code;
use super::words::{Strays, Words};
use crate::remarks::{Remark, Remarks};
use crate::{AdvanceWords, Command, Decimal, ParseError};

/// M900 K, as Marlin has it. S and L, its second number to switch to, mean nothing here.
pub(super) fn linear_advance<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    // Some profiles of slicers write K=0.05.
    let (text, after) = match code.rest.split_once('=') {
        Some((text, after)) if text.ends_with(['K', 'k']) => (text.trim_end_matches(['K', 'k']), Some(after)),
        _ => (code.rest, None),
    };
    let mut words = Words::new(remarks);
    words.read(text, Strays::Remarked)?;
    let number = after.map(|after| Decimal::parse_prefix(after.as_bytes()));
    if let (Some(after), Some((length, _))) = (after, number) {
        words.read(after.get(length..).unwrap_or_default(), Strays::Remarked)?;
    }
    if words.names_other_tool() {
        return Ok(Command::Accepted);
    }
    // K0 L0: neither is wanted.
    words.needless_zero(b'L');
    let form = "K with a number";
    let slow = match number {
        Some((_, Ok(number))) => Some(number),
        Some((_, Err(_))) => return Err(ParseError::WordsExpected { command: "M900", words: form }),
        None => required(&mut words, b'K', "M900", form)?,
    };
    Ok(Command::PressureAdvance(AdvanceWords { slow, ..AdvanceWords::default() }))
}

/// M572 S, as RepRapFirmware has it (D is the extruder), W, the time over which it is averaged, as Prusa's firmware has it; L and T
/// are another K for the flow beyond a speed.
pub(super) fn parse<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    const FORM: &str = "S with a number, and with L also T";
    let mut words = code.words(remarks)?;
    if words.is_not_zero(b'D') {
        words.forgive();
        words.remark(Remark::OtherTool);
        return Ok(Command::Accepted);
    }
    let slow = required(&mut words, b'S', "M572", FORM)?;
    let fast = required(&mut words, b'L', "M572", FORM)?;
    let speed = required(&mut words, b'T', "M572", FORM)?;
    let smooth_time = required(&mut words, b'W', "M572", "W with a number")?;
    if fast.is_some() != speed.is_some() || (fast.is_some() && slow.is_none()) {
        return Err(ParseError::WordsExpected { command: "M572", words: FORM });
    }
    Ok(Command::PressureAdvance(AdvanceWords { slow, fast, speed, smooth_time }))
}

/// The number of a word that must have one: without it the line would be taken for a question.
fn required(
    words: &mut Words<'_>,
    letter: u8,
    command: &'static str,
    form: &'static str,
) -> Result<Option<Decimal>, ParseError> {
    match words.value(letter) {
        None if words.has(letter) => Err(ParseError::WordsExpected { command, words: form }),
        value => Ok(value),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{reads, reads_with, refused, some};
    use super::*;

    fn advance(slow: &str, fast: &str, speed: &str, smooth_time: &str) -> Command<'static> {
        let [slow, fast, speed, smooth_time] =
            [slow, fast, speed, smooth_time].map(|text| if text.is_empty() { None } else { some(text) });
        Command::PressureAdvance(AdvanceWords { slow, fast, speed, smooth_time })
    }

    #[test]
    fn marlins_repraps_prusas_and_klippers_words() {
        reads("M900 K0.05", advance("0.05", "", "", ""));
        reads("M900 K=0", advance("0", "", "", ""));
        reads("M900 k=.05 T0 ; filament", advance("0.05", "", "", ""));
        reads("M900 T0 K.05 ; filament", advance("0.05", "", "", ""));
        reads("M900 K0 L0", advance("0", "", "", ""));
        reads_with("M900 K0.05 L0.1", advance("0.05", "", "", ""), "L has no effect");
        reads("M572 D0 S0.04", advance("0.04", "", "", ""));
        reads("M572 S0.036 W0.02", advance("0.036", "", "", "0.02"));
        reads("M572 S0.05 L0.02 T3", advance("0.05", "0.02", "3", ""));
        reads("SET_PRESSURE_ADVANCE ADVANCE=0.05", advance("0.05", "", "", ""));
        reads("set_pressure_advance extruder=extruder advance=.05 smooth_time=0.03", advance("0.05", "", "", "0.03"));
        for query in ["M900", "M572", "M572 D0", "SET_PRESSURE_ADVANCE", "SET_PRESSURE_ADVANCE EXTRUDER=extruder"] {
            reads(query, advance("", "", "", ""));
        }
    }

    #[test]
    fn another_extruders_advance_has_no_effect() {
        let one = "T: this machine has one extruder, 0; no effect";
        reads_with("M900 T1 K0.05", Command::Accepted, one);
        reads_with("M572 D1 S0.05", Command::Accepted, one);
        reads_with("SET_PRESSURE_ADVANCE EXTRUDER=extruder1 ADVANCE=0.05", Command::Accepted, one);
    }

    #[test]
    fn a_word_without_its_number_or_its_companion_is_refused() {
        for text in ["M900 K", "M900 K=", "M900 K=x"] {
            assert!(refused(text).contains("K with a number"), "{text}");
        }
        for text in ["M572 S", "M572 S0.05 L0.02", "M572 S0.05 T3", "M572 L0.02 T3"] {
            assert!(refused(text).contains("S with a number, and with L also T"), "{text}");
        }
        for text in ["SET_PRESSURE_ADVANCE ADVANCE", "SET_PRESSURE_ADVANCE ADVANCE=x", "SET_PRESSURE_ADVANCE K=0.05"] {
            assert!(refused(text).contains("ADVANCE or SMOOTH_TIME with a number"), "{text}");
        }
    }
}
