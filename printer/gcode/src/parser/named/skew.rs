//! SET_SKEW and CALC_MEASURED_SKEW, as Klipper has them.

use core::num::NonZeroU32;

use super::NamedWords;
use crate::not_executed::is_one_of;
use crate::{Decimal, Diagonals, ParseError, SkewCommand};

/// Form of their words, for errors.
pub(super) const SET: &str = "XY, XZ or YZ with the lengths AC,BD,AD in mm, or CLEAR=1";
pub(super) const CALCULATE: &str = "AC, BD and AD with lengths in mm";

/// A length above 0 and below 21 m.
fn length_10nm(text: &[u8]) -> Option<NonZeroU32> {
    let length_10nm = Decimal::parse(text).ok()?.to_10nm_from_mm();
    NonZeroU32::new(u32::try_from(length_10nm).ok()?)
}

/// SET_SKEW.
#[inline(never)]
pub(super) fn set(words: &NamedWords<'_>) -> Result<SkewCommand, ParseError> {
    let mut planes = [None; 3];
    for (plane, key) in planes.iter_mut().zip(["XY", "XZ", "YZ"]) {
        let Some(text) = words.value(key) else { continue };
        let mut texts = text.split(|byte| *byte == b',');
        let mut lengths = [None; 3];
        for length in &mut lengths {
            *length = texts.next().and_then(|text| length_10nm(text.trim_ascii()));
        }
        let ([Some(ac_10nm), Some(bd_10nm), Some(ad_10nm)], None) = (lengths, texts.next()) else {
            return Err(words.expected());
        };
        *plane = Some(Diagonals { ac_10nm, bd_10nm, ad_10nm });
    }
    let measures = planes != [None; 3];
    match words.value("CLEAR") {
        None if measures => Ok(SkewCommand::Measured(planes)),
        Some(value) if is_one_of(b"1", value) && !measures => Ok(SkewCommand::Clear),
        Some(value) if is_one_of(b"0", value) && measures => Ok(SkewCommand::Measured(planes)),
        _ => Err(words.expected()),
    }
}

/// CALC_MEASURED_SKEW.
#[inline(never)]
pub(super) fn calculate(words: &NamedWords<'_>) -> Result<SkewCommand, ParseError> {
    let [ac, bd, ad] = ["AC", "BD", "AD"].map(|key| words.value(key).and_then(length_10nm));
    match (ac, bd, ad) {
        (Some(ac_10nm), Some(bd_10nm), Some(ad_10nm)) => {
            Ok(SkewCommand::Calculate(Diagonals { ac_10nm, bd_10nm, ad_10nm }))
        }
        _ => Err(words.expected()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::tests::{reads, reads_with, refused, some};
    use super::*;
    use crate::Command;

    fn diagonals([ac, bd, ad]: [u32; 3]) -> Diagonals {
        let [ac_10nm, bd_10nm, ad_10nm] = [ac, bd, ad].map(|length| NonZeroU32::new(length).unwrap_or(NonZeroU32::MIN));
        Diagonals { ac_10nm, bd_10nm, ad_10nm }
    }

    #[test]
    fn klippers_words() {
        let xy = diagonals([14_040_000, 14_285_000, 9_980_000]);
        reads("SET_SKEW XY=140.4,142.85,99.8", Command::Skew(SkewCommand::Measured([Some(xy), None, None])));
        let yz = diagonals([14_142_000, 14_100_000, 10_000_000]);
        reads(
            "set_skew yz=141.42,141,100 XY=140.4,142.85,99.8 clear=0",
            Command::Skew(SkewCommand::Measured([Some(xy), None, Some(yz)])),
        );
        reads("SET_SKEW XY='140.4, 142.85, 99.8'", Command::Skew(SkewCommand::Measured([Some(xy), None, None])));
        reads("SET_SKEW CLEAR=1", Command::Skew(SkewCommand::Clear));
        reads("GET_CURRENT_SKEW", Command::Skew(SkewCommand::Report));
        reads("CALC_MEASURED_SKEW AC=140.4 BD=142.85 AD=99.8", Command::Skew(SkewCommand::Calculate(xy)));
    }

    #[test]
    fn what_klipper_refuses_is_refused() {
        for words in [
            "",
            "XY",
            "XY=1",
            "XY=1,2",
            "XY=1,2,3,4",
            "XY=1,2,0",
            "XY=1,-2,3",
            "XY=1,2,x",
            "XY=1,2,50000",
            "CLEAR=2",
            "CLEAR=0",
            "CLEAR=1 XY=1,2,3",
        ] {
            assert_eq!(refused(&format!("SET_SKEW {words}")), format!("SET_SKEW: expected {SET}"), "{words}");
        }
        assert_eq!(refused("SET_SKEW XW=1,2,3"), format!("SET_SKEW: unknown word \"XW\", expected {SET}"));
        let calculate = Command::Skew(SkewCommand::Calculate(diagonals([100_000, 200_000, 300_000])));
        reads_with("CALC_MEASURED_SKEW AC=1 BD=2 AD=3 XY=4", calculate, "XY has no effect");
        for words in ["", "AC=1 BD=2", "AC=1 BD=2 AD=0"] {
            let line = format!("CALC_MEASURED_SKEW {words}");
            assert_eq!(refused(&line), format!("CALC_MEASURED_SKEW: expected {CALCULATE}"), "{words}");
        }
    }

    #[test]
    fn marlins_words() {
        let factors = |xy, xz, yz| Command::Skew(SkewCommand::Factors([xy, xz, yz]));
        reads("M852", factors(None, None, None));
        reads("M852 I0.002 J-0.001 K0", factors(some("0.002"), some("-0.001"), some("0")));
        reads("M852 S0.002", factors(some("0.002"), None, None));
        reads_with("M852 K.01 X4", factors(None, None, some("0.01")), "X has no effect");
    }
}
