//! The first temperatures that a file names: of its commands, or else of its slicer's comments.

use std::fmt;

use ferrostep_gcode::{Command, Decimal, WaitTarget, parse};
use memchr::memchr2;

use crate::command_code::code;

/// Maximum number of bytes kept of a line.
const KEPT_BYTES: usize = 200;

/// Keys of the slicers' settings for the nozzle and the bed, the first layer's before the others'
/// (PrusaSlicer and its family, OrcaSlicer and Bambu Studio).
const NOZZLE_KEYS: [&str; 4] =
    ["first_layer_temperature", "nozzle_temperature_initial_layer", "temperature", "nozzle_temperature"];
const BED_KEYS: [&str; 5] = [
    "first_layer_bed_temperature",
    "bed_temperature_initial_layer_single",
    "hot_plate_temp_initial_layer",
    "bed_temperature",
    "hot_plate_temp",
];

/// The source of a temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Source {
    /// A word of the macro.
    Word,
    /// A command of the file.
    Command,
    /// A comment of the slicer's, by its place among the keys.
    Comment(usize),
    /// The lowest temperature at which the machine extrudes.
    Lowest,
}

impl fmt::Display for Source {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Word => "by its words",
            Self::Command => "as the file's first command has it",
            Self::Comment(_) => "by the slicer's comments",
            Self::Lowest => "a little above the lowest for extruding, since the file names none",
        })
    }
}

/// A temperature and its source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Told {
    /// Degrees Celsius.
    pub celsius: f64,
    /// Source of the target.
    pub by: Source,
}

/// Reads the beginning of a file, in portions of any size.
#[derive(Debug, Default)]
pub(super) struct FirstTargets {
    line: Vec<u8>,
    nozzle: Option<Told>,
    bed: Option<Told>,
    has_ended: bool,
}

impl FirstTargets {
    /// Reads some bytes.
    pub fn read(&mut self, portion: &[u8]) {
        let mut rest = portion;
        while !(rest.is_empty() || self.has_ended) {
            let end = memchr2(b'\n', b'\r', rest);
            let (text, after) = rest.split_at(end.unwrap_or(rest.len()));
            let room = KEPT_BYTES.saturating_sub(self.line.len());
            self.line.extend(text.iter().take(room));
            rest = after.get(1..).unwrap_or_default();
            if end.is_some() {
                self.end_line();
            }
        }
    }

    /// Ends the last line; what is read from now on does not count.
    pub fn end(&mut self) {
        self.end_line();
        self.has_ended = true;
    }

    /// The first temperature of the nozzle.
    pub fn nozzle(&self) -> Option<Told> {
        self.nozzle
    }

    /// The first temperature of the bed.
    pub fn bed(&self) -> Option<Told> {
        self.bed
    }

    fn end_line(&mut self) {
        let bytes = std::mem::take(&mut self.line);
        let Ok(line) = std::str::from_utf8(&bytes) else { return };
        match line.trim_start().strip_prefix(';') {
            Some(comment) => self.comment(comment),
            None => self.command(line.split(';').next().unwrap_or_default().trim()),
        }
    }

    fn comment(&mut self, comment: &str) {
        let Some((key, value)) = comment.split_once('=') else { return };
        let place = |keys: &[&str]| keys.iter().position(|known| *known == key.trim());
        // Of several tools the first.
        let first = || value.trim().trim_matches(['[', ']']).split(',').next()?.trim().parse::<f64>().ok();
        if let Some((place, celsius)) = place(&NOZZLE_KEYS).zip(first()) {
            take(&mut self.nozzle, celsius, Source::Comment(place));
        } else if let Some((place, celsius)) = place(&BED_KEYS).zip(first()) {
            take(&mut self.bed, celsius, Source::Comment(place));
        }
    }

    fn command(&mut self, text: &str) {
        const CODES: [&str; 5] = ["M104", "M109", "M140", "M190", "SET_HEATER_TEMPERATURE"];
        if !CODES.iter().any(|known| known.eq_ignore_ascii_case(code(text))) {
            return;
        }
        let of_wait = |target| match target {
            WaitTarget::Heating(value) | WaitTarget::HeatingOrCooling(value) => Some(value),
            WaitTarget::Current | WaitTarget::AtLeast(_) => None,
        };
        let (target, value) = match parse(text) {
            Ok(Command::SetNozzle(_, value)) => (&mut self.nozzle, value),
            Ok(Command::WaitNozzle(_, target)) => (&mut self.nozzle, of_wait(target)),
            Ok(Command::SetBed(value)) => (&mut self.bed, value),
            Ok(Command::WaitBed(target)) => (&mut self.bed, of_wait(target)),
            _ => return,
        };
        take(target, value.unwrap_or(Decimal::ZERO).to_f64(), Source::Command);
    }
}

/// Takes a temperature above 0 if its source is better than that of the one before.
fn take(target: &mut Option<Told>, celsius: f64, by: Source) {
    if celsius > 0.0 && celsius.is_finite() && target.is_none_or(|before| by < before.by) {
        *target = Some(Told { celsius, by });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nozzle and bed of a text.
    fn first(text: &str) -> [Option<(f64, Source)>; 2] {
        let mut all: Vec<_> = (1..=text.len())
            .map(|size| {
                let mut targets = FirstTargets::default();
                text.as_bytes().chunks(size).for_each(|portion| targets.read(portion));
                targets.end();
                [targets.nozzle(), targets.bed()].map(|told| told.map(|Told { celsius, by }| (celsius, by)))
            })
            .collect();
        all.dedup();
        assert_eq!(all.len(), 1, "the size of the portions counts: {text}");
        all.remove(0)
    }

    #[test]
    fn commands_come_before_comments() {
        let commands = "M104 S0\n;temperature = 200\nG1 X1 ; M104 S100\nm109 R215.5 ; wait\nM104 S230\rM190 S60";
        assert_eq!(first(commands), [Some((215.5, Source::Command)), Some((60.0, Source::Command))]);
        assert_eq!(first("SET_HEATER_TEMPERATURE HEATER=heater_bed TARGET=70\n")[1], Some((70.0, Source::Command)));
    }

    #[test]
    fn comments_of_slicers() {
        let prusa = "; bed_temperature = 60\n; first_layer_bed_temperature = 65\n; temperature = 215\n";
        assert_eq!(first(prusa), [Some((215.0, Source::Comment(2))), Some((65.0, Source::Comment(0)))]);
        let orca =
            "; nozzle_temperature = 240,240\n; nozzle_temperature_initial_layer = 245,220\n; hot_plate_temp = 100";
        assert_eq!(first(orca), [Some((245.0, Source::Comment(1))), Some((100.0, Source::Comment(4)))]);
        assert_eq!(first("; temperature = warm\n; temperature = -5\n; xtemperature = 9\n;=\n"), [None, None]);
    }

    #[test]
    fn a_long_line_and_other_bytes_are_no_harm() {
        let mut targets = FirstTargets::default();
        targets.read(&[b'x'; 100_000]);
        assert_eq!(targets.line.len(), KEPT_BYTES);
        targets.read(b"\n\xff\xfe\nM104 S200\n");
        assert_eq!(targets.nozzle().map(|told| told.celsius), Some(200.0));
    }
}
