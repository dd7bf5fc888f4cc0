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
    /// The line to the printer is not open.
    Disconnected,
    /// The printer is idle.
    Idle,
    /// The printer is executing a line from the console.
    Working,
    /// The printer is printing the page's job.
    Printing,
    /// The printer is finishing its moves before a pause.
    Pausing,
    /// The job is waiting for a person.
    Paused,
    /// The job is being ended: motion and heat are switched off.
    Cancelling,
    /// The printer has halted after M112 or a fault: motors and heaters are off until M999.
    Halted,
}

/// Temperatures, °C; a target of 0 means off.
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

/// File that is being printed, or could be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Job {
    /// Name of the file, for display only.
    pub name: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Line of the file up to which commands were answered; 0 before the start.
    pub line: u32,
    /// Completed share of the job, 0 to 1.
    pub share: f64,
    /// Printing time left, s, if known.
    pub remaining_s: Option<f64>,
}

/// State of a printer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct State {
    /// Name of the machine and its connection: a profile's name, a port.
    pub machine: String,
    /// Activity of the printer.
    pub activity: Activity,
    /// Description of another host that owns the line; `None` if the page may use the line.
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

/// Reason why a printer does not do what the page asks, and how to mend it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal(pub String);

impl fmt::Display for Refusal {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.0)
    }
}

impl std::error::Error for Refusal {}

/// File that has arrived completely. It is deleted when this value is dropped.
#[derive(Debug)]
pub struct Upload {
    /// File name as given by the client, without control characters; for display, never used as a
    /// path.
    pub name: String,
    /// Content of the file.
    pub file: NamedTempFile,
    /// Size of the file, bytes.
    pub bytes: u64,
}

/// Printer that the page shows. Its methods are called from several threads and must return soon:
/// none may wait for the printer.
pub trait Printer: Send + Sync + 'static {
    /// Returns the printer's current state.
    fn state(&self) -> State;

    /// Returns the console's lines after this number, oldest first.
    fn console(&self, after: u64) -> Vec<ConsoleLine>;

    /// Sends a person's line of G-code.
    ///
    /// # Errors
    /// The printer must not receive a line now.
    fn send_line(&self, line: &str) -> Result<(), Refusal>;

    /// Carries out the action of a button.
    ///
    /// # Errors
    /// The action is not allowed now: during a print, on a halted printer, or with a nozzle too
    /// cold for filament.
    fn control(&self, control: Control) -> Result<(), Refusal>;

    /// Checks, before a file arrives, that it would be accepted now.
    ///
    /// # Errors
    /// A file is already being printed.
    fn may_upload(&self) -> Result<(), Refusal>;

    /// Takes a file as the next job, replacing the previous one.
    ///
    /// # Errors
    /// The file is not G-code, or another one is being printed.
    fn upload(&self, upload: Upload) -> Result<(), Refusal>;

    /// Starts the uploaded job.
    ///
    /// # Errors
    /// No file has been uploaded, or the printer is busy.
    fn start(&self) -> Result<(), Refusal>;

    /// Pauses the job after the moves that the printer already has.
    ///
    /// # Errors
    /// No job is being printed.
    fn pause(&self) -> Result<(), Refusal>;

    /// Continues the job.
    ///
    /// # Errors
    /// The job is not paused.
    fn resume(&self) -> Result<(), Refusal>;

    /// Ends the job: its waits, motion and heat.
    ///
    /// # Errors
    /// No job is being printed.
    fn cancel(&self) -> Result<(), Refusal>;

    /// Stops the printer at once (M112), whichever host owns the line.
    ///
    /// # Errors
    /// The line is not open, or broken.
    fn stop(&self) -> Result<(), Refusal>;
}
