//! Estimates a job with other values of a profile's keys.

pub mod chart;
mod error;
mod values;

use std::fmt;
use std::io::Read;
use std::path::Path;

use ferrostep_printer::SQUARE_CORNER_SHARE;
use ferrostep_profiles::PlannedBy;
use ferrostep_profiles::response::FrameMode;
use ferrostep_session::desk::{Desk, Figures, LOOK_AHEAD_BLOCKS};
use ferrostep_session::duration::hms;
use ferrostep_session::input::{Input, InputError};
use ferrostep_session::job::{self, JobError, JobProgress};
use ferrostep_session::rules::{MachineError, RuledMachine};
use ferrostep_session::{JobReplies, Session};
use serde::Serialize;
use toml::{Table, Value};

use crate::without_commands::{Dropped, WithoutCommands};

pub use values::{Values, ValuesError};

/// The keys that `--acceleration` changes: both kinds of moves, and the axes that
/// would hold them back.
pub const ACCELERATION_KEYS: [&str; 4] = [
    "acceleration_mm_per_s2.print",
    "acceleration_mm_per_s2.travel",
    "max_acceleration_mm_per_s2.x",
    "max_acceleration_mm_per_s2.y",
];

/// The key that `--error-budget` changes.
pub const ERROR_BUDGET_KEY: &str = "error_budget_mm";

/// The key of the deviation at corners.
const DEVIATION_KEY: &str = "junction_deviation_mm";

/// Commands by which a job sets its own limits, which would override the profile's.
const LIMITS: [&str; 5] = ["M201", "M203", "M204", "M205", "SET_VELOCITY_LIMIT"];

/// Commands by which a job sets its own filters and advance.
const FILTERS: [&str; 5] = ["M593", "SET_INPUT_SHAPER", "M900", "M572", "SET_PRESSURE_ADVANCE"];

/// Tables of the profile which those set.
const FILTER_TABLES: [&str; 2] = ["input_shaper", "pressure_advance"];

/// Keys from which accelerations follow for the profile's own filters, so that the job
/// may set neither.
const BUDGET_KEYS: [&str; 2] = [ERROR_BUDGET_KEY, "frame"];

/// Keys, and the values that they take together.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Full paths with dots.
    pub keys: Vec<String>,
    /// Name of the keys together, for a person.
    pub label: String,
    /// The values.
    pub values: Values,
    /// True to simulate also the error on the frame that the profile names.
    pub with_error: bool,
    /// The rules by which the job is planned, in place of the profile's.
    pub rules: Option<PlannedBy>,
}

/// Reason for which a sweep cannot be made.
#[derive(Debug)]
pub enum SweepError {
    /// The profile's text, or one of its values.
    Profile(String),
    /// The job cannot be read.
    Input(InputError),
    /// A prepared job has its speeds already.
    Prepared,
    /// The job stops with the unchanged profile.
    Job(JobError),
    /// An error is to be simulated, and the profile names no frame.
    NoFrame,
}

impl fmt::Display for SweepError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Profile(problem) => out.write_str(problem),
            Self::Input(error) => error.fmt(out),
            Self::Prepared => out.write_str(
                "this is a prepared job, whose speeds are planned already, and sweep takes the G-code that it was made from",
            ),
            Self::Job(error) => error.fmt(out),
            Self::NoFrame => out.write_str(
                "--simulate plays the steps on the printer's frame: the profile needs frame.x and frame.y with the frequency_hz and \
                 frequency_uncertainty_hz that `ferrostep calibrate shaper` prints",
            ),
        }
    }
}

/// A job with one value.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Row {
    /// The keys' value.
    pub value: f64,
    /// Time of the print, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub print_time_s: Option<f64>,
    /// Moves that were slowed because a board could not keep up with them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slowed_moves: Option<u64>,
    /// Largest accelerations of X and Y that follow from an error budget, mm/s^2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration_mm_per_s2: Option<[f64; 2]>,
    /// Distance from the path that the nozzle stays within in 99 % of the printing time, um: the
    /// worst of the frames that the profile allows for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_um: Option<f64>,
    /// Error that stops the job with this value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
}

/// A job with all values.
#[derive(Clone, Debug, Serialize)]
pub struct Swept {
    /// The job's file.
    pub file: String,
    /// Name of the machine.
    pub profile: String,
    /// The rules of another firmware by which the times were planned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rules: Option<&'static str>,
    /// The keys that were changed together.
    pub keys: Vec<String>,
    /// Name of the keys together, for a person.
    #[serde(skip)]
    pub label: String,
    /// Time with the unchanged profile and job, except the lines left out, s.
    pub print_time_s: f64,
    /// Lines of the job left out, as their settings would override the profile's values.
    pub lines_left_out: u64,
    /// Rows in the order of the values.
    pub rows: Vec<Row>,
}

/// Times of a job with a profile's keys at each of the values.
///
/// # Errors
/// [`SweepError`]. A value at which the job stops is a [`Row`] that says why.
pub fn sweep(file: &Path, profile_text: &str, profile_name: &str, sweep: &Sweep) -> Result<Swept, SweepError> {
    let table: Table = profile_text.parse().map_err(|error| SweepError::Profile(format!("{profile_name}: {error}")))?;
    let own = machine(&table, profile_name, sweep.rules)?;
    let machines: Vec<(f64, RuledMachine)> = sweep
        .values
        .iter()
        .map(|value| {
            let mut table = table.clone();
            for key in &sweep.keys {
                set(&mut table, key, value)
                    .map_err(|problem| SweepError::Profile(format!("{profile_name}: {problem}")))?;
            }
            hold_corner_speed(&mut table, &sweep.keys);
            Ok((value, machine(&table, profile_name, sweep.rules)?))
        })
        .collect::<Result<_, SweepError>>()?;
    let frame = match (sweep.with_error, frame(profile_text, profile_name)?) {
        (false, _) => None,
        (true, [Some(x), Some(y)]) => Some([x, y]),
        (true, _) => return Err(SweepError::NoFrame),
    };
    let is_budget = sweep.keys.iter().any(|key| key == ERROR_BUDGET_KEY);
    let dropped = dropped(&sweep.keys);
    let (profile, rules) = (own.profile.name.to_owned(), own.by.as_ref().map(|by| by.rules.name()));
    let (print_time_s, _, lines_left_out) = estimate(file, own, &dropped)?;
    let one = |value: f64, machine: RuledMachine| -> Row {
        let mut row = Row { value, ..Row::default() };
        let profile = machine.profile;
        match estimate(file, machine, &dropped) {
            Ok((time_s, slowed_moves, _)) => (row.print_time_s, row.slowed_moves) = (Some(time_s), Some(slowed_moves)),
            Err(error) => return Row { stopped: Some(error.to_string()), ..row },
        }
        let [x, y, ..] = profile.limits.max_acceleration_mm_per_s2;
        row.acceleration_mm_per_s2 = is_budget.then_some([x, y]);
        match frame.map(|frame| error::simulated_um(file, profile, &dropped, frame)) {
            Some(Err(reason)) => Row { stopped: Some(reason), ..row },
            error => Row { error_um: error.and_then(Result::ok), ..row },
        }
    };
    let rows = std::thread::scope(|scope| {
        let one = &one;
        let threads: Vec<_> =
            machines.into_iter().map(|(value, machine)| (value, scope.spawn(move || one(value, machine)))).collect();
        let failed = |value| Row { value, stopped: Some("the estimate failed".to_owned()), ..Row::default() };
        threads.into_iter().map(|(value, thread)| thread.join().unwrap_or_else(|_| failed(value))).collect()
    });
    let file = file.to_string_lossy().into_owned();
    let Sweep { keys, label, .. } = sweep.clone();
    Ok(Swept { file, profile, rules, keys, label, print_time_s, lines_left_out, rows })
}

/// The frame that a profile's text names.
fn frame(text: &str, name: &str) -> Result<[Option<FrameMode>; 2], SweepError> {
    let budget = ferrostep_profiles::error_budget(text, name);
    Ok(budget.map_err(|error| SweepError::Profile(error.to_string()))?.frame)
}

/// A machine by its profile's text, with other values of some keys; `asked`: the rules that hold in
/// place of the profile's.
///
/// # Errors
/// The text or a value is refused; it says which.
pub fn machine_with(
    text: &str,
    name: &str,
    values: &[(String, f64)],
    asked: Option<PlannedBy>,
) -> Result<RuledMachine, SweepError> {
    machine(&table_with(text, name, values)?, name, asked)
}

/// A profile's text with other values of some keys.
pub(crate) fn text_with(text: &str, name: &str, values: &[(String, f64)]) -> Result<String, SweepError> {
    Ok(table_with(text, name, values)?.to_string())
}

fn table_with(text: &str, name: &str, values: &[(String, f64)]) -> Result<Table, SweepError> {
    let mut table: Table = text.parse().map_err(|error| SweepError::Profile(format!("{name}: {error}")))?;
    for (key, value) in values {
        set(&mut table, key, *value).map_err(|problem| SweepError::Profile(format!("{name}: {problem}")))?;
    }
    Ok(table)
}

/// The commands whose settings would hold over those of these keys.
pub(crate) fn dropped(keys: &[String]) -> Dropped {
    let is_of = |key: &String, tables: &[&str]| tables.iter().any(|table| key.split('.').next() == Some(table));
    let sets_filters = |key: &String| is_of(key, &FILTER_TABLES);
    let needs_filters = |key: &String| sets_filters(key) || is_of(key, &BUDGET_KEYS);
    let filters: &[&str] = if keys.iter().any(needs_filters) { &FILTERS } else { &[] };
    let limits: &[&str] = if keys.iter().all(sets_filters) { &[] } else { &LIMITS };
    Dropped::new([limits, filters].concat())
}

/// Reads a machine from its profile's table. The line of a problem is left out: the table is not
/// the file's text.
fn machine(table: &Table, name: &str, asked: Option<PlannedBy>) -> Result<RuledMachine, SweepError> {
    RuledMachine::parse(&table.to_string(), name, asked).map_err(|error| {
        SweepError::Profile(match error {
            MachineError::Profile(error) => format!("{name}: {}", error.problem()),
            limits @ MachineError::Limits { .. } => limits.to_string(),
        })
    })
}

/// Makes the deviation at corners follow a changed acceleration where the profile has the speed of
/// corners, as M204 does.
fn hold_corner_speed(table: &mut Table, keys: &[String]) {
    let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
    let speed = table.get("square_corner_velocity_mm_per_s").and_then(number);
    let print = table.get("acceleration_mm_per_s2").and_then(|table| number(table.get("print")?));
    let is_said = keys.iter().any(|key| key == DEVIATION_KEY);
    if let (Some(speed), Some(print), false) = (speed, print.filter(|print| *print > 0.0), is_said) {
        let deviation_mm = speed * speed * SQUARE_CORNER_SHARE / print;
        table.insert(DEVIATION_KEY.to_owned(), Value::Float(deviation_mm));
    }
}

/// Sets a key by its full path.
fn set(table: &mut Table, key: &str, value: f64) -> Result<(), String> {
    let (tables, name) = key.rsplit_once('.').map_or((None, key), |(tables, name)| (Some(tables), name));
    let mut table = table;
    for part in tables.into_iter().flat_map(|tables| tables.split('.')) {
        let inner = table.entry(part).or_insert_with(|| Value::Table(Table::new()));
        table = inner.as_table_mut().ok_or_else(|| format!("{key}: \"{part}\" is not a table of the profile"))?;
    }
    // Whole numbers stay whole, for keys that take no others.
    let is_whole = value.fract() == 0.0 && value.abs() < 1e15;
    table.insert(name.to_owned(), if is_whole { Value::Integer(value as i64) } else { Value::Float(value) });
    Ok(())
}

/// Time of the print, s, moves that were slowed, and lines left out.
pub(crate) fn estimate(file: &Path, machine: RuledMachine, dropped: &Dropped) -> Result<(f64, u64, u64), SweepError> {
    let input = Input::open(file).map_err(SweepError::Input)?;
    if input.is_prepared() {
        return Err(SweepError::Prepared);
    }
    let mut input = WithoutCommands::new(input, dropped);
    let RuledMachine { profile, by, factors, .. } = machine;
    let replies = JobReplies::new(|_: &str| {});
    let figures = match by {
        None => figures(&mut input, &Session::estimate_with(profile, LOOK_AHEAD_BLOCKS, factors, replies))?,
        Some(by) => figures(&mut input, &Session::by_rules(profile, by, replies))?,
    };
    Ok((figures.print_time_s, figures.slowed_moves, input.lines_dropped()))
}

/// The counts of a job on a session.
fn figures<D: Desk>(input: &mut impl Read, session: &Session<D, JobReplies<'_>>) -> Result<Figures, SweepError> {
    let mut done = JobProgress::default();
    session.run(job::run(input, &mut session.printer(), &mut done, |_| {})).map_err(SweepError::Job)?;
    Ok(session.figures())
}

impl fmt::Display for Swept {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "{}, {}: {}", self.file, self.profile, self.label)?;
        if let Some(rules) = self.rules {
            writeln!(out, "planned by {rules}: its rules, and this profile's limits")?;
        }
        if self.lines_left_out > 0 {
            writeln!(out, "left out: {} lines that set what is compared here", self.lines_left_out)?;
        }
        let has = |is_there: fn(&Row) -> bool| self.rows.iter().any(is_there);
        let columns = [has(|row| row.acceleration_mm_per_s2.is_some()), has(|row| row.error_um.is_some())];
        let write_columns = |out: &mut fmt::Formatter<'_>, texts: [String; 2]| -> fmt::Result {
            for (text, width) in
                columns.iter().zip(texts.iter().zip([15, 12])).filter(|(is_shown, _)| **is_shown).map(|(_, text)| text)
            {
                write!(out, "  {text:>width$}")?;
            }
            writeln!(out)
        };
        write!(out, "{:>12}  {:>16}  {:>9}  {:>12}", "value", "print", "change", "slowed moves")?;
        write_columns(out, ["X, Y mm/s²".to_owned(), "error, 99 %".to_owned()])?;
        writeln!(out, "{:>12}  {:>16}", "the profile", hms(self.print_time_s))?;
        for row in &self.rows {
            let Row { value, stopped, .. } = row;
            let (Some(time_s), Some(slowed), None) = (row.print_time_s, row.slowed_moves, stopped) else {
                writeln!(out, "{value:>12}  stops: {}", stopped.as_deref().unwrap_or_default())?;
                continue;
            };
            let change = 100.0 * (time_s / self.print_time_s - 1.0);
            write!(out, "{value:>12}  {:>16}  {change:>+7.1} %  {slowed:>12}", hms(time_s))?;
            let acceleration = row.acceleration_mm_per_s2.map(|[x, y]| format!("{x:.0}, {y:.0}"));
            let error = row.error_um.map(|error_um| format!("{:.3} mm", 1e-3 * error_um));
            write_columns(out, [acceleration.unwrap_or_default(), error.unwrap_or_default()])?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
