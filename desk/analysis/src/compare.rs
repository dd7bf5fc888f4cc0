//! Two prints side by side: two files, or one with two profiles.

use std::collections::BTreeMap;
use std::fmt;
use std::io::Read;
use std::path::Path;

use ferrostep_host::printable::one_line;
use ferrostep_session::JobReplies;
use ferrostep_session::duration::hms;
use ferrostep_session::input::Input;
use ferrostep_session::rules::RuledMachine;
use ferrostep_show::{Kind, Row, write_comparison, write_page};
use ferrostep_simulator::frame::FrameSettings;
use ferrostep_simulator::measures::ContourError;
use ferrostep_simulator::nozzle::NozzleSettings;
use ferrostep_simulator::plan::Machine;
use serde::Serialize;

use crate::recording::{self, MAX_NODES};
use crate::simulation::Simulation;
use crate::sweep;
use crate::without_commands::{Dropped, WithoutCommands};

/// A print of the two.
#[derive(Clone, Debug)]
pub struct Asked<'a> {
    /// The job.
    pub file: &'a Path,
    /// The machine. Another firmware's rules make no steps, and have no contour error.
    pub machine: RuledMachine,
    /// Keys of the machine's profile that were changed, with their values.
    pub changes: &'a [(String, f64)],
}

/// Figures of a print for the comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Side {
    /// The job's file.
    pub file: String,
    /// Name of the machine.
    pub profile: String,
    /// The rules of another firmware that planned it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rules: Option<&'static str>,
    /// Keys of its profile that were changed, with their values.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub changes: BTreeMap<String, f64>,
    /// Time of the print, s.
    pub print_time_s: f64,
    /// Time spent printing, s.
    pub printing_s: f64,
    /// Time spent travelling, s.
    pub travelling_s: f64,
    /// Mean speed while printing, mm/s.
    pub mean_printing_mm_per_s: f64,
    /// Fastest printing, mm/s.
    pub max_printing_mm_per_s: f64,
    /// Mean flow while printing, mm^3/s.
    pub mean_flow_mm3_per_s: f64,
    /// Greatest flow, mm^3/s.
    pub max_flow_mm3_per_s: f64,
    /// Net filament.
    pub filament_mm: f64,
    /// Retractions.
    pub retractions: u64,
    /// Moves that were slowed because the board could not keep up with them.
    pub slowed_moves: u64,
    /// Farthest that the motors' path is from the one asked for, while printing, mm; missing by
    /// rules that make no steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_deviation_mm: Option<f64>,
    /// Distance of the nozzle from that path on a frame that rings; missing without frequencies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contour_error_um: Option<ContourError>,
    /// Error that stopped the job early.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
}

/// The two prints.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The first print.
    pub a: Side,
    /// The second.
    pub b: Side,
    /// The page that shows both.
    #[serde(skip)]
    pub page: Vec<u8>,
}

/// Prints both on the virtual board and compares them. `keys`: those of the profile whose commands
/// are left out of both jobs, as they would override the profile's values. `frequency_hz`: of the
/// frame in X and Y.
///
/// # Errors
/// A job cannot be read or simulated; it says which. One that stops at a line is
/// compared up to there.
pub fn compare(asked: [Asked<'_>; 2], keys: &[String], frequency_hz: Option<[f64; 2]>) -> Result<Comparison, String> {
    let [a, b] = std::thread::scope(|scope| {
        let threads = asked.map(|one| scope.spawn(move || side(one, keys, frequency_hz)));
        threads.map(|thread| thread.join().unwrap_or_else(|_| Err("the print failed".to_owned())))
    });
    let ((a, page_a), (b, page_b)) = (a?, b?);
    let mut page = Vec::new();
    let title = if a.file == b.file { a.file.clone() } else { format!("{} and {}", a.file, b.file) };
    write_comparison(&mut page, &title, [&a, &b].map(Side::name), &rows(&a, &b), [&page_a, &page_b])
        .map_err(|error| format!("the page cannot be made: {error}"))?;
    Ok(Comparison { a, b, page })
}

fn side(asked: Asked<'_>, keys: &[String], frequency_hz: Option<[f64; 2]>) -> Result<(Side, String), String> {
    let Asked { file, machine: RuledMachine { profile, by, .. }, changes } = asked;
    let name = ferrostep_session::input::name(file);
    let open = || Input::open(file).map_err(|error| format!("{name}: {error}"));
    let mut input = open()?;
    if input.is_prepared() {
        return Err(format!("{name}: this is a prepared job, and compare takes the G-code that it was made from"));
    }
    let dropped = sweep::dropped(keys);
    let dropped = if keys.is_empty() { Dropped::new(Vec::new()) } else { dropped };
    let replies = JobReplies::new(|_: &str| {});
    let shown = recording::record_without(&dropped, profile, by, &mut input, MAX_NODES, replies, |_, _| {})
        .map_err(|error| format!("{name}: {error}"))?;
    let slicer_time_s = input.description().and_then(|said| Some(said.figures.time_s?.into()));
    let job = shown.job(file, &profile, slicer_time_s, Vec::new());
    let contour_error_um = match frequency_hz {
        Some(frequency_hz) if shown.stopped.is_none() => {
            let mut text = Vec::new();
            let read = WithoutCommands::new(open()?, &dropped).read_to_end(&mut text);
            read.map_err(|error| format!("{name}: cannot be read: {error}"))?;
            let frame = FrameSettings { frequency_hz, ..FrameSettings::default() };
            let machine = Machine { frame, nozzle: NozzleSettings::default() };
            let simulation = Simulation::of_text(text, profile).map_err(|error| format!("{name}: {error}"))?;
            let ((report, _), _) = simulation.run(&machine, |_| {}).map_err(|error| format!("{name}: {error}"))?;
            Some(report.contour_error_um)
        }
        _ => None,
    };
    let mut page = Vec::new();
    write_page(&mut page, &job, &shown.recording, &shown.text).map_err(|error| format!("{name}: {error}"))?;
    let totals = &shown.recording.totals;
    let [printing, travelling] = [Kind::Print, Kind::Travel].map(|kind| totals.kinds[kind as usize]);
    let mean = |sum: f64| if printing.time_s > 0.0 { sum / printing.time_s } else { 0.0 };
    let side = Side {
        file: job.file,
        profile: job.profile,
        rules: shown.rules.as_ref().map(|rules| rules.name),
        changes: changes.iter().cloned().collect(),
        print_time_s: job.print_time_s,
        printing_s: printing.time_s,
        travelling_s: travelling.time_s,
        mean_printing_mm_per_s: mean(printing.path_mm),
        max_printing_mm_per_s: totals.fastest_print.value,
        mean_flow_mm3_per_s: mean(printing.volume_mm3),
        max_flow_mm3_per_s: totals.greatest_flow.value,
        filament_mm: job.filament_mm,
        retractions: totals.retractions,
        slowed_moves: shown.figures.slowed_moves,
        max_deviation_mm: shown.rules.is_none().then_some(totals.greatest_deviation.value),
        contour_error_um,
        stopped: shown.stopped.as_ref().map(ToString::to_string),
    };
    Ok((side, String::from_utf8_lossy(&page).into_owned()))
}

impl Side {
    /// File, machine and the changes.
    fn name(&self) -> String {
        let changes: String = self.changes.iter().map(|(key, value)| format!(", {key} = {value}")).collect();
        let rules = self.rules.map(|rules| format!(" by the rules of {rules}")).unwrap_or_default();
        format!("{} on {}{rules}{changes}", self.file, self.profile)
    }
}

/// The lines of the table.
fn rows(a: &Side, b: &Side) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut row = |name: &str, of: &dyn Fn(&Side) -> Option<f64>, shown: &dyn Fn(f64) -> String| {
        let (Some(first), Some(second)) = (of(a), of(b)) else { return };
        let per_mille = if first == 0.0 { 0.0 } else { (1000.0 * (second / first - 1.0)).round() };
        let change = match (first == 0.0, per_mille == 0.0) {
            (true, _) => String::new(),
            (false, true) => "0.0 %".to_owned(),
            (false, false) => format!("{:+.1} %", per_mille / 10.0),
        };
        rows.push(Row { name: name.to_owned(), values: [shown(first), shown(second)], change });
    };
    let number =
        |digits: usize, unit: &'static str| move |value: f64| format!("{value:.digits$} {unit}").trim_end().to_owned();
    row("print time", &|side| Some(side.print_time_s), &hms);
    row("printing", &|side| Some(side.printing_s), &hms);
    row("travelling", &|side| Some(side.travelling_s), &hms);
    row("mean speed", &|side| Some(side.mean_printing_mm_per_s), &number(1, "mm/s"));
    row("fastest", &|side| Some(side.max_printing_mm_per_s), &number(1, "mm/s"));
    row("mean flow", &|side| Some(side.mean_flow_mm3_per_s), &number(2, "mm³/s"));
    row("greatest flow", &|side| Some(side.max_flow_mm3_per_s), &number(2, "mm³/s"));
    row("filament", &|side| Some(side.filament_mm / 1000.0), &number(3, "m"));
    row("retractions", &|side| Some(side.retractions as f64), &number(0, ""));
    row("slowed moves", &|side| Some(side.slowed_moves as f64), &number(0, ""));
    row("off the path", &|side| side.max_deviation_mm, &number(3, "mm"));
    row("error, rms", &|side| Some(side.contour_error_um?.rms), &number(1, "µm"));
    row("error, 99 %", &|side| Some(side.contour_error_um?.p99), &number(1, "µm"));
    row("error, max", &|side| Some(side.contour_error_um?.max), &number(1, "µm"));
    rows
}

impl fmt::Display for Comparison {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (letter, side) in [("A", &self.a), ("B", &self.b)] {
            writeln!(out, "{letter}: {}", one_line(&side.name()))?;
            if let Some(reason) = &side.stopped {
                writeln!(out, "   stops: {}", one_line(reason))?;
            }
        }
        writeln!(out, "{:<14}  {:>16}  {:>16}  {:>9}", "", "A", "B", "change")?;
        for Row { name, values: [a, b], change } in rows(&self.a, &self.b) {
            writeln!(out, "{name:<14}  {a:>16}  {b:>16}  {change:>9}")?;
        }
        Ok(())
    }
}
