//! G29, G30, G34, G35, G80, M48, M420, M421 and M555: the bed's mesh, in Marlin's words and Prusa's.

use super::code::Code;
use super::words::Words;
use crate::remarks::Remarks;
use crate::{BedArea, BedCommand, Command, ParseError};

/// G29, G80, G30, G34 and G35.
pub(super) fn g_code<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    if code.number == 34 {
        let rounds = words.whole_to(b'I', u8::MAX)?;
        let (accuracy, amplification) = (words.above_zero(b'T'), words.above_zero(b'A'));
        return Ok(Command::Bed(BedCommand::Align { rounds, accuracy, amplification }));
    }
    if code.number == 35 {
        return Ok(Command::Bed(BedCommand::Screws));
    }
    if code.number == 30 {
        return Ok(Command::Bed(BedCommand::Probe { x: words.value(b'X'), y: words.value(b'Y') }));
    }
    if code.number == 29 {
        // Of Marlin's unified levelling A switches on, L alone would load a mesh, and of its phases the first measures.
        if words.flag(b'A') {
            return Ok(Command::Bed(BedCommand::Follow { on: Some(true), fade: None, reports: false }));
        }
        let loads = words.is_present(b'L') && !b"RFB".iter().any(|&letter| words.is_present(letter));
        if loads || words.is_other_than(b'P', 1) {
            return Ok(Command::Accepted);
        }
    }
    let area = area(&mut words, "G29")?;
    Ok(Command::Bed(BedCommand::Measure { area, unless_on: words.flag(b'O') }))
}

/// M48, M420, M421 and M555.
pub(super) fn m_code<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    Ok(Command::Bed(match code.number {
        48 => {
            let samples = words.whole_to(b'P', u8::MAX)?;
            BedCommand::Repeat { samples, x: words.value(b'X'), y: words.value(b'Y') }
        }
        420 => {
            BedCommand::Follow { on: words.switch(b'S')?, fade: words.not_negative(b'Z')?, reports: words.flag(b'V') }
        }
        421 => {
            let (column, row) = (words.whole_to(b'I', u8::MAX)?, words.whole_to(b'J', u8::MAX)?);
            let (height, by) = (words.value(b'Z'), words.value(b'Q'));
            let (Some(column), Some(row), Some(value)) = (column, row, height.or(by)) else {
                return Err(ParseError::WordsExpected { command: "M421", words: "I, J, and Z or Q" });
            };
            BedCommand::SetPoint { column, row, height: value, adds: height.is_none() }
        }
        _ => match area(&mut words, "M555")? {
            Some(area) => BedCommand::Area(area),
            None => return Err(ParseError::WordsExpected { command: "M555", words: "X, Y, W and H" }),
        },
    }))
}

/// The part of the bed: L, R, F and B, its ends, or X, Y, W and H, its left front corner and its size.
#[inline(never)]
fn area(words: &mut Words<'_>, command: &'static str) -> Result<Option<BedArea>, ParseError> {
    for (letters, is_size) in [(b"LRFB", false), (b"XWYH", true)] {
        let [_, ends @ ..] = letters.map(|letter| words.is_present(letter));
        if ends == [false; 3] || is_size && !(words.is_present(b'W') || words.is_present(b'H')) {
            continue;
        }
        let [Some(left), Some(right), Some(front), Some(back)] = letters.map(|letter| words.value(letter)) else {
            return Err(ParseError::WordsExpected { command, words: "L, R, F and B, or X, Y, W and H" });
        };
        return Ok(Some(BedArea { left, right, front, back, is_size }));
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{number, reads, reads_with, refused, some};
    use super::*;

    fn bed(command: BedCommand) -> Command<'static> {
        Command::Bed(command)
    }

    fn measure(area: Option<BedArea>) -> Command<'static> {
        bed(BedCommand::Measure { area, unless_on: false })
    }

    fn part([left, right, front, back]: [&str; 4], is_size: bool) -> BedArea {
        let [left, right, front, back] = [left, right, front, back].map(number);
        BedArea { left, right, front, back, is_size }
    }

    #[test]
    fn probes_above_the_screws() {
        reads("G35", bed(BedCommand::Screws));
        reads("SCREWS_TILT_CALCULATE", bed(BedCommand::Screws));
        reads_with("G35 S40", bed(BedCommand::Screws), "S has no effect");
    }

    #[test]
    fn aligns_the_motors_of_z() {
        let align = |rounds, accuracy, amplification| bed(BedCommand::Align { rounds, accuracy, amplification });
        reads("G34", align(None, None, None));
        reads("G34 I3 T0.05 A1.2", align(Some(3), some("0.05"), some("1.2")));
        reads_with("G34 E1 S1", align(None, None, None), "E has no effect; S has no effect");
        for name in ["Z_TILT_ADJUST", "QUAD_GANTRY_LEVEL"] {
            reads(name, align(None, None, None));
            let (text, with) =
                (format!("{name} RETRIES=4 RETRY_TOLERANCE=0.0075"), align(Some(5), some("0.0075"), None));
            reads(&text, with);
            reads_with(
                &format!("{name} HORIZONTAL_MOVE_Z=5"),
                align(None, None, None),
                "HORIZONTAL_MOVE_Z has no effect",
            );
            let says = format!(
                "{name}: expected RETRIES with a number up to 29, RETRY_TOLERANCE with one above 0, or neither"
            );
            for words in ["RETRIES=30", "RETRIES=x", "RETRY_TOLERANCE=0"] {
                assert_eq!(refused(&format!("{name} {words}")), says, "{words}");
            }
        }
    }

    #[test]
    fn measures_all_or_a_part() {
        for text in ["G29", "G29 P1", "G80"] {
            reads(text, measure(None));
        }
        reads("G29 O", bed(BedCommand::Measure { area: None, unless_on: true }));
        reads("G29 L10 R150 F20 B160.5", measure(Some(part(["10", "150", "20", "160.5"], false))));
        reads_with(
            "G29 P9 X30 Y-4 W32 H4",
            Command::Accepted,
            "H has no effect; P has no effect; W has no effect; X has no effect; Y has no effect",
        );
        reads("G29 P1 X30.2 Y20 W32 H20", measure(Some(part(["30.2", "32", "20", "20"], true))));
        reads_with("G29 X5 Y5", measure(None), "X has no effect; Y has no effect");
        reads_with("G80 N7", measure(None), "N has no effect");
        reads_with("G29 Z10", measure(None), "Z has no effect");
        reads("M555 X1 Y2 W3 H4", bed(BedCommand::Area(part(["1", "3", "2", "4"], true))));
        for text in ["G29 L10 R150", "G29 R150", "G29 W10", "G29 X1 Y1 H4"] {
            assert_eq!(refused(text), "G29: expected L, R, F and B, or X, Y, W and H", "{text}");
        }
        assert_eq!(refused("M555 X1 W4"), "M555: expected L, R, F and B, or X, Y, W and H");
        assert_eq!(refused("M555"), "M555: expected X, Y, W and H");
    }

    /// The other phases of Marlin's unified levelling measure nothing.
    #[test]
    fn other_phases_measure_nothing() {
        reads("G29 A", bed(BedCommand::Follow { on: Some(true), fade: None, reports: false }));
        reads_with("G29 L1", Command::Accepted, "L has no effect");
        reads_with("G29 P3.2", Command::Accepted, "P has no effect");
        reads_with("G29 P2 Z0.28", Command::Accepted, "P has no effect; Z has no effect");
    }

    #[test]
    fn probes_and_points() {
        reads("G30", bed(BedCommand::Probe { x: None, y: None }));
        reads_with("G30 X10 Y20 Z1.25", bed(BedCommand::Probe { x: some("10"), y: some("20") }), "Z has no effect");
        reads("M48 P12 X1 Y2", bed(BedCommand::Repeat { samples: Some(12), x: some("1"), y: some("2") }));
        let follow = |on, fade, reports| bed(BedCommand::Follow { on, fade, reports });
        reads("M420 S1 Z2", follow(Some(true), some("2"), false));
        reads("M420 S0", follow(Some(false), None, false));
        reads("M420 V", follow(None, None, true));
        let point = |height, adds| bed(BedCommand::SetPoint { column: 1, row: 2, height: number(height), adds });
        reads("M421 I1 J2 Z-0.05", point("-0.05", false));
        reads("M421 I1 J2 Q.1", point(".1", true));
        assert_eq!(refused("M421 I1 Z0"), "M421: expected I, J, and Z or Q");
        assert!(refused("M420 S2").starts_with("S: 2 is out of range"));
    }
}
