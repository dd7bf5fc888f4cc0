//! TUNING_TOWER, as Klipper has it.

use super::NamedWords;
use crate::{Decimal, ParseError, TowerCourse, TowerWords};

/// Form of its words, for errors.
pub(super) const FORM: &str = "COMMAND, PARAMETER and START, with FACTOR (and BAND) or with STEP_DELTA and STEP_HEIGHT";

/// The keys of its words.
pub(super) const WORDS: &str = "COMMAND, PARAMETER, START, SKIP, FACTOR, BAND, STEP_DELTA, STEP_HEIGHT";

/// Reads the command's words. Missing or contradictory words are an error: the value would not
/// change as it is meant to.
pub(super) fn parse<'a>(words: &NamedWords<'a>) -> Result<Option<TowerWords<'a>>, ParseError> {
    if words.keys().next().is_none() {
        return Ok(None);
    }
    let [factor, delta] = [words.number("FACTOR")?, words.number("STEP_DELTA")?];
    let [band, height] = [words.above_zero("BAND")?, words.above_zero("STEP_HEIGHT")?];
    let course = match (factor, band, delta, height) {
        (Some(factor), None, None, None) => TowerCourse::Linear { factor },
        (Some(factor), Some(band), None, None) => TowerCourse::Bands { factor, band },
        (None, None, Some(delta), Some(height)) => TowerCourse::Steps { delta, height },
        _ => return Err(words.expected()),
    };
    let skip = words.number("SKIP")?.unwrap_or(Decimal::ZERO);
    match (words.value_text("COMMAND"), words.value_text("PARAMETER"), words.number("START")?) {
        (Some(command), Some(parameter), Some(start)) if !skip.is_negative() => {
            Ok(Some(TowerWords { command, parameter, start, skip, course }))
        }
        _ => Err(words.expected()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::tests::{number, reads, reads_with, refused};
    use super::*;
    use crate::Command;

    fn tower(command: &'static str, parameter: &'static str, start: &str, course: TowerCourse) -> Command<'static> {
        let start = number(start);
        Command::Tower(Some(TowerWords { command, parameter, start, skip: Decimal::ZERO, course }))
    }

    #[test]
    fn each_course_has_its_words() {
        let linear = TowerCourse::Linear { factor: number(".005") };
        reads(
            "TUNING_TOWER COMMAND=SET_PRESSURE_ADVANCE PARAMETER=ADVANCE START=0 FACTOR=.005",
            tower("SET_PRESSURE_ADVANCE", "ADVANCE", "0", linear),
        );
        let bands = TowerCourse::Bands { factor: number("-0.5"), band: number("5") };
        reads("tuning_tower command=M204 parameter=P start=1500 factor=-0.5 band=5", tower("M204", "P", "1500", bands));
        let steps = TowerCourse::Steps { delta: number("-5"), height: number("5") };
        for quote in ['"', '\''] {
            reads(
                &format!(
                    "TUNING_TOWER COMMAND={quote}SET_HEATER_TEMPERATURE  HEATER=extruder{quote} PARAMETER=TARGET START=260 \
                     STEP_DELTA=-5 STEP_HEIGHT=5"
                ),
                tower("SET_HEATER_TEMPERATURE  HEATER=extruder", "TARGET", "260", steps),
            );
        }
        let skipped =
            TowerWords { command: "M900", parameter: "K", start: Decimal::ZERO, skip: number("2.5"), course: linear };
        reads("TUNING_TOWER COMMAND=M900 PARAMETER=K START=0 SKIP=2.5 FACTOR=.005", Command::Tower(Some(skipped)));
        reads("TUNING_TOWER", Command::Tower(None));
    }

    #[test]
    fn what_is_missing_or_contradicts_itself_is_refused() {
        for words in [
            "PARAMETER=K START=0 FACTOR=1",
            "COMMAND=M900 START=0 FACTOR=1",
            "COMMAND=M900 PARAMETER=K FACTOR=1",
            "COMMAND=M900 PARAMETER=K START=0",
            "COMMAND=M900 PARAMETER=K START=0 BAND=5",
            "COMMAND=M900 PARAMETER=K START=0 STEP_DELTA=1",
            "COMMAND=M900 PARAMETER=K START=0 STEP_HEIGHT=1",
            "COMMAND=M900 PARAMETER=K START=0 FACTOR=1 STEP_DELTA=1 STEP_HEIGHT=5",
            "COMMAND=M900 PARAMETER=K START=0 FACTOR=1 BAND=0",
            "COMMAND=M900 PARAMETER=K START=0 STEP_DELTA=1 STEP_HEIGHT=-5",
            "COMMAND=M900 PARAMETER=K START=0 FACTOR=1 SKIP=-1",
            "COMMAND=M900 PARAMETER=K START=x FACTOR=1",
            "COMMAND=\"M900 PARAMETER=K START=0 FACTOR=1",
        ] {
            assert_eq!(refused(&format!("TUNING_TOWER {words}")), format!("TUNING_TOWER: expected {FORM}"), "{words}");
        }
        let refusal = refused("TUNING_TOWER COMMAND=M900 PARAMETER=K START=0 FAKTOR=1");
        assert_eq!(refusal, format!("TUNING_TOWER: unknown word \"FAKTOR\", expected {FORM}"));
        let linear = tower("M900", "K", "0", TowerCourse::Linear { factor: number("1") });
        reads_with("TUNING_TOWER COMMAND=M900 PARAMETER=K START=0 FACTOR=1 fast", linear, "fast has no effect");
    }
}
