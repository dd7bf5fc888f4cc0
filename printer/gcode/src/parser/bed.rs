//! G29, G30, G34, G35, G80, M48, M420, M421 and M555: the bed's mesh, in Marlin's
//! words and Prusa's.

use super::code::Code;
use super::words::Words;
use crate::remarks::Remark;
use crate::{BedArea, BedCommand, Command, ParseError};

/// G29, G80, G30, G34 and G35.
pub(super) fn g_code<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    match code.number {
        29 => measure(words),
        // Elsewhere a motor of Z is locked or let go with these, and nothing is probed.
        34 if b"LUZ".iter().any(|&letter| words.is_present(letter)) => Ok(Command::Accepted),
        34 => {
            let rounds = words.whole_to(b'I', u8::MAX)?;
            let (accuracy, amplification) = (words.above_zero(b'T'), words.above_zero(b'A'));
            Ok(Command::Bed(BedCommand::Align { rounds, accuracy, amplification }))
        }
        35 => Ok(Command::Bed(BedCommand::Screws)),
        // RepRapFirmware's point P of a mesh, whose height is given and not probed.
        30 if words.is_present(b'P') && words.is_above(b'Z', NOT_GIVEN) => Ok(Command::Accepted),
        30 => Ok(Command::Bed(BedCommand::Probe { x: words.value(b'X'), y: words.value(b'Y') })),
        // The other letters of Prusa's G80 correct the mesh.
        _ => {
            let area = area_of_size(words, "G80")?;
            Ok(Command::Bed(BedCommand::Measure { area, unless_on: words.flag(b'O') }))
        }
    }
}

/// The Z of RepRapFirmware's G30 with which the height is probed.
const NOT_GIVEN: i64 = -9999;

/// Below this S of G29 is a slot or a step of the levelling, not a speed.
const MIN_SPEED: i64 = 10;

/// G29. Firmwares differ in its letters, and it measures only where all of them do: a letter that
/// means nothing here must not become a probing of the whole bed.
fn measure<'a>(words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let follow = |on, fade, reports| Ok(Command::Bed(BedCommand::Follow { on, fade, reports }));
    let has = |words: &Words<'_>, letters: &[u8]| letters.iter().any(|&letter| words.is_present(letter));
    let has_phase = words.is_present(b'P');
    let is_first_phase = has_phase && !words.is_other_than(b'P', 1);
    let (has_edges, has_size) = (has(words, b"RB"), has(words, b"WH"));
    if !is_first_phase {
        // F is the fade height in unified levelling; in bilinear levelling it is an
        // edge, beside others.
        let fade = if has_edges { None } else { words.not_negative(b'F')? };
        if words.flag(b'A') {
            return follow(Some(true), fade, false);
        }
        let is_speed = !words.is_present(b'S') || words.is_above(b'S', MIN_SPEED);
        let is_place = !has_size && has(words, b"XY") || !has_edges && has(words, b"L");
        if has_phase || fade.is_some() || is_place || !is_speed || has(words, b"CDIJKMNQTUZ") {
            words.remark(Remark::NothingMeasured);
            return if has_phase {
                Ok(Command::Accepted)
            } else if words.flag(b'J') {
                Ok(Command::Bed(BedCommand::Clear))
            } else if words.has(b'T') {
                follow(None, fade, true)
            } else if fade.is_some() {
                follow(None, fade, false)
            } else {
                Ok(Command::Accepted)
            };
        }
    }
    let area = if has_edges {
        let [left, right, front, back] = b"LRFB".map(|letter| words.value(letter));
        Some(BedArea { left, right, front, back, is_size: false })
    } else {
        area_of_size(words, "G29")?
    };
    Ok(Command::Bed(BedCommand::Measure { area, unless_on: words.flag(b'O') }))
}

/// M48, M420, M421 and M555.
pub(super) fn m_code<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
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
        _ => match area_of_size(words, "M555")? {
            Some(area) => BedCommand::Area(area),
            None => return Err(ParseError::WordsExpected { command: "M555", words: "X, Y, W and H" }),
        },
    }))
}

/// The part of the bed by X, Y, W and H, its left front corner and its size.
#[inline(never)]
fn area_of_size(words: &mut Words<'_>, command: &'static str) -> Result<Option<BedArea>, ParseError> {
    if !(words.is_present(b'W') || words.is_present(b'H')) {
        return Ok(None);
    }
    let [left, right, front, back] = b"XWYH".map(|letter| words.value(letter));
    if [left, right, front, back].contains(&None) {
        return Err(ParseError::WordsExpected { command, words: "X, Y, W and H" });
    }
    Ok(Some(BedArea { left, right, front, back, is_size: true }))
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
        let [left, right, front, back] = [left, right, front, back].map(some);
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
        for text in ["G29 L10 R150", "G29 R150", "G29 F30 B90"] {
            let [left, right, front, back] = match text {
                "G29 F30 B90" => [None, None, some("30"), some("90")],
                "G29 R150" => [None, some("150"), None, None],
                _ => [some("10"), some("150"), None, None],
            };
            reads(text, measure(Some(BedArea { left, right, front, back, is_size: false })));
        }
        reads("G29 P1 X30.2 Y20 W32 H20", measure(Some(part(["30.2", "32", "20", "20"], true))));
        reads_with("G29 V4 E", measure(None), "E has no effect; V has no effect");
        reads_with("G29 S4000", measure(None), "S has no effect");
        reads_with("G29 P1 T C V2", measure(None), "C has no effect; T has no effect; V has no effect");
        reads_with("G80 N7 R3", measure(None), "N has no effect; R has no effect");
        reads("M555 X1 Y2 W3 H4", bed(BedCommand::Area(part(["1", "3", "2", "4"], true))));
        for text in ["G29 W10", "G29 X1 Y1 H4"] {
            assert_eq!(refused(text), "G29: expected X, Y, W and H", "{text}");
        }
        assert_eq!(refused("M555 X1 W4"), "M555: expected X, Y, W and H");
        assert_eq!(refused("M555"), "M555: expected X, Y, W and H");
    }

    /// A letter that means something else here, or nothing, does not probe the bed.
    #[test]
    fn a_dropped_letter_measures_nothing() {
        let follow = |on, fade, reports| bed(BedCommand::Follow { on, fade, reports });
        let says = "nothing is measured (G29 or G29 P1 measures the bed, M420 S1 follows the mesh, M420 S0 ends that)";
        for (text, command, letters) in [
            ("G29 L1", Command::Accepted, "L"),
            ("G29 P3.2", Command::Accepted, "P"),
            ("G29 P2 Z0.28", Command::Accepted, "PZ"),
            ("G29 P9 X30 Y-4 W32 H4", Command::Accepted, "HPWXY"),
            ("G29 S1", Command::Accepted, "S"),
            ("G29 S2", Command::Accepted, "S"),
            ("G29 D", Command::Accepted, "D"),
            ("G29 K1", Command::Accepted, "K"),
            ("G29 X5 Y5", Command::Accepted, "XY"),
            ("G29 Z10", Command::Accepted, "Z"),
            ("G29 T", follow(None, None, true), ""),
            ("G29 F10", follow(None, some("10"), false), ""),
            ("G29 L1 F10", follow(None, some("10"), false), "L"),
            ("G29 J", bed(BedCommand::Clear), ""),
        ] {
            let letters: String = letters.chars().map(|letter| format!("{letter} has no effect; ")).collect();
            reads_with(text, command, &format!("{letters}{says}"));
        }
        reads("G29 A F10", follow(Some(true), some("10"), false));
    }

    #[test]
    fn words_of_other_probing_probe_nothing() {
        reads_with("G34 L", Command::Accepted, "L has no effect");
        reads_with("G34 Z1 U", Command::Accepted, "U has no effect; Z has no effect");
        reads_with(
            "G30 P0 X10 Y20 Z0.1",
            Command::Accepted,
            "P has no effect; X has no effect; Y has no effect; Z has no effect",
        );
        let probe = bed(BedCommand::Probe { x: some("10"), y: some("20") });
        reads_with("G30 P0 X10 Y20 Z-99999", probe, "P has no effect; Z has no effect");
        reads("G29 A", bed(BedCommand::Follow { on: Some(true), fade: None, reports: false }));
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
