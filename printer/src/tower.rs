//! TUNING_TOWER: a live value that changes with the height of the print.

use core::fmt;
use core::fmt::Write as _;

use ferrostep_gcode::{
    Command, Decimal, ParseError, Real, Remarks, ShortText, TowerCourse, TowerWords, parse, parse_with_remarks,
};

use crate::error::{CommandError, Failure};
use crate::ports::{Ports, Replies};
use crate::printer::Printer;

/// Most bytes of the command with the name of its parameter.
const MAX_PREFIX: usize = 64;

/// The same with the value: at most a sign, ten digits, a point and nine digits.
const MAX_LINE: usize = MAX_PREFIX + 21;

/// Units of 10 nm in a millimetre.
const MM: i64 = 100_000;

/// So much lower is another print's extrusion, as in Klipper; units of 10 nm.
const LOWER_10NM: i64 = 2 * MM;

/// The line that sets the value.
pub(crate) type TowerLine = heapless::String<MAX_LINE>;

/// Why there is no such tower.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TowerRefusal {
    /// The command sets nothing that may change in a print.
    NotLive(ShortText),
    /// The command has no number of this name.
    NoNumber(ShortText),
    /// There is no room for the command and its parameter.
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
                write!(
                    out,
                    "PARAMETER: {parameter} is no number of this command, expected one that it takes as it stands"
                )
            }
            Self::TooLong => write!(out, "COMMAND and PARAMETER: expected at most {MAX_PREFIX} characters"),
            Self::InJob => out.write_str("a prepared job has its own values: TUNING_TOWER needs G-code"),
        }
    }
}

/// A value that changes with the height.
#[derive(Clone, Debug)]
pub(crate) struct Tower {
    /// `M900 K`, `SET_PRESSURE_ADVANCE ADVANCE=`: what stands before the value.
    prefix: heapless::String<MAX_PREFIX>,
    /// Bytes of it before the parameter.
    command_bytes: usize,
    start: Decimal,
    skip: Decimal,
    course: TowerCourse,
    /// Height of the newest extrusion, machine coordinates in units of 10 nm.
    height_10nm: Option<i64>,
    /// The value that was set last.
    value: Option<Decimal>,
}

/// Whether a command sets a value that may change in a print.
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

/// Whether two commands differ in a value that may change in a print, and not only in the tool that they name. To compare commands of
/// every kind would take 2 KB of an image.
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
            C::VelocityLimit { velocity, acceleration, corner },
            C::VelocityLimit { velocity: velocity_2, acceleration: acceleration_2, corner: corner_2 },
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
    fn new(words: &TowerWords<'_>) -> Result<Self, TowerRefusal> {
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

    /// Whether a number changes the command, and nothing of it is ignored.
    #[inline(never)]
    fn sets_a_value(&self) -> bool {
        let mut remarks = Remarks::NONE;
        let [one, two] = [1, 2].map(|number| self.line(Decimal::from_nanos(number * 1_000_000_000)));
        let [one, two] = [&one, &two].map(|line| parse_with_remarks(line, &mut remarks));
        matches!((one, two), (Ok(one), Ok(two)) if values_differ(&one, &two) && remarks.is_empty())
    }

    /// The line that sets a value.
    fn line(&self, value: Decimal) -> TowerLine {
        let mut line = TowerLine::new();
        // It has room for every value.
        let _ = write!(line, "{}{value}", self.prefix);
        line
    }

    /// The value at a height of the G-code, units of 10 nm.
    fn value_at(&self, height_10nm: i64) -> Decimal {
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

impl<P: Ports> Printer<'_, P> {
    /// TUNING_TOWER. It takes the place of the one before.
    #[cold]
    #[inline(never)]
    pub(crate) fn set_tower(&mut self, words: Option<&TowerWords<'_>>) -> Result<(), CommandError> {
        if let Some(words) = words {
            if self.interpreter.modal.in_prepared_job {
                return Err(CommandError::Tower(TowerRefusal::InJob));
            }
            let tower = Tower::new(words).map_err(CommandError::Tower)?;
            if !tower.sets_a_value() {
                return Err(CommandError::Tower(TowerRefusal::NoNumber(ShortText::new(words.parameter))));
            }
            self.tower = Some(tower);
            return Ok(());
        }
        match &self.tower {
            None => self.replies.send(ferrostep_gcode::Reply::Text("echo:TUNING_TOWER: none")),
            Some(tower) => {
                self.replies.say(format_args!("echo:{tower}"));
                if let (Some(value), Some(height_10nm)) = (tower.value, tower.height_10nm) {
                    let height = Real::fixed(height_10nm as f64 / MM as f64, 2);
                    self.replies.say(format_args!("echo:TUNING_TOWER at Z{height}: {}{value}", tower.prefix));
                }
            }
        }
        Ok(())
    }

    /// The line that a tower has to execute before this command, the first that prints at a new height.
    #[inline]
    pub(crate) fn due_of_tower(&mut self, command: &Command<'_>) -> Option<TowerLine> {
        if self.tower.is_some() { self.line_of_tower(command) } else { None }
    }

    #[cold]
    #[inline(never)]
    fn line_of_tower(&mut self, command: &Command<'_>) -> Option<TowerLine> {
        let modal = &self.interpreter.modal;
        let (axes, is_rapid, is_arc) = match command {
            Command::Linear { axes, rapid, .. } => (axes, *rapid, false),
            Command::Arc { axes, .. } => (axes, false, true),
            _ => return None,
        };
        let (target_10nm, extruder_10nm) = modal.target(axes)?;
        let by_length = modal.extrusion.settings().adaptive && axes.e.is_none() && !is_rapid && !modal.retracted;
        // A circle ends where it begins.
        let displaces = is_arc || target_10nm != modal.machine_10nm;
        let [.., height_10nm] = target_10nm;
        let is_in_plane = height_10nm == modal.machine_10nm[2];
        if !displaces || !(extruder_10nm > modal.extruder_10nm || (by_length && is_in_plane)) {
            return None;
        }
        let seen_10nm = height_10nm + modal.offset_10nm[2];
        let tower = self.tower.as_mut()?;
        let before_10nm = tower.height_10nm.replace(height_10nm);
        if before_10nm == Some(height_10nm) {
            return None;
        }
        if before_10nm.is_some_and(|before_10nm| height_10nm < before_10nm - LOWER_10NM) {
            self.end_tower("the print goes on lower");
            return None;
        }
        let value = tower.value_at(seen_10nm);
        if tower.value.replace(value) == Some(value) { None } else { Some(tower.line(value)) }
    }

    /// Reads a tower's line; one that cannot be read ends the tower.
    #[cold]
    #[inline(never)]
    pub(crate) fn read_of_tower<'l>(&mut self, line: &'l str) -> Option<Command<'l>> {
        let mut remarks = Remarks::NONE;
        let read: Result<_, ParseError> = parse_with_remarks(line, &mut remarks);
        if matches!(read, Ok(Command::Accepted)) {
            self.fail_tower(line, &remarks);
            return None;
        }
        if !remarks.is_empty() {
            self.remark(self.line, line, &remarks);
        }
        read.map_err(|error| self.fail_tower(line, &Failure::Parse(error))).ok()
    }

    /// A tower's line was refused: the print goes on with the value before.
    #[cold]
    #[inline(never)]
    pub(crate) fn fail_tower(&mut self, line: &str, failure: &impl fmt::Display) {
        self.tower = None;
        self.replies.say(format_args!("echo:line {}: TUNING_TOWER has ended, \"{line}\": {failure}", self.line));
    }

    /// What a tower has begun ends, and its value stays. One that waits for its print goes on waiting: a print begins by homing.
    #[cold]
    #[inline(never)]
    pub(crate) fn end_begun_tower(&mut self) {
        if self.tower.as_ref().is_some_and(|tower| tower.value.is_some()) {
            self.end_tower("the print has ended");
        }
    }

    /// Ends a tower, if there is one; its value stays.
    #[cold]
    #[inline(never)]
    pub(crate) fn end_tower(&mut self, why: &str) {
        if self.tower.take().is_some() {
            self.replies.say(format_args!("echo:TUNING_TOWER has ended: {why}"));
        }
    }
}

#[cfg(test)]
mod tests;
