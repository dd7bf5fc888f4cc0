//! Times that slicers leave in comments: of which part of the print each is, where it is, and
//! how it is written.
//!
//! The only place that knows them: those who compare with a slicer's time and those who write
//! another instead agree because they all ask here.

use std::ops::Range;

/// The part of the print that a time is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeOf {
    /// The whole print.
    Print,
    /// The whole print in a printer's silent mode, whose limits are others.
    SilentPrint,
    /// The print without the time before its first layer.
    Model,
    /// The first layer.
    FirstLayer,
    /// The print up to the comment.
    Elapsed,
    /// The print after the comment.
    Remaining,
}

/// The way in which a slicer chooses units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Units {
    /// Always the same ones.
    Fixed,
    /// `1d 2h 3m 4s` without the leading ones that are 0.
    AsNeeded,
}

/// The keys of the comments, in lower case.
const KEYS: [(&str, TimeOf, Units); 18] = [
    // Cura; Griffin and the header of the Ultimaker 3.
    ("time", TimeOf::Print, Units::Fixed),
    ("print.time", TimeOf::Print, Units::Fixed),
    ("time_elapsed", TimeOf::Elapsed, Units::Fixed),
    // ideaMaker.
    ("print time", TimeOf::Print, Units::Fixed),
    ("printing_time", TimeOf::Elapsed, Units::Fixed),
    ("remaining_time", TimeOf::Remaining, Units::Fixed),
    // Bambu Studio, OrcaSlicer: both in a line, or each in its own.
    (MODEL, TimeOf::Model, Units::AsNeeded),
    ("total estimated time", TimeOf::Print, Units::AsNeeded),
    // PrusaSlicer, SuperSlicer, OrcaSlicer, Slic3r.
    ("estimated printing time", TimeOf::Print, Units::AsNeeded),
    ("estimated printing time (normal mode)", TimeOf::Print, Units::AsNeeded),
    ("estimated printing time (silent mode)", TimeOf::SilentPrint, Units::AsNeeded),
    ("estimated first layer printing time (normal mode)", TimeOf::FirstLayer, Units::AsNeeded),
    ("estimated first layer printing time (silent mode)", TimeOf::FirstLayer, Units::AsNeeded),
    // Simplify3D, KISSlicer, IceSL, Kiri:Moto.
    ("build time", TimeOf::Print, Units::Fixed),
    ("estimated build time", TimeOf::Print, Units::Fixed),
    ("calculated-during-export build time", TimeOf::Print, Units::Fixed),
    ("estimated_print_time_s", TimeOf::Print, Units::Fixed),
    ("--- print time", TimeOf::Print, Units::Fixed),
];

/// The key after whose time another may follow in the same comment.
const MODEL: &str = "model printing time";

/// The most decimals of a time.
const MAX_DECIMALS: usize = 6;

/// A time in a comment.
#[derive(Clone, Debug, PartialEq)]
pub struct SlicerTime {
    /// The part of the print that it is of.
    pub of: TimeOf,
    /// The time, s.
    pub seconds: f64,
    /// Place of the time in the comment, bytes.
    pub place: Range<usize>,
    form: Form,
}

/// The way in which a time is written.
#[derive(Clone, Debug, PartialEq)]
enum Form {
    /// Seconds as a number with this number of decimals.
    Number(usize),
    /// `1d 2h 3m 4s` without the leading units that are 0.
    AsNeeded,
    /// Units, the last with this number of decimals.
    Units(Vec<Unit>, usize),
}

/// A unit as it is written.
#[derive(Clone, Debug, PartialEq)]
struct Unit {
    seconds: u64,
    /// The text between number and name.
    gap: String,
    name: String,
    /// The text up to the next number.
    after: String,
}

impl SlicerTime {
    /// Writes another time as this one is written, rounded to its last digit.
    pub fn written(&self, seconds: f64) -> String {
        let seconds = seconds.max(0.0);
        match &self.form {
            Form::Number(decimals) => format!("{seconds:.decimals$}"),
            Form::AsNeeded => as_needed(seconds.round() as u64),
            Form::Units(units, decimals) => in_units(seconds, units, *decimals),
        }
    }
}

/// The times of a comment, which may begin with `;`: none, one, or a model's and that of the print.
pub fn slicer_times(comment: &str) -> impl Iterator<Item = SlicerTime> {
    let start = comment.len() - comment.trim_start_matches([';', ' ', '\t']).len();
    let (first, next) = (part(comment, start), comment.get(start..).and_then(|rest| rest.find(';')));
    let is_model = first.as_ref().is_some_and(|time| time.of == TimeOf::Model);
    let second = next.filter(|_| is_model).and_then(|next| part(comment, start + next + 1));
    first.into_iter().chain(second)
}

/// The time of the part of a comment that begins at a place and ends at a `;`.
fn part(comment: &str, start: usize) -> Option<SlicerTime> {
    let text = comment.get(start..)?.split(';').next()?;
    let colon = text.find([':', '='])?;
    let key = text.get(..colon)?.trim();
    let (_, of, units) = KEYS.into_iter().find(|(known, ..)| known.eq_ignore_ascii_case(key))?;
    let value = text.get(colon + 1..)?;
    let from = start + colon + 1 + (value.len() - value.trim_start().len());
    // Kiri:Moto ends its remarks as it begins them.
    let value = value.trim();
    let value = value.strip_suffix("---").unwrap_or(value).trim_end();
    let (seconds, form) = read(value, units)?;
    Some(SlicerTime { of, seconds, place: from..from + value.len(), form })
}

/// `1234.5`, `1d 2h 3m 4s`, `1 hour 17 minutes`, `113.73 minutes`.
fn read(text: &str, units: Units) -> Option<(f64, Form)> {
    let is_digit = |char: char| char.is_ascii_digit() || char == '.';
    let (mut total_s, mut rest, mut found) = (0.0, text, Vec::<Unit>::new());
    let mut decimals = 0;
    while !rest.is_empty() {
        // A part of a unit is written in the next smaller one.
        if decimals > 0 {
            return None;
        }
        let digits = rest.find(|char| !is_digit(char)).unwrap_or(rest.len());
        let (number, after) = rest.split_at_checked(digits)?;
        let amount = number.parse::<f64>().ok().filter(|number| number.is_finite())?;
        decimals = number.split_once('.').map_or(0, |(_, decimals)| decimals.len());
        if decimals > MAX_DECIMALS {
            return None;
        }
        if after.is_empty() && found.is_empty() {
            return Some((amount, Form::Number(decimals)));
        }
        let (gap, after) = split(after, |char| char == ' ')?;
        let (name, after) = split(after, |char| char.is_ascii_alphabetic())?;
        let (between, after) = split(after, |char| [' ', '\t', ','].contains(&char))?;
        let seconds = unit_s(name)?;
        if found.last().is_some_and(|larger| larger.seconds <= seconds) {
            return None;
        }
        total_s += amount * seconds as f64;
        found.push(Unit { seconds, gap: gap.to_owned(), name: name.to_owned(), after: between.to_owned() });
        rest = after;
    }
    let is_as_needed = units == Units::AsNeeded && decimals == 0;
    if found.is_empty() {
        return None;
    }
    Some((total_s, if is_as_needed { Form::AsNeeded } else { Form::Units(found, decimals) }))
}

/// Splits a text before the first character of another kind.
fn split(text: &str, is_of_kind: impl Fn(char) -> bool) -> Option<(&str, &str)> {
    text.split_at_checked(text.find(|char| !is_of_kind(char)).unwrap_or(text.len()))
}

fn unit_s(name: &str) -> Option<u64> {
    match name.to_ascii_lowercase().as_str() {
        "d" | "day" | "days" => Some(86_400),
        "h" | "hr" | "hrs" | "hour" | "hours" => Some(3_600),
        "m" | "min" | "mins" | "minute" | "minutes" => Some(60),
        "s" | "sec" | "secs" | "second" | "seconds" => Some(1),
        _ => None,
    }
}

fn as_needed(seconds: u64) -> String {
    let (days, hours, minutes) = (seconds / 86_400, seconds / 3_600 % 24, seconds / 60 % 60);
    let seconds = seconds % 60;
    match (days, hours, minutes) {
        (0, 0, 0) => format!("{seconds}s"),
        (0, 0, _) => format!("{minutes}m {seconds}s"),
        (0, ..) => format!("{hours}h {minutes}m {seconds}s"),
        _ => format!("{days}d {hours}h {minutes}m {seconds}s"),
    }
}

fn in_units(seconds: f64, units: &[Unit], decimals: usize) -> String {
    let Some((last, larger)) = units.split_last() else { return String::new() };
    let scale = 10_f64.powi(decimals as i32);
    // Rounded once, so that 59.9 minutes do not become 60.
    let mut left_s = (seconds / last.seconds as f64 * scale).round() / scale * last.seconds as f64;
    let mut text = String::new();
    for unit in larger {
        // A whole number of the last unit that rounding has left a little below it.
        let count = ((left_s + 1e-6) / unit.seconds as f64).floor();
        left_s -= count * unit.seconds as f64;
        text += &format!("{count}{}{}{}", unit.gap, named(&unit.name, count == 1.0), unit.after);
    }
    let amount = left_s.max(0.0) / last.seconds as f64;
    text + &format!("{amount:.decimals$}{}{}{}", last.gap, named(&last.name, amount == 1.0), last.after)
}

/// The name of a unit for one or for several, if it is a whole word.
fn named(name: &str, is_one: bool) -> String {
    let stem = name.strip_suffix(['s', 'S']).unwrap_or(name);
    let is_word = ["day", "hour", "minute", "second"].iter().any(|word| word.eq_ignore_ascii_case(stem));
    if !is_word {
        return name.to_owned();
    }
    if is_one { stem.to_owned() } else { format!("{stem}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The comment with another time in place of each of its times.
    fn with(comment: &str, seconds: f64) -> String {
        let mut text = comment.to_owned();
        let times: Vec<SlicerTime> = slicer_times(comment).collect();
        times.into_iter().rev().for_each(|time| text.replace_range(time.place.clone(), &time.written(seconds)));
        text
    }

    #[test]
    fn each_slicer_keeps_its_form() {
        for (comment, seconds, expected) in [
            (";TIME:6666", 1234.5, ";TIME:1234"),
            (";TIME:6666.25", 1234.5, ";TIME:1234.50"),
            (";PRINT.TIME:480", 60.0, ";PRINT.TIME:60"),
            (";TIME_ELAPSED:12.345678", 0.5, ";TIME_ELAPSED:0.500000"),
            (";Print Time: 2655", 59.6, ";Print Time: 60"),
            (";PRINTING_TIME: 12", 3.2, ";PRINTING_TIME: 3"),
            (";REMAINING_TIME: 12", 3.2, ";REMAINING_TIME: 3"),
            (
                "; estimated printing time (normal mode) = 21m 40s",
                93_784.4,
                "; estimated printing time (normal mode) = 1d 2h 3m 4s",
            ),
            (
                "; estimated printing time (silent mode) = 1d 2h 3m 4s",
                3600.0,
                "; estimated printing time (silent mode) = 1h 0m 0s",
            ),
            ("; estimated printing time = 1h 0m 0s", 59.6, "; estimated printing time = 1m 0s"),
            (
                "; estimated first layer printing time (normal mode) = 45s",
                61.0,
                "; estimated first layer printing time (normal mode) = 1m 1s",
            ),
            (
                "; model printing time: 45s; total estimated time: 6m 50s",
                7.0,
                "; model printing time: 7s; total estimated time: 7s",
            ),
            ("; total estimated time: 6m 50s ", 7.0, "; total estimated time: 7s "),
            (";   Build time: 1 hour 17 minutes", 7260.0, ";   Build time: 2 hours 1 minute"),
            (";   Build time: 0 hours 2 minutes", 3599.0, ";   Build time: 1 hour 0 minutes"),
            (";   Build Time: 1 hour, 17 min", 7260.0, ";   Build Time: 2 hours, 1 min"),
            ("; Estimated Build Time:   113.73 minutes", 90.0, "; Estimated Build Time:   1.50 minutes"),
            (
                "; Calculated-during-export Build Time: 85.31 minutes",
                61.0,
                "; Calculated-during-export Build Time: 1.02 minutes",
            ),
            ("; estimated_print_time_s : 1234.5", 2.0, "; estimated_print_time_s : 2.0"),
            (";; --- print time: 1234s ---", 6000.0, ";; --- print time: 6000s ---"),
        ] {
            assert_eq!(with(comment, seconds), expected, "{comment}");
            assert_eq!(with(expected, seconds), expected, "the second time");
        }
    }

    #[test]
    fn others_are_no_times() {
        for comment in [
            ";TIME:",
            ";TIME:nan",
            ";TIME:12:30",
            ";TIME:1.12345678901234567890",
            "; estimated printing time (normal mode) = soon",
            "; estimated printing time (loud mode) = 1m",
            "; Build time: 2 minutes 1 hour",
            "; Build time: 1.5 hours 2 minutes",
            "; fan_time: 5",
            ";TYPE:wall;TIME:5",
            "; ümläut: 5",
            ";",
        ] {
            assert_eq!(slicer_times(comment).collect::<Vec<_>>(), [], "{comment}");
        }
    }
}
