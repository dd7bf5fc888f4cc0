//! The summary of a print or an estimate, as text and JSON.

use std::fmt;

use ferrostep_host::printable::one_line;
use serde::Serialize;

use crate::desk::Figures;
use crate::duration::hms;
use crate::extent::Extent;
use crate::input::SlicerFigures;
use crate::job::JobError;
use crate::limit_shares::LimitShare;
use crate::parts::PrintParts;
use crate::remarks::{self, Remark};
use crate::took::Took;

/// A value for each motor, or each coordinate.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PerAxis<T> {
    /// X (CoreXY motors: A).
    pub x: T,
    /// Y (CoreXY motors: B).
    pub y: T,
    /// Z.
    pub z: T,
    /// The extruder.
    pub e: T,
}

impl<T> From<[T; 4]> for PerAxis<T> {
    fn from([x, y, z, e]: [T; 4]) -> Self {
        Self { x, y, z, e }
    }
}

/// Place at which a job stopped, and why.
#[derive(Clone, Debug, Serialize)]
pub struct Stop {
    /// The line's number, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u32>,
    /// The error, and how to mend it.
    pub message: String,
}

impl From<&JobError> for Stop {
    fn from(error: &JobError) -> Self {
        let line = match error {
            JobError::Line { line, .. } | JobError::Read { line, .. } => Some(*line),
            JobError::Prepared { line, .. } => *line,
            JobError::Entry { .. } | JobError::Stopped(_) => None,
        };
        Self { line, message: error.to_string() }
    }
}

/// The motors' part of a summary; an estimate has none.
#[derive(Clone, Debug, Serialize)]
pub struct Motors {
    /// Steps issued, both directions.
    pub motor_steps: PerAxis<u64>,
    /// Maximum number of events in any millisecond, times 1000.
    pub max_event_rate_hz: u64,
    /// Times the step queue was empty at non-zero speed.
    pub underruns: u64,
    /// Times a block left the look-ahead ring early because steps ran out.
    pub starvation_flushes: u64,
    /// Moves that were slowed because a board could not keep up with them.
    pub slowed_moves: u64,
    /// Moves merged into the block of the move before.
    pub merged_moves: u64,
    /// FNV-1a-64 over the order of the step events.
    pub order_digest: String,
    /// FNV-1a-64 over the step events with their times.
    pub step_digest: String,
}

/// The summary of `print` and `estimate`, and their `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The job's file, as given.
    pub file: String,
    /// Name of the machine.
    pub profile: String,
    /// Lines of the file that were read.
    pub lines: u32,
    /// G0 to G3 that displaced at least one axis.
    pub moves: u64,
    /// The different unknown commands.
    pub unknown_commands: Vec<String>,
    /// Moves whose target a soft limit changed.
    pub clamped_moves: u64,
    /// Box of the places where the file extrudes, before any soft limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extent_mm: Option<Extent>,
    /// Virtual time from the first line to the last step.
    pub print_time_s: f64,
    /// Sum of the blocks' durations, homing left out.
    pub motion_time_s: f64,
    /// The rules of another firmware by which the time was planned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rules: Option<&'static str>,
    /// Time and moves of each limit of these rules.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limits: Option<Vec<LimitShare>>,
    /// A measured time, and what would explain it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub took: Option<Took>,
    /// The slicer's time, from a comment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slicer_time_s: Option<f64>,
    /// Net filament.
    pub filament_mm: f64,
    /// Position as M114 reports it.
    pub position_mm: PerAxis<f64>,
    /// Steps.
    #[serde(flatten)]
    pub motors: Option<Motors>,
    /// Real time that the command took, s.
    pub wall_s: f64,
    /// Motion time over real time.
    pub realtime_factor: f64,
    /// Layers, by the slicer's comments.
    pub layers: u32,
    /// Parts of the print, of a job that is G-code.
    #[serde(flatten)]
    pub parts: Option<PrintParts>,
    /// The slicer's figures, from binary G-code.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slicer: Option<SlicerFigures>,
    /// Remarks for a person; a host was sent them with the answers to its lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remarks: Option<Vec<Remark>>,
    /// Place at which the job stopped early, and why.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<Stop>,
}

impl From<&Figures> for Motors {
    fn from(figures: &Figures) -> Self {
        Self {
            motor_steps: figures.motor_steps.into(),
            max_event_rate_hz: figures.max_event_rate_hz,
            underruns: figures.underruns,
            starvation_flushes: figures.starvation_flushes,
            slowed_moves: figures.slowed_moves,
            merged_moves: figures.merged_moves,
            order_digest: format!("{:016x}", figures.digests.order),
            step_digest: format!("{:016x}", figures.digests.step),
        }
    }
}

/// Minimum time of a limit that is listed for a person, s.
const LEAST_SHARE_S: f64 = 0.05;

/// A number of things: "1 move", "2 moves".
fn counted(count: u64, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

impl fmt::Display for Summary {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ended = if self.stopped.is_some() { "stopped" } else { "done" };
        writeln!(out, "{} on {}: {ended}", one_line(&self.file), self.profile)?;
        let slicer = self.slicer_time_s.map_or_else(String::new, |time_s| format!("; the slicer says {}", hms(time_s)));
        let (print, motion) = (hms(self.print_time_s), hms(self.motion_time_s));
        writeln!(out, "  print time   {print} ({motion} of it in motion{slicer})")?;
        if let Some(rules) = self.rules {
            writeln!(out, "  planned by   {rules}: its rules, and this profile's limits")?;
        }
        let limits = self.limits.as_deref().unwrap_or_default();
        for (index, share) in limits.iter().filter(|share| share.seconds >= LEAST_SHARE_S).enumerate() {
            let name = if index == 0 { "limited by" } else { "" };
            let (time, moves) = (hms(share.seconds), counted(share.moves, "move"));
            writeln!(out, "  {name:12} {}: {time}, {moves}", share.limit)?;
        }
        if let Some(took) = &self.took {
            took.fmt(out)?;
        }
        writeln!(out, "  filament     {:.3} m", self.filament_mm / 1000.0)?;
        let layers = if self.layers > 0 { format!(", {} layers", self.layers) } else { String::new() };
        writeln!(out, "  moves        {} in {}{layers}", self.moves, counted(self.lines.into(), "line"))?;
        if let Some(extent) = &self.extent_mm {
            writeln!(out, "  extent       {extent}")?;
        }
        let at = &self.position_mm;
        writeln!(out, "  position     X{:.3} Y{:.3} Z{:.3} E{:.5}", at.x, at.y, at.z, at.e)?;
        if let Some(motors) = &self.motors {
            let steps = &motors.motor_steps;
            writeln!(out, "  steps        X {} Y {} Z {} E {}", steps.x, steps.y, steps.z, steps.e)?;
            writeln!(
                out,
                "  step events  at most {} /s; {} underruns, {} starvation flushes; {} slowed for the board",
                motors.max_event_rate_hz,
                motors.underruns,
                motors.starvation_flushes,
                counted(motors.slowed_moves, "move")
            )?;
            writeln!(out, "  digests      order {} step {}", motors.order_digest, motors.step_digest)?;
        }
        if let Some(slicer) = &self.slicer {
            let time = slicer.time_s.map(|seconds| hms(seconds.into()));
            let filament = slicer.filament_mm.map(|mm| format!("{:.3} m", mm / 1000.0));
            let printer = slicer.printer_model.as_ref().map(|model| format!("for {model}"));
            let said = [time, filament, printer, slicer.producer.clone()];
            let said: Vec<String> = said.into_iter().flatten().collect();
            writeln!(out, "  slicer says  {}", one_line(&said.join(", ")))?;
        }
        if self.clamped_moves > 0 {
            writeln!(out, "  soft limits  changed {}", counted(self.clamped_moves, "move"))?;
        }
        if !self.unknown_commands.is_empty() {
            writeln!(out, "  unknown      {}", one_line(&self.unknown_commands.join(", ")))?;
        }
        remarks::write_all(out, self.remarks.as_deref().unwrap_or_default())?;
        write!(out, "  real time    {:.2} s", self.wall_s)?;
        // A job without motion has no time to compare with.
        if self.motion_time_s > 0.0 {
            write!(out, ", {:.0} times faster than the printer", self.realtime_factor)?;
        }
        Ok(())
    }
}
