//! Interface between the page and a printer.

use std::fmt;

use serde::Serialize;
use tempfile::NamedTempFile;

use crate::console::ConsoleLine;
use crate::control::Control;

/// Activity of a printer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Activity {
    /// The line to it is not open.
    Disconnected,
    /// No activity.
    Idle,
    /// A line from the console.
    Working,
    /// The page's job.
    Printing,
    /// The moves before a pause.
    Pausing,
    /// The job waits for a person.
    Paused,
    /// The job ends: motion and heat are switched off.
    Cancelling,
    /// M112, or a fault: motors and heaters are off until M999.
    Halted,
}

/// Temperatures, °C; a target of 0 is off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Heat {
    /// Temperature of the nozzle.
    pub nozzle_celsius: f64,
    /// Target of the nozzle.
    pub nozzle_target_celsius: f64,
    /// Temperature of the bed.
    pub bed_celsius: f64,
    /// Target of the bed.
    pub bed_target_celsius: f64,
    /// Temperature of the chamber, if known.
    pub chamber_celsius: Option<f64>,
    /// Target of the chamber.
    pub chamber_target_celsius: Option<f64>,
}

/// The file that is printed, or could be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Job {
    /// Name of the file, only shown.
    pub name: String,
    /// Size of the file.
    pub bytes: u64,
    /// Line of the file up to which commands were answered; 0 before the start.
    pub line: u32,
    /// Part of the job that is done, 0 to 1.
    pub share: f64,
    /// The printer's time that the rest needs, s, if it is known.
    pub remaining_s: Option<f64>,
}

/// A printer's state.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct State {
    /// The machine and where it is: a profile's name, a port.
    pub machine: String,
    /// Activity of the printer.
    pub activity: Activity,
    /// The other host that owns the line, in words; `None`: the page may use it.
    pub owner: Option<String>,
    /// Temperatures, once they are known.
    pub heat: Option<Heat>,
    /// Position of the tool head, mm, once it is known.
    pub position_mm: Option<[f64; 3]>,
    /// The uploaded file.
    pub job: Option<Job>,
    /// Message for a person: how the last job ended, or why the line is not open.
    pub message: Option<String>,
}

/// Reason for which a printer does not do what the page asks, and how to mend it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal(pub String);

impl fmt::Display for Refusal {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.0)
    }
}

impl std::error::Error for Refusal {}

/// A file that has arrived completely. It is deleted when this is dropped.
#[derive(Debug)]
pub struct Upload {
    /// Name of the file as the client says it, without control characters; for show, never a path.
    pub name: String,
    /// Content of the file.
    pub file: NamedTempFile,
    /// Size of the file.
    pub bytes: u64,
}

/// A printer that the page shows. The calls come from several threads and return soon: none waits
/// for the printer.
pub trait Printer: Send + Sync + 'static {
    /// The printer's state now.
    fn state(&self) -> State;

    /// The console's lines after this number, the oldest first.
    fn console(&self, after: u64) -> Vec<ConsoleLine>;

    /// Sends a person's line of G-code.
    ///
    /// # Errors
    /// The printer must not get it now.
    fn send_line(&self, line: &str) -> Result<(), Refusal>;

    /// Does what a button asks for.
    ///
    /// # Errors
    /// It must not act now: in a print, on a halted printer, with a nozzle too cold for filament.
    fn control(&self, control: Control) -> Result<(), Refusal>;

    /// Checks, before a file comes, that it would be taken now.
    ///
    /// # Errors
    /// A file is being printed.
    fn may_upload(&self) -> Result<(), Refusal>;

    /// Takes a file as the next job; it replaces the one before.
    ///
    /// # Errors
    /// The file is not G-code, or another one is being printed.
    fn upload(&self, upload: Upload) -> Result<(), Refusal>;

    /// Starts the uploaded job.
    ///
    /// # Errors
    /// No file has been uploaded, or the printer is not free.
    fn start(&self) -> Result<(), Refusal>;

    /// Pauses the job after the moves that the printer has.
    ///
    /// # Errors
    /// No job is printed.
    fn pause(&self) -> Result<(), Refusal>;

    /// Continues the job.
    ///
    /// # Errors
    /// The job is not paused.
    fn resume(&self) -> Result<(), Refusal>;

    /// Ends the job: waits, motion and heat.
    ///
    /// # Errors
    /// No job is printed.
    fn cancel(&self) -> Result<(), Refusal>;

    /// Emergency stop (M112), whoever owns the line.
    ///
    /// # Errors
    /// The line is not open, or broken.
    fn stop(&self) -> Result<(), Refusal>;
}
