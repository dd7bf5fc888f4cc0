//! Commands with names, `SET_VELOCITY_LIMIT ACCEL=3000`, which slicers write for Klipper: those
//! that mean something here.
//!
//! Names and words count in upper and lower case. Commands without effect here are in
//! [`crate::NOT_EXECUTED`].

use super::code::Code;
use super::pin;
use crate::not_executed::is_one_of;
use crate::remarks::{Remark, Remarks};
use crate::{
    AdvanceWords, AxisWords, BedArea, BedCommand, Command, Decimal, NotExecuted, ParseError, ShaperWords, ShortText,
    SkewCommand, WaitTarget,
};

mod offset;
mod skew;
mod tower;

/// 1 as [`Decimal::nanos`] has it.
const ONE: i64 = 1_000_000_000;

/// A heater or thermometer by Klipper's name.
enum Heater {
    Nozzle,
    Nozzle1,
    Bed,
    Chamber,
}

/// The words after a name: `KEY=VALUE`.
#[derive(Clone, Copy)]
pub(super) struct NamedWords<'a> {
    /// The command, and how its words are written, for errors.
    command: &'static str,
    form: &'static str,
    /// The keys of its words, divided by `, `.
    known: &'static str,
    text: &'a [u8],
}

/// The words of a text, divided by blanks; those between a pair of `"` or `'` belong to one word.
struct Divided<'a>(&'a [u8]);

impl<'a> Iterator for Divided<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let is_blank = |byte: &u8| matches!(byte, b' ' | b'\t');
        let start = self.0.iter().position(|byte| !is_blank(byte))?;
        let text = self.0.get(start..)?;
        let mut quote = None;
        let end = text.iter().position(|byte| {
            match quote {
                Some(open) if open == *byte => quote = None,
                None if matches!(byte, b'"' | b'\'') => quote = Some(*byte),
                None => return is_blank(byte),
                Some(_) => {}
            }
            false
        });
        let (word, rest) = text.split_at_checked(end.unwrap_or(text.len()))?;
        self.0 = rest;
        Some(word)
    }
}

/// A value without the quotes around it.
fn unquoted(value: &[u8]) -> &[u8] {
    match value {
        [b'"', inner @ .., b'"'] | [b'\'', inner @ .., b'\''] => inner,
        _ => value,
    }
}

impl<'a> NamedWords<'a> {
    /// The value of a word; of several the last counts.
    #[inline(never)]
    pub(super) fn value(&self, key: &str) -> Option<&'a [u8]> {
        let mut value = None;
        for word in Divided(self.text) {
            if let Some((found, [b'=', rest @ ..])) = word.split_at_checked(key.len())
                && is_one_of(key.as_bytes(), found)
            {
                value = Some(unquoted(rest));
            }
        }
        value
    }

    /// The keys; empty for a word without a key.
    fn keys(&self) -> impl Iterator<Item = &'a [u8]> {
        let words = Divided(self.text);
        words.map(|word| word.iter().position(|byte| *byte == b'=').and_then(|end| word.get(..end)).unwrap_or_default())
    }

    /// The words that the command does not have, each as it names itself.
    fn unknown(&self) -> impl Iterator<Item = ShortText> {
        let known = self.known.as_bytes();
        let names = Divided(self.text).zip(self.keys()).map(|(word, key)| if key.is_empty() { word } else { key });
        // Cut at ASCII, so that they are text still.
        let unknown = names.filter(move |name| !is_one_of(known, name));
        unknown.map(|name| ShortText::new(core::str::from_utf8(name).unwrap_or_default()))
    }

    /// True if one of the command's words lacks `=` and its value.
    fn lacks_value(&self) -> bool {
        let is_bare = |word: &[u8]| !word.contains(&b'=') && is_one_of(self.known.as_bytes(), word);
        Divided(self.text).any(is_bare)
    }

    /// Refuses a line that has words, and none that the command has: it would be
    /// taken for a question.
    fn must_be_known(&self) -> Result<(), ParseError> {
        let all_unknown = self.unknown().count() == self.keys().count();
        if all_unknown && self.unknown().next().is_some() { Err(self.expected()) } else { Ok(()) }
    }

    /// The value of a word as text.
    fn value_text(&self, key: &str) -> Option<&'a str> {
        // Cut at blanks, so that it is text still.
        self.value(key).map(|value| core::str::from_utf8(value).unwrap_or_default())
    }

    /// The number of a word.
    #[inline(never)]
    fn number(&self, key: &str) -> Result<Option<Decimal>, ParseError> {
        match self.value(key).map(Decimal::parse) {
            None => Ok(None),
            Some(Ok(number)) => Ok(Some(number)),
            Some(Err(_)) => Err(self.expected()),
        }
    }

    /// A number above zero.
    fn above_zero(&self, key: &str) -> Result<Option<Decimal>, ParseError> {
        match self.number(key)? {
            Some(number) if number <= Decimal::ZERO => Err(self.expected()),
            number => Ok(number),
        }
    }

    /// A number that is not negative, without its fraction.
    fn count(&self, key: &str) -> Result<Option<u32>, ParseError> {
        let number = self.number(key)?.map(|number| u32::try_from(number.to_i64_towards_zero()));
        number.transpose().map_err(|_| self.expected())
    }

    /// The heater that a word names; `None`: the machine has no such one, which is remarked.
    #[inline(never)]
    fn heater(&self, key: &str, remarks: &mut Remarks) -> Result<Option<Heater>, ParseError> {
        // Klipper's chamber is a `heater_generic chamber` or a `temperature_sensor chamber`.
        let name = self.value(key).and_then(|name| name.rsplit(|byte| *byte == b' ').next()).ok_or(self.expected())?;
        let known = [
            ("extruder", Heater::Nozzle),
            ("extruder1", Heater::Nozzle1),
            ("heater_bed", Heater::Bed),
            ("chamber", Heater::Chamber),
        ];
        for (known, heater) in known {
            if is_one_of(known.as_bytes(), name) {
                return Ok(Some(heater));
            }
        }
        remarks.add(Remark::OtherHeater);
        Ok(None)
    }

    /// The tool whose extruder a word names, as Klipper has it: `extruder`, `extruder1`. Any other
    /// name is of one that no machine has.
    fn extruder(&self, key: &str) -> Option<u8> {
        let name = self.value(key)?;
        let number = EXTRUDERS.iter().position(|known| is_one_of(known.as_bytes(), name));
        Some(number.and_then(|number| u8::try_from(number).ok()).unwrap_or(u8::MAX))
    }

    /// The error of a line without a word that it needs, or with one that cannot be read. A word
    /// that the command does not have is the likeliest cause.
    pub(super) fn expected(&self) -> ParseError {
        let (command, words) = (self.command, self.form);
        match self.unknown().next() {
            Some(word) => ParseError::UnknownWord { command, word, words },
            None => ParseError::WordsExpected { command, words },
        }
    }
}

/// Klipper's names of extruders, by their tools.
const EXTRUDERS: [&str; 2] = ["extruder", "extruder1"];

/// The names that are executed, each with the keys of its words, and how they are written.
const EXECUTED: [(&str, &str, &str); 25] = [
    ("SET_VELOCITY_LIMIT", VELOCITY_WORDS, "VELOCITY or ACCEL with a number above 0"),
    (
        "SET_HEATER_TEMPERATURE",
        "HEATER, TARGET",
        "HEATER=extruder, extruder1, heater_bed or chamber, and TARGET with a number",
    ),
    (
        "TEMPERATURE_WAIT",
        "SENSOR, MINIMUM, MAXIMUM",
        "SENSOR=extruder, extruder1, heater_bed or chamber, and MINIMUM or MAXIMUM with a number",
    ),
    ("SET_PRINT_STATS_INFO", "TOTAL_LAYER, CURRENT_LAYER", "TOTAL_LAYER or CURRENT_LAYER with a number"),
    (
        "SET_INPUT_SHAPER",
        SHAPER_WORDS,
        "SHAPER_TYPE, SHAPER_TYPE_X or SHAPER_TYPE_Y with a kind, SHAPER_FREQ_X, SHAPER_FREQ_Y, DAMPING_RATIO_X or \
         DAMPING_RATIO_Y with a number",
    ),
    ("SET_PRESSURE_ADVANCE", "EXTRUDER, ADVANCE, SMOOTH_TIME", "ADVANCE or SMOOTH_TIME with a number"),
    ("TURN_OFF_HEATERS", "", ""),
    ("TUNING_TOWER", tower::WORDS, tower::FORM),
    ("SET_FAN_SPEED", "FAN, SPEED", "FAN with a name, and SPEED with a number from 0 to 1"),
    ("SET_PIN", "PIN, VALUE", "PIN with a name, and VALUE with a number from 0 to 1"),
    ("PAUSE", "", ""),
    ("RESUME", "", ""),
    ("BED_MESH_CALIBRATE", "MESH_MIN, MESH_MAX", "MESH_MIN and MESH_MAX with x,y, or neither"),
    ("BED_MESH_CLEAR", "", ""),
    ("PROBE_ACCURACY", "SAMPLES", "SAMPLES with a number up to 255"),
    ("SCREWS_TILT_CALCULATE", "", ""),
    ("SET_SKEW", "XY, XZ, YZ, CLEAR", skew::SET),
    ("CALC_MEASURED_SKEW", "AC, BD, AD", skew::CALCULATE),
    ("GET_CURRENT_SKEW", "", ""),
    ("BLTOUCH_DEBUG", "COMMAND", pin::DEBUG_WORDS),
    ("ACTIVATE_EXTRUDER", "EXTRUDER", "EXTRUDER=extruder or extruder1"),
    ("Z_TILT_ADJUST", ALIGN_KEYS, ALIGN_WORDS),
    ("QUAD_GANTRY_LEVEL", ALIGN_KEYS, ALIGN_WORDS),
    (
        "SET_LED",
        "LED, RED, GREEN, BLUE, WHITE",
        "LED with a name, and RED, GREEN, BLUE or WHITE with a number from 0 to 1",
    ),
    ("SET_GCODE_OFFSET", offset::WORDS, offset::FORM),
];

const ALIGN_KEYS: &str = "RETRIES, RETRY_TOLERANCE";
const ALIGN_WORDS: &str = "RETRIES with a number up to 29, RETRY_TOLERANCE with one above 0, or neither";

/// Maximum number of retries: one less than the rounds of Marlin's G34.
const MOST_RETRIES: u32 = 29;

/// Reads a line that begins with a name, known or not.
#[cold]
pub(super) fn parse<'a>(code: &Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let line = code.text.trim_matches([' ', '\t']).as_bytes();
    let length = line.iter().position(|byte| matches!(byte, b' ' | b'\t')).unwrap_or(line.len());
    let (name, text) = line.split_at_checked(length).unwrap_or((line, &[]));
    let executed = EXECUTED.iter().position(|(known, ..)| is_one_of(known.as_bytes(), name));
    let Some((index, (command, known, form))) = executed.and_then(|index| Some((index, *EXECUTED.get(index)?))) else {
        return code.outcome(NotExecuted::find_named(name), remarks);
    };
    let words = NamedWords { command, form, known, text };
    if words.lacks_value() {
        return Err(words.expected());
    }
    let parsed = executed_one(index, &words, remarks)?;
    let mut unknown = words.unknown();
    if let Some(word) = unknown.next() {
        remarks.add(Remark::UnknownWord(word, unknown.next().is_some()));
    }
    Ok(parsed)
}

/// Reads the words of one of [`EXECUTED`].
fn executed_one<'a>(index: usize, words: &NamedWords<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    Ok(match index {
        0 => velocity_limit(words, remarks)?,
        1 => {
            // A missing target means off, as in Klipper.
            let target = Some(words.number("TARGET")?.unwrap_or(Decimal::ZERO).max(Decimal::ZERO));
            match words.heater("HEATER", remarks)? {
                // Klipper's names are of the extruder, whichever is selected.
                Some(Heater::Nozzle) => Command::SetNozzle(Some(0), target),
                Some(Heater::Nozzle1) => Command::SetNozzle(Some(1), target),
                Some(Heater::Bed) => Command::SetBed(target),
                Some(Heater::Chamber) => Command::SetChamber(target),
                None => Command::Accepted,
            }
        }
        2 => temperature_wait(words, remarks)?,
        3 => Command::Layer { current: words.count("CURRENT_LAYER")?, total: words.count("TOTAL_LAYER")? },
        4 => input_shaper(words)?,
        5 => pressure_advance(words)?,
        6 => Command::HeatersOff,
        7 => Command::Tower(tower::parse(words)?),
        8 => fan(words, "FAN", "SPEED", remarks)?,
        9 => fan(words, "PIN", "VALUE", remarks)?,
        10 => Command::Pause(AxisWords::default()),
        11 => Command::ResumePrint,
        12 => Command::Bed(BedCommand::Measure { area: mesh_area(words)?, unless_on: false }),
        13 => Command::Bed(BedCommand::Clear),
        15 => Command::Bed(BedCommand::Screws),
        16 => Command::Skew(skew::set(words)?),
        17 => Command::Skew(skew::calculate(words)?),
        18 => Command::Skew(SkewCommand::Report),
        19 => pin::debug(words)?,
        20 => {
            // The nozzle stays, as Klipper's does.
            let tool = words.extruder("EXTRUDER").ok_or(words.expected())?;
            Command::SelectTool { tool: Some(tool.into()), stays: true }
        }
        21 | 22 => align(words)?,
        23 => light(words)?,
        24.. => offset::parse(words)?,
        _ => {
            let samples = words.count("SAMPLES")?.map(u8::try_from).transpose().map_err(|_| words.expected())?;
            Command::Bed(BedCommand::Repeat { samples, x: None, y: None })
        }
    })
}

/// Z_TILT_ADJUST and QUAD_GANTRY_LEVEL.
fn align<'a>(words: &NamedWords<'a>) -> Result<Command<'a>, ParseError> {
    let (retries, accuracy) = (words.count("RETRIES")?, words.above_zero("RETRY_TOLERANCE")?);
    if retries.is_some_and(|retries| retries > MOST_RETRIES) {
        return Err(words.expected());
    }
    let rounds = retries.map(|retries| retries as u8 + 1);
    Ok(Command::Bed(BedCommand::Align { rounds, accuracy, amplification: None }))
}

/// SET_FAN_SPEED and SET_PIN. Klipper's pins may have another full value than 1 (`scale`): more is
/// full power, with a remark.
#[inline(never)]
fn fan<'a>(words: &NamedWords<'a>, name: &str, value: &str, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let (name, speed) = (words.value_text(name), words.number(value)?);
    let (Some(name), Some(speed)) = (name.filter(|name| !name.is_empty()), speed) else { return Err(words.expected()) };
    // A share of full power.
    let power = match speed.nanos() {
        ..0 => return Err(words.expected()),
        nanos @ ..=ONE => ((nanos * 255 + ONE / 2) / ONE) as u8,
        _ => {
            remarks.add(Remark::TooLarge(value.as_bytes().first().copied().unwrap_or(b'S')));
            u8::MAX
        }
    };
    Ok(Command::NamedFan { name, power })
}

/// SET_LED: Klipper's, of a machine with one light. A colour that is not named is off.
#[inline(never)]
fn light<'a>(words: &NamedWords<'a>) -> Result<Command<'a>, ParseError> {
    let mut colors = [0; 4];
    for (color, name) in colors.iter_mut().zip(["RED", "GREEN", "BLUE", "WHITE"]) {
        *color = match words.number(name)?.unwrap_or(Decimal::ZERO).nanos() {
            share @ 0..=ONE => ((share * 255 + ONE / 2) / ONE) as u8,
            _ => return Err(words.expected()),
        };
    }
    Ok(Command::SetLight { colors })
}

/// The part of the bed of BED_MESH_CALIBRATE.
#[inline(never)]
fn mesh_area(words: &NamedWords<'_>) -> Result<Option<BedArea>, ParseError> {
    let [from, to] = ["MESH_MIN", "MESH_MAX"].map(|key| words.value(key));
    let (from, to) = match (from, to) {
        (None, None) => return Ok(None),
        (Some(from), Some(to)) => (from, to),
        _ => return Err(words.expected()),
    };
    let pair = |text: &[u8]| -> Result<[Decimal; 2], ParseError> {
        let mut numbers = text.split(|byte| *byte == b',').map(Decimal::parse);
        match (numbers.next(), numbers.next(), numbers.next()) {
            (Some(Ok(x)), Some(Ok(y)), None) => Ok([x, y]),
            _ => Err(words.expected()),
        }
    };
    let ([left, front], [right, back]) = (pair(from)?, pair(to)?);
    let [left, right, front, back] = [left, right, front, back].map(Some);
    Ok(Some(BedArea { left, right, front, back, is_size: false }))
}

/// TEMPERATURE_WAIT.
#[inline(never)]
fn temperature_wait(words: &NamedWords<'_>, remarks: &mut Remarks) -> Result<Command<'static>, ParseError> {
    let (minimum, maximum) = (words.number("MINIMUM")?, words.number("MAXIMUM")?);
    let heater = words.heater("SENSOR", remarks)?;
    if maximum.is_some() {
        remarks.add(Remark::WaitsForHeatOnly);
    } else if minimum.is_none() {
        return Err(words.expected());
    }
    Ok(match heater.zip(minimum) {
        Some((Heater::Nozzle, _)) => Command::WaitNozzle(Some(0), WaitTarget::Current),
        Some((Heater::Nozzle1, _)) => Command::WaitNozzle(Some(1), WaitTarget::Current),
        Some((Heater::Bed, _)) => Command::WaitBed(WaitTarget::Current),
        // A chamber without a heater has no target.
        Some((Heater::Chamber, minimum)) => Command::WaitChamber(WaitTarget::AtLeast(minimum)),
        None => Command::Accepted,
    })
}

/// The words of SET_VELOCITY_LIMIT.
const VELOCITY_WORDS: &str = "VELOCITY, ACCEL, SQUARE_CORNER_VELOCITY, ACCEL_TO_DECEL, MINIMUM_CRUISE_RATIO";

/// SET_VELOCITY_LIMIT.
#[inline(never)]
fn velocity_limit(words: &NamedWords<'_>, remarks: &mut Remarks) -> Result<Command<'static>, ParseError> {
    let (velocity, acceleration) = (words.above_zero("VELOCITY")?, words.above_zero("ACCEL")?);
    let corner = words.above_zero("SQUARE_CORNER_VELOCITY")?;
    let [cruise_ratio, to_deceleration] = ["MINIMUM_CRUISE_RATIO", "ACCEL_TO_DECEL"].map(|key| words.value(key));
    if cruise_ratio.is_some() || to_deceleration.is_some() {
        remarks.add(Remark::CornerLimits);
    } else if velocity.is_none() && acceleration.is_none() && corner.is_none() {
        return Err(words.expected());
    }
    let [cruise_ratio, to_deceleration] = [cruise_ratio, to_deceleration].map(|value| Decimal::parse(value?).ok());
    Ok(Command::VelocityLimit { velocity, acceleration, corner, cruise_ratio, to_deceleration })
}

/// SET_PRESSURE_ADVANCE.
#[inline(never)]
fn pressure_advance(words: &NamedWords<'_>) -> Result<Command<'static>, ParseError> {
    words.must_be_known()?;
    let tool = words.extruder("EXTRUDER");
    let (slow, smooth_time) = (words.number("ADVANCE")?, words.number("SMOOTH_TIME")?);
    Ok(Command::PressureAdvance(tool, AdvanceWords { slow, smooth_time, ..AdvanceWords::default() }))
}

/// The words of SET_INPUT_SHAPER, and those of an axis that has no filter here.
const SHAPER_WORDS: &str =
    "SHAPER_TYPE, SHAPER_TYPE_X, SHAPER_TYPE_Y, SHAPER_FREQ_X, SHAPER_FREQ_Y, DAMPING_RATIO_X, DAMPING_RATIO_Y";
const SHAPER_WORDS_OF_Z: &str = "SHAPER_TYPE_Z, SHAPER_FREQ_Z, DAMPING_RATIO_Z";

/// SET_INPUT_SHAPER.
#[inline(never)]
fn input_shaper<'a>(words: &NamedWords<'a>) -> Result<Command<'a>, ParseError> {
    if words.keys().any(|key| is_one_of(SHAPER_WORDS_OF_Z.as_bytes(), key)) {
        let why = "only X and Y have input shapers; leave the words of Z out";
        return Err(ParseError::NotSupported { command: "SET_INPUT_SHAPER of Z", why });
    }
    words.must_be_known()?;
    let both = words.value_text("SHAPER_TYPE");
    let axis = |kind, frequency, damping| -> Result<ShaperWords<'a>, ParseError> {
        let kind = words.value_text(kind);
        if both.is_some() && kind.is_some() {
            let why = "of two kinds for an axis one is meant; write SHAPER_TYPE, or SHAPER_TYPE_X and SHAPER_TYPE_Y";
            return Err(ParseError::NotSupported { command: "SHAPER_TYPE with the type of an axis", why });
        }
        Ok(ShaperWords { kind: kind.or(both), frequency: words.number(frequency)?, damping: words.number(damping)? })
    };
    let x = axis("SHAPER_TYPE_X", "SHAPER_FREQ_X", "DAMPING_RATIO_X")?;
    let y = axis("SHAPER_TYPE_Y", "SHAPER_FREQ_Y", "DAMPING_RATIO_Y")?;
    Ok(Command::InputShaper { axes: [x, y], usual: "mzv" })
}
