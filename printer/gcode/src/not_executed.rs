//! Commands that slicers and hosts write and this firmware does not execute: the treatment of
//! each, and the reason.
//!
//! The parser looks here for every command that it has no code for, and the book's table of these
//! commands is made from the same lines. A command that gets an effect loses its line here.

use core::fmt;

/// Takes the place of a letter: the command's name is a word, as Klipper's are.
pub const NAMED: u8 = b'_';

/// Treatment of a command that is not executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Ignored, and the job continues: slicers write it for many machines, and a print is the
    /// same without it.
    Accepted,
    /// Ignored like [`Outcome::Accepted`], but answered as an unknown command: the
    /// print may differ.
    Unknown,
    /// An error: the rest of the job would be printed elsewhere, at another speed or with another
    /// amount of filament.
    Refused,
}

/// A command, or several in a row, that this firmware does not execute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotExecuted {
    /// `G`, `M`, or [`NAMED`] for commands whose name is a word.
    pub letter: u8,
    /// The first number; of a name its place in the list.
    pub first: u16,
    /// The last number.
    pub last: u16,
    /// Usual spelling: `G29`, `G55 to G59`; names are separated by `, `, and one that ends with `*`
    /// includes all that begin so.
    pub name: &'static str,
    /// The command's action on machines that execute it.
    pub meaning: &'static str,
    /// Reason why it is not executed here, or what to use instead; for a refused one, what would
    /// be wrong after it.
    pub why: &'static str,
    /// Treatment.
    pub outcome: Outcome,
}

impl NotExecuted {
    /// The entry of a command, and its index.
    pub fn find(letter: u8, number: u32) -> Option<(u8, &'static Self)> {
        (0..).zip(NOT_EXECUTED).find(|(_, entry)| {
            entry.letter == letter && (u32::from(entry.first)..=u32::from(entry.last)).contains(&number)
        })
    }

    /// The entry of a command whose name is a word, in upper or lower case, and its index.
    pub fn find_named(name: &[u8]) -> Option<(u8, &'static Self)> {
        (0..).zip(NOT_EXECUTED).find(|(_, entry)| entry.letter == NAMED && is_one_of(entry.name.as_bytes(), name))
    }
}

/// True if `name` is one of the `known` names, which are written as in [`NotExecuted::name`]. A
/// separate function, as it is rarely called and flash is short.
#[inline(never)]
pub(crate) fn is_one_of(mut known: &[u8], name: &[u8]) -> bool {
    let mut rest = name;
    // Byte by byte: where a known name differs, the next one begins.
    loop {
        match (known, rest) {
            ([b'*', ..], _) | ([] | [b',', ..], []) => return true,
            ([next, more @ ..], [byte, after @ ..]) if byte.eq_ignore_ascii_case(next) => (known, rest) = (more, after),
            _ => {
                let Some(end) = known.iter().position(|byte| *byte == b' ') else { return false };
                (known, rest) = (known.get(end + 1..).unwrap_or_default(), name);
            }
        }
    }
}

impl fmt::Display for NotExecuted {
    /// Writes it as a remark, without the command's name.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "not executed ({}): {}", self.meaning, self.why)
    }
}

const fn entry(
    outcome: Outcome,
    code: (u8, u16, u16),
    name: &'static str,
    meaning: &'static str,
    why: &'static str,
) -> NotExecuted {
    NotExecuted { letter: code.0, first: code.1, last: code.2, name, meaning, why, outcome }
}

const fn accepted(code: (u8, u16, u16), name: &'static str, meaning: &'static str, why: &'static str) -> NotExecuted {
    entry(Outcome::Accepted, code, name, meaning, why)
}

const fn unknown(code: (u8, u16, u16), name: &'static str, meaning: &'static str, why: &'static str) -> NotExecuted {
    entry(Outcome::Unknown, code, name, meaning, why)
}

const fn refused(code: (u8, u16, u16), name: &'static str, meaning: &'static str, why: &'static str) -> NotExecuted {
    entry(Outcome::Refused, code, name, meaning, why)
}

const fn g(number: u16) -> (u8, u16, u16) {
    (b'G', number, number)
}

const fn m(number: u16) -> (u8, u16, u16) {
    (b'M', number, number)
}

const fn named(number: u16) -> (u8, u16, u16) {
    (NAMED, number, number)
}

const STORED_MESH: &str = "M420 S1 follows the mesh that M500 has stored, G29 measures one";
const NO_DISPLAY: &str = "there is no display";
const NO_UNIT: &str = "there is no such unit: change filament by hand";
const NO_STORE: &str = "the profile says where home is";
const NO_OUTPUT: &str = "there is no such output";
const NO_TWIN: &str = "one extruder prints at a time";

/// All of them, by letter and number; at most 128, a bit each in [`crate::Remarks`].
#[rustfmt::skip]
pub static NOT_EXECUTED: &[NotExecuted] = &[
    refused(g(5), "G5", "Bezier curve", "the curve would be missing; let the slicer write G1, G2 or G3"),
    refused(g(6), "G6", "direct steps", "the steps would be missing; use G1"),
    unknown(g(12), "G12", "clean the nozzle", "there is no brush"),
    refused(g(16), "G16", "polar coordinates", "polar coordinates would be read as X and Y; write X and Y"),
    accepted(g(17), "G17", "arcs in the plane XY", "arcs lie in it as it is"),
    refused((b'G', 18, 19), "G18 and G19", "arcs in other planes", "arcs would lie elsewhere; use G17 (XY)"),
    unknown(g(26), "G26", "print a pattern that shows the bed's mesh", "M420 V reports the mesh"),
    unknown(g(27), "G27", "park the nozzle", "the nozzle stays; write G0 with the place"),
    unknown((b'G', 31, 32), "G31 and G32", "dock the probe, or probe the bed", "G29 measures the bed"),
    unknown(g(33), "G33", "calibrate a delta", "deltas are not supported"),
    refused(g(38), "G38", "move until the probe triggers", "the nozzle would not stand at the probed place; home with G28"),
    refused((b'G', 41, 42), "G41 and G42", "tool radius compensation, or a move to a place of the mesh", "the path would lie elsewhere; let the slicer correct it"),
    refused((b'G', 43, 44), "G43 and G44", "tool length compensation", "Z would be off by the tool's length; leave the offset out"),
    refused(g(51), "G51", "scaling", "the part would have another size; scale it in the slicer"),
    refused(g(52), "G52", "offset of the coordinates", "the part would lie elsewhere; use G92"),
    accepted(g(53), "G53", "machine coordinates", "alone in its line it moves nothing"),
    accepted(g(54), "G54", "first coordinate system", "it is the only one, and in force"),
    refused((b'G', 55, 59), "G55 to G59", "other coordinate systems", "the part would lie elsewhere; use the coordinates of G54, or G92"),
    unknown(g(60), "G60", "note the position", "there is no return to it (G61)"),
    unknown(g(61), "G61", "return to the noted position", "the nozzle stays; write G0 with the place"),
    unknown(g(64), "G64", "rounding of corners", "corners follow M205 J"),
    refused(g(68), "G68", "rotated coordinates", "the part would lie elsewhere; turn it in the slicer"),
    unknown(g(76), "G76", "calibrate the probe's temperature", "its readings have no correction by temperature"),
    unknown((b'G', 81, 82), "G81 and G82", "report the bed's mesh", "M420 V reports it"),
    refused(g(93), "G93", "feeds as moves a minute", "every feed would be wrong; write feeds per minute (G94)"),
    refused(g(95), "G95", "feeds for each turn", "every feed would be wrong; write feeds per minute (G94)"),
    unknown((b'G', 161, 162), "G161 and G162", "home to the lower or upper end", "home with G28"),
    unknown(g(425), "G425", "calibrate with a cube on the bed", "there is no such sensor"),
    unknown((b'M', 6, 7), "M6 and M7", "wait for a tool, or for the bed", "wait with M109 and M190"),
    accepted(m(74), "M74", "weight on the bed", "speeds do not depend on it"),
    unknown((b'M', 120, 121), "M120 and M121", "watch the end stops", "they are read while homing"),
    unknown(m(132), "M132", "load the stored home position", NO_STORE),
    unknown(m(136), "M136", "begin a job (MakerBot)", "a job needs no such beginning"),
    accepted(m(142), "M142", "temperature of the heat break", "its fan is not controlled"),
    unknown(m(145), "M145", "temperatures of materials", "give temperatures with M104 and M140"),
    unknown(m(154), "M154", "report the position by itself", "ask with M114"),
    unknown((b'M', 163, 165), "M163 to M165", "mix filaments", NO_TWIN),
    unknown(m(192), "M192", "wait for the probe's temperature", "there is no such thermometer: nothing is waited for"),
    accepted(m(202), "M202", "accelerations of travel for each axis", "M204 T limits that of travel, M201 each axis"),
    unknown(m(209), "M209", "retract by itself", "write G10 and G11"),
    unknown((b'M', 217, 217), "M217", "filament at a tool change", "tools.retract_mm and tools.prime_mm of the profile"),
    unknown(m(240), "M240", "trigger a camera", NO_OUTPUT),
    unknown(m(250), "M250", "contrast of the display", NO_DISPLAY),
    unknown((b'M', 281, 282), "M281 and M282", "servo: its angles, or let it go", "M280 tells the probe's, which is the only one"),
    accepted(m(300), "M300", "sound", "there is no loudspeaker"),
    unknown(m(305), "M305", "thermistors", "the profile's stay"),
    unknown((b'M', 320, 323), "M320 to M323", "bed levelling (Repetier)", "use G29 and M420"),
    unknown((b'M', 350, 351), "M350 and M351", "microsteps", "the profile's stay"),
    unknown(m(355), "M355", "light of the case", "use M42"),
    unknown((b'M', 360, 364), "M360 to M364", "places of a SCARA's arms", "SCARAs are not supported"),
    unknown(m(375), "M375", "load the bed's mesh", STORED_MESH),
    unknown(m(403), "M403", "filament of a multi-material unit", NO_UNIT),
    unknown((b'M', 404, 407), "M404 to M407", "measure the filament's diameter", "there is no such sensor"),
    unknown(m(428), "M428", "make this place home", NO_STORE),
    accepted(m(486), "M486", "names of objects, to leave one out", "all are printed"),
    unknown(m(493), "M493", "input shaping by fixed-time motion", "use M593"),
    accepted((b'M', 530, 532), "M530 to M532", "a job begins, its name, its progress", NO_DISPLAY),
    unknown(m(540), "M540", "end the job when an end stop triggers", "end stops are read while homing"),
    unknown((b'M', 557, 558), "M557 and M558", "probe points and kind of probe (RepRapFirmware)", "the profile says how Z homes"),
    unknown(m(565), "M565", "probe offset (RepRapFirmware)", "use M851"),
    accepted(m(573), "M573", "mean flow, to set pressure advance by", "M572 and M900 report what is set"),
    unknown(m(575), "M575", "speed of the serial port", "it stays"),
    unknown(m(591), "M591", "filament sensor (RepRapFirmware)", "use M412"),
    unknown(m(605), "M605", "how two nozzles work together", NO_TWIN),
    unknown((b'M', 620, 629), "M620 to M629", "filament of an AMS (Bambu)", NO_UNIT),
    unknown((b'M', 665, 666), "M665 and M666", "geometry of a delta", "the profile's kinematics stay"),
    unknown((b'M', 703, 709), "M703 to M709", "filament of a multi-material unit", NO_UNIT),
    unknown(m(710), "M710", "power of the controller's fan", "the profile's fans say when it turns"),
    unknown((b'M', 800, 801), "M800 and M801", "begin and end of a job", "a job needs no such beginning"),
    unknown(m(808), "M808", "repeat a part of the file", "the part is printed once"),
    accepted(m(862), "M862", "checks of the printer's number, firmware, G-code level and features (M862.1 and M862.3: see above)", "not checked"),
    unknown((b'M', 870, 871), "M870 and M871", "compensate the probe's temperature", "the probe has no thermometer"),
    accepted(m(907), "M907", "motor currents", "M906 sets them, and the profile"),
    unknown((b'M', 908, 910), "M908 to M910", "motor currents by a potentiometer", "M906 sets them, and the profile"),
    unknown((b'M', 911, 912), "M911 and M912", "drivers too hot", "M122 reports the drivers"),
    unknown(m(951), "M951", "magnetic tool change", NO_TWIN),
    unknown((b'M', 960, 991), "M960 to M991", "lamps, cameras and checks (Bambu)", "this machine does not have them"),
    unknown(m(997), "M997", "new firmware", "the book says how firmware is written"),
    unknown((b'M', 1001, 1006), "M1001 to M1006", "begin and end of a job, checks, sounds (Raise3D, Bambu)", "a job needs no such beginning"),
    accepted(named(0), "BED_MESH_*", "load, save or show a mesh of the bed (Klipper)", STORED_MESH),
    accepted(named(1), "EXCLUDE_OBJECT*", "names and outlines of objects, to leave one out (Klipper)", "all are printed"),
    accepted(named(2), "START_PRINT, PRINT_START", "a macro that homes and heats (Klipper)", "nothing is homed and nothing heats: give the profile a macro of this name, or write G28, M190 and M109 into the slicer's start code"),
    accepted(named(3), "END_PRINT, PRINT_END", "a macro that switches off (Klipper)", "heaters, fan and motors stay on: give the profile a macro of this name, or write M104 S0, M140 S0, M107 and M84 into the slicer's end code"),
    accepted(named(4), "TIMELAPSE_*", "trigger a camera (Klipper)", NO_OUTPUT),
    accepted(named(5), "SAVE_GCODE_STATE", "note modes and position (Klipper)", "there is no return to them"),
    accepted(named(6), "SKEW_PROFILE", "load, save or remove the skew of a machine (Klipper)", "the skew of the profile, or the one that M500 has stored, is in force: set it with SET_SKEW or M852"),
    refused(named(7), "RESTORE_GCODE_STATE", "return to noted modes and position (Klipper)", "coordinates and feeds could be read wrongly; write G90 or G91, M82 or M83, and F"),
];

const _: () = assert!(NOT_EXECUTED.len() <= 128, "a set of remarks has a bit for each entry");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Command, ParseError, Remarks, parse, parse_with_remarks};

    /// Each entry is reached: the parser has no code for its commands, and does with them
    /// what the table says.
    #[test]
    fn the_parser_does_what_the_table_says() {
        for (entry, before) in NOT_EXECUTED.iter().zip([None].into_iter().chain(NOT_EXECUTED.iter().map(Some))) {
            assert!(entry.first <= entry.last, "{}", entry.name);
            assert!(
                before.is_none_or(|before| (before.letter, before.last) < (entry.letter, entry.first)),
                "{}",
                entry.name
            );
            for number in entry.first..=entry.last {
                // Some are refused for their words only.
                let words = if entry.outcome == Outcome::Refused { " X1" } else { "" };
                let name = entry.name.split(", ").next().unwrap_or_default().replace('*', "X");
                let code = format!("{}{number}", char::from(entry.letter));
                let text = format!("{}{words}", if entry.letter == NAMED { name } else { code });
                let mut remarks = Remarks::default();
                let parsed = parse_with_remarks(&text, &mut remarks);
                let why = format!("{text} has an effect now: take it out of this table. {parsed:?}");
                match entry.outcome {
                    Outcome::Accepted => assert_eq!(parsed, Ok(Command::Accepted), "{why}"),
                    Outcome::Unknown => assert_eq!(parsed, Ok(Command::Unknown(&text)), "{why}"),
                    Outcome::Refused => {
                        let expected = ParseError::NotSupported { command: entry.name, why: entry.why };
                        assert_eq!(parsed, Err(expected), "{why}");
                        continue;
                    }
                }
                assert_eq!(remarks.to_string(), entry.to_string(), "{text}");
            }
        }
    }

    /// Every command that is accepted without effect has a line here.
    #[test]
    fn what_is_accepted_for_nothing_stands_in_the_table() {
        for letter in ["G", "M"] {
            for number in 0..2000 {
                let text = format!("{letter}{number}");
                let listed = NotExecuted::find(letter.as_bytes()[0], number).map(|(_, entry)| entry.outcome);
                // These are queries without words, have no effect, or report a missing word.
                if ["M42", "M149", "M155", "M200", "M280"].contains(&text.as_str()) {
                    continue;
                }
                assert_eq!(parse(&text) == Ok(Command::Accepted), listed == Some(Outcome::Accepted), "{text}");
            }
        }
    }

    #[test]
    fn texts_fit_a_reply() {
        for entry in NOT_EXECUTED {
            let length = entry.to_string().len();
            assert!(length <= 200, "{}: {length}", entry.name);
        }
    }
}
