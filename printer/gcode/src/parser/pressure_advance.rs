//! M900 and M572: how far the extruder runs ahead of the flow.

use super::code::Code;
use super::words::{Strays, Words};
use crate::remarks::Remark;
use crate::{AdvanceWords, Command, Decimal, ParseError};

/// The words of one of the two commands.
pub(super) struct Form {
    command: &'static str,
    /// The word that names the extruder.
    tool: u8,
    /// The word of the advance.
    slow: u8,
    expected: &'static str,
}

/// M900 K, as Marlin has it. S and L, its second number to switch to, mean nothing here. Some
/// profiles of slicers write K=0.05.
pub(super) const M900: Form = Form { command: "M900", tool: b'T', slow: b'K', expected: "K with a number" };

/// M572 S, as RepRapFirmware has it (D is the extruder), W, the time over which it is averaged, as
/// Prusa's firmware has it; L and T are another K for the flow beyond a speed.
pub(super) const M572: Form =
    Form { command: "M572", tool: b'D', slow: b'S', expected: "S with a number, and with L also T" };

/// The largest K of M900, s. Linear Advance 1.0 counted in another unit: its K is 30 and more.
const MAX_K_NANOS: i64 = 2_000_000_000;

pub(super) fn parse<'a>(code: Code<'a>, words: &mut Words<'_>, form: &Form) -> Result<Command<'a>, ParseError> {
    let Form { command, tool, slow, expected } = *form;
    words.read(code.rest, Strays::Assigned)?;
    let number = words.tool(tool);
    let mut set = AdvanceWords { slow: required(words, slow, command, expected)?, ..AdvanceWords::default() };
    if tool == b'T' {
        // K0 L0: neither is wanted.
        words.needless_zero(b'L');
        if set.slow.is_some_and(|slow| !(0..=MAX_K_NANOS).contains(&slow.nanos())) {
            words.remark(Remark::OtherAdvance);
            return Ok(Command::Accepted);
        }
        return Ok(Command::PressureAdvance(number, set));
    }
    set.fast = required(words, b'L', command, expected)?;
    set.speed = required(words, b'T', command, expected)?;
    set.smooth_time = required(words, b'W', command, "W with a number")?;
    if set.fast.is_some() != set.speed.is_some() || (set.fast.is_some() && set.slow.is_none()) {
        return Err(ParseError::WordsExpected { command, words: expected });
    }
    Ok(Command::PressureAdvance(number, set))
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
        Command::PressureAdvance(None, AdvanceWords { slow, fast, speed, smooth_time })
    }

    #[test]
    fn marlins_repraps_prusas_and_klippers_words() {
        reads("M900 K0.05", advance("0.05", "", "", ""));
        reads("M900 K=0", advance("0", "", "", ""));
        reads("M900 k=.05 ; filament", advance("0.05", "", "", ""));
        reads("M900 K0 L0", advance("0", "", "", ""));
        reads_with("M900 K0.05 L0.1", advance("0.05", "", "", ""), "L has no effect");
        let says = "K: expected 0 to 2 s (Linear Advance 1.0 has other numbers); the advance stays";
        for text in ["M900 K30", "M900 K=45 T1", "M900 K2.001", "M900 K-0.1"] {
            reads_with(text, Command::Accepted, says);
        }
        reads("M900 K2", advance("2", "", "", ""));
        reads_with("M900 K45 L10 W0.4", Command::Accepted, &format!("L has no effect; W has no effect; {says}"));
        reads("M572 S30", advance("30", "", "", ""));
        reads("M572 S0.04", advance("0.04", "", "", ""));
        reads("M572 S0.036 W0.02", advance("0.036", "", "", "0.02"));
        reads("M572 S=0.05 L = .02 T=3", advance("0.05", ".02", "3", ""));
        reads("M572 S0.05 L0.02 T3", advance("0.05", "0.02", "3", ""));
        reads("SET_PRESSURE_ADVANCE ADVANCE=0.05", advance("0.05", "", "", ""));
        reads("set_pressure_advance advance=.05 smooth_time=0.03", advance("0.05", "", "", "0.03"));
        for query in ["M900", "M572", "SET_PRESSURE_ADVANCE"] {
            reads(query, advance("", "", "", ""));
        }
    }

    #[test]
    fn a_line_may_name_the_extruder() {
        let of =
            |tool| Command::PressureAdvance(Some(tool), AdvanceWords { slow: some("0.05"), ..AdvanceWords::default() });
        reads("M900 T1 K0.05", of(1));
        reads("M900 T0 K.05 ; filament", of(0));
        reads("M572 D1 S0.05", of(1));
        reads("SET_PRESSURE_ADVANCE EXTRUDER=extruder1 ADVANCE=0.05", of(1));
        reads("SET_PRESSURE_ADVANCE EXTRUDER=extruder ADVANCE=0.05", of(0));
        reads("SET_PRESSURE_ADVANCE EXTRUDER=extruder7 ADVANCE=0.05", of(255));
    }

    #[test]
    fn a_word_without_its_number_or_its_companion_is_refused() {
        for text in ["M900 K", "M900 K=", "M900 K=x", "M900 K=T0"] {
            assert!(refused(text).contains("K with a number"), "{text}");
        }
        for text in ["M572 S", "M572 S0.05 L0.02", "M572 S0.05 T3", "M572 L0.02 T3"] {
            assert!(refused(text).contains("S with a number, and with L also T"), "{text}");
        }
        for text in ["M900 K==0.05", "M900 =0.05", "M900 K0.05=", "M104 S=200", "G1 X=5"] {
            assert!(refused(text).contains("unexpected character '='"), "{text}: {}", refused(text));
        }
        for text in ["SET_PRESSURE_ADVANCE ADVANCE=", "SET_PRESSURE_ADVANCE ADVANCE=x", "SET_PRESSURE_ADVANCE K=0.05"] {
            assert!(refused(text).contains("ADVANCE or SMOOTH_TIME with a number"), "{text}");
        }
    }
}
