//! M306: the words of a heater's model.

use super::words::{Strays, Words};
use crate::remarks::Remarks;
use crate::{Decimal, ParseError};

/// Words of M306, as Marlin has them. Without T and constants it is a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeaterModelWords {
    /// E-1: of the bed.
    pub of_bed: bool,
    /// E: of this extruder's nozzle; without it of the selected one's.
    pub tool: Option<u8>,
    /// T: the constants are to be found.
    pub tunes: bool,
    /// P: power of the heater at full, W.
    pub power: Option<Decimal>,
    /// C: heat capacity, J/K.
    pub capacity: Option<Decimal>,
    /// R: how fast the thermistor follows, 1/s.
    pub sensor: Option<Decimal>,
    /// A: loss to still air, W/K.
    pub loss: Option<Decimal>,
    /// F: loss with the part-cooling fan at full power, W/K.
    pub fanned_loss: Option<Decimal>,
    /// H: heat capacity of filament, J/K for each millimetre.
    pub filament: Option<Decimal>,
}

impl HeaterModelWords {
    /// Reads the text after M306.
    ///
    /// # Errors
    ///
    /// A word that it does not have, or that is not a number, and T beside constants.
    pub fn read(text: &str) -> Result<Self, ParseError> {
        let mut remarks = Remarks::default();
        let mut words = Words::parse(text, &mut remarks, Strays::Refused)?;
        let extruder = words.whole(b'E');
        let tunes = words.has(b'T');
        let [power, capacity, sensor, loss, fanned_loss, filament] = b"PCRAFH".map(|letter| words.value(letter));
        drop(words);
        let (of_bed, tool) = (extruder == Some(-1), extruder.and_then(|extruder| u8::try_from(extruder).ok()));
        let model = Self { of_bed, tool, tunes, power, capacity, sensor, loss, fanned_loss, filament };
        let only_tunes = Self { of_bed, tool, tunes, ..Self::default() };
        let is_known = extruder.is_none() || of_bed || tool.is_some();
        if !remarks.is_empty() || !is_known || tunes && model != only_tunes {
            let words = "E0 or E1 (nozzle) or E-1 (bed), with T alone or with P, C, R, A, F, H and their numbers";
            return Err(ParseError::WordsExpected { command: "M306", words });
        }
        Ok(model)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{Command, parse};

    #[test]
    fn the_words_are_marlins() {
        let line = "M306 E0 P40 C16.7 R0.22 A0.068 F0.097 H0.0056 ; a V6";
        let Ok(Command::HeaterModel { words, .. }) = parse(line) else { panic!("{line}") };
        let number = |text: &str| Some(Decimal::parse(text.as_bytes()).unwrap());
        let model = HeaterModelWords {
            tool: Some(0),
            power: number("40"),
            capacity: number("16.7"),
            sensor: number("0.22"),
            loss: number("0.068"),
            fanned_loss: number("0.097"),
            filament: number("0.0056"),
            ..HeaterModelWords::default()
        };
        assert_eq!(HeaterModelWords::read(words), Ok(model));
        assert_eq!(HeaterModelWords::read(""), Ok(HeaterModelWords::default()));
        let tuned = HeaterModelWords { of_bed: true, tunes: true, ..HeaterModelWords::default() };
        assert_eq!(HeaterModelWords::read(" E-1 T"), Ok(tuned));
        let second = HeaterModelWords { tool: Some(1), tunes: true, ..HeaterModelWords::default() };
        assert_eq!(HeaterModelWords::read(" E1 T"), Ok(second));
    }

    #[test]
    fn other_words_are_refused() {
        for words in [" E-2", " T P40", " X3", " P", " Pnan", " 40", " T S1"] {
            assert!(HeaterModelWords::read(words).is_err(), "{words}");
        }
    }
}
