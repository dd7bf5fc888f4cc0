//! A live value that changes with the height of the print (TUNING_TOWER).

use core::fmt;
use core::fmt::Write as _;

use ferrostep_gcode::{Command, Decimal, Remarks, ShortText, TowerCourse, TowerWords, parse, parse_with_remarks};

/// Maximum number of bytes of the command with the name of its parameter.
const MAX_PREFIX: usize = 64;

/// The same with the value: at most a sign, ten digits, a point and nine digits.
const MAX_LINE: usize = MAX_PREFIX + 21;

/// Units of 10 nm in a millimetre.
pub(crate) const MM: i64 = 100_000;

/// The line that sets the value.
pub(crate) type TowerLine = heapless::String<MAX_LINE>;

/// Reason why a tower is not possible.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TowerRefusal {
    /// The command sets no value that may change in a print.
    NotLive(ShortText),
    /// The command has no number of this name.
    NoNumber(ShortText),
    /// The command and its parameter are too long.
    TooLong,
    /// A prepared job comes.
    InJob,
}

impl fmt::Display for TowerRefusal {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotLive(command) => write!(
                out,
                "COMMAND: {command} sets no value of a print, expected M104, M106, M140, M201, M203, M204, M205, M207, M208, M220, \
                 M221, M572, M593, M795, M900, or SET_HEATER_TEMPERATURE, SET_INPUT_SHAPER, SET_PRESSURE_ADVANCE, \
                 SET_VELOCITY_LIMIT"
            ),
            Self::NoNumber(parameter) => {
                write!(out, "PARAMETER: this command has no plain number {parameter}, expected one such as K of M900")
            }
            Self::TooLong => write!(out, "COMMAND and PARAMETER: expected at most {MAX_PREFIX} characters"),
            Self::InJob => out.write_str("a prepared job has its own values: TUNING_TOWER needs G-code"),
        }
    }
}

/// A value that changes with the height.
#[derive(Clone, Debug)]
pub(crate) struct Tower {
    /// `M900 K`, `SET_PRESSURE_ADVANCE ADVANCE=`: the text before the value.
    pub(crate) prefix: heapless::String<MAX_PREFIX>,
    /// Bytes of it before the parameter.
    command_bytes: usize,
    pub(crate) start: Decimal,
    skip: Decimal,
    course: TowerCourse,
    /// Height of the newest extrusion, machine coordinates in units of 10 nm.
    pub(crate) height_10nm: Option<i64>,
    /// The value that was set last.
    pub(crate) value: Option<Decimal>,
}

/// Returns true if a command sets a value that may change in a print.
fn is_live(command: &Command<'_>) -> bool {
    matches!(
        command,
        Command::SetNozzle(..)
            | Command::SetBed(_)
            | Command::Fan { number: 0, .. }
            | Command::FeedPercent(_)
            | Command::FlowPercent(..)
            | Command::ReportSetting(_)
            | Command::MaxAcceleration(_)
            | Command::MaxFeed(_)
            | Command::Acceleration { .. }
            | Command::VelocityLimit { .. }
            | Command::Junction { .. }
            | Command::RetractSettings(_)
            | Command::RecoverSettings(_)
            | Command::AdaptiveExtrusion { .. }
            | Command::InputShaper { .. }
            | Command::PressureAdvance(..)
    )
}

/// Returns `true` if two commands differ in a value that may change in a print, and not only in the
/// tool that they name. `==` on commands of every kind would take 2 KB of an image.
fn values_differ(one: &Command<'_>, two: &Command<'_>) -> bool {
    use Command as C;
    match (one, two) {
        (C::SetNozzle(_, one), C::SetNozzle(_, two)) | (C::SetBed(one), C::SetBed(two)) => one != two,
        (C::FlowPercent(_, one), C::FlowPercent(_, two)) => one != two,
        (C::Fan { number: 0, power: one }, C::Fan { number: 0, power: two }) => one != two,
        (C::FeedPercent(one), C::FeedPercent(two)) => one != two,
        (C::MaxAcceleration(one), C::MaxAcceleration(two)) | (C::MaxFeed(one), C::MaxFeed(two)) => one != two,
        (
            C::Acceleration { print, retract, travel, both },
            C::Acceleration { print: print_2, retract: retract_2, travel: travel_2, both: both_2 },
        ) => (print, retract, travel, both) != (print_2, retract_2, travel_2, both_2),
        (
            C::VelocityLimit { velocity, acceleration, corner, .. },
            C::VelocityLimit { velocity: velocity_2, acceleration: acceleration_2, corner: corner_2, .. },
        ) => (velocity, acceleration, corner) != (velocity_2, acceleration_2, corner_2),
        (
            C::Junction { deviation, corner_velocity },
            C::Junction { deviation: deviation_2, corner_velocity: corner_velocity_2 },
        ) => (deviation, corner_velocity) != (deviation_2, corner_velocity_2),
        (C::RetractSettings(one), C::RetractSettings(two)) => one != two,
        (C::RecoverSettings(one), C::RecoverSettings(two)) => one != two,
        (
            C::AdaptiveExtrusion { layer_height, line_width, filament_diameter, .. },
            C::AdaptiveExtrusion {
                layer_height: layer_height_2,
                line_width: line_width_2,
                filament_diameter: filament_diameter_2,
                ..
            },
        ) => (layer_height, line_width, filament_diameter) != (layer_height_2, line_width_2, filament_diameter_2),
        (C::InputShaper { axes: one, .. }, C::InputShaper { axes: two, .. }) => one != two,
        (C::PressureAdvance(_, one), C::PressureAdvance(_, two)) => one != two,
        _ => false,
    }
}

impl Tower {
    // Not inlined, as the one below: both need much of the stack, and never at once.
    #[inline(never)]
    pub(crate) fn new(words: &TowerWords<'_>) -> Result<Self, TowerRefusal> {
        let TowerWords { command, parameter, start, skip, course } = *words;
        if parse(command).is_ok_and(|command| !is_live(&command)) {
            return Err(TowerRefusal::NotLive(ShortText::new(command)));
        }
        // `M900`, and no name.
        let is_code = matches!(command.as_bytes(), [_, b'0'..=b'9', ..]);
        let is_name = parameter.bytes().all(|byte| byte.is_ascii_alphabetic() || (byte == b'_' && !is_code));
        if !is_name || parameter.is_empty() || (is_code && parameter.len() > 1) {
            return Err(TowerRefusal::NoNumber(ShortText::new(parameter)));
        }
        let mut prefix = heapless::String::new();
        write!(prefix, "{command} {parameter}{}", if is_code { "" } else { "=" }).map_err(|_| TowerRefusal::TooLong)?;
        Ok(Self { prefix, command_bytes: command.len(), start, skip, course, height_10nm: None, value: None })
    }

    /// Returns true if a number changes the command, and no part of it is ignored.
    #[inline(never)]
    pub(crate) fn sets_a_value(&self) -> bool {
        let mut remarks = Remarks::NONE;
        let [one, two] = [1, 2].map(|number| self.line(Decimal::from_nanos(number * 1_000_000_000)));
        let [one, two] = [&one, &two].map(|line| parse_with_remarks(line, &mut remarks));
        matches!((one, two), (Ok(one), Ok(two)) if values_differ(&one, &two) && remarks.is_empty())
    }

    /// The line that sets a value.
    pub(crate) fn line(&self, value: Decimal) -> TowerLine {
        let mut line = TowerLine::new();
        // It has room for every value.
        let _ = write!(line, "{}{value}", self.prefix);
        line
    }

    /// The value at a height of the G-code, units of 10 nm.
    pub(crate) fn value_at(&self, height_10nm: i64) -> Decimal {
        let above = height_10nm.saturating_sub(self.skip.to_10nm_from_mm()).max(0);
        let (change, by, to) = match self.course {
            TowerCourse::Linear { factor } => (factor, above, MM),
            TowerCourse::Bands { factor, band } => {
                let band = band.to_10nm_from_mm().max(1);
                (factor, (above / band).saturating_mul(band).saturating_add(band / 2), MM)
            }
            TowerCourse::Steps { delta, height } => (delta, above / height.to_10nm_from_mm().max(1), 1),
        };
        let nanos = i128::from(self.start.nanos()) + i128::from(change.nanos()) * i128::from(by) / i128::from(to);
        Decimal::from_nanos(nanos.clamp((-i64::MAX).into(), i64::MAX.into()) as i64)
    }
}

impl fmt::Display for Tower {
    /// The command that sets it.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (command, parameter) = self.prefix.split_at_checked(self.command_bytes).unwrap_or_default();
        let quote = if command.contains('"') { '\'' } else { '"' };
        let parameter = parameter.trim_matches([' ', '=']);
        write!(out, "TUNING_TOWER COMMAND={quote}{command}{quote} PARAMETER={parameter} START={}", self.start)?;
        write!(out, " SKIP={} ", self.skip)?;
        match self.course {
            TowerCourse::Linear { factor } => write!(out, "FACTOR={factor}"),
            TowerCourse::Bands { factor, band } => write!(out, "FACTOR={factor} BAND={band}"),
            TowerCourse::Steps { delta, height } => write!(out, "STEP_DELTA={delta} STEP_HEIGHT={height}"),
        }
    }
}
