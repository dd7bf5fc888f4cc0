//! Compares a step trace with the job and the profile it came from and prints the report.
//!
//! `cargo xtask check-trace TRACE GCODE(.gz) PROFILE.toml|NAME [--look-ahead N]`. Exit status 0 if
//! nothing was found.

use std::fs;
use std::path::PathBuf;

use ferrostep_oracle::trace_check::{TraceCheckOptions, check_trace};

use crate::steps::Failure;
use crate::{job_text, reference_profile};

/// Arguments of `check-trace`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The trace, of `ferrostep print --trace`
    trace: PathBuf,
    /// The job that was printed, plain or gzip
    gcode: PathBuf,
    /// The profile that it was printed with: cartesian, corexy, prusa-mini or the
    /// path of a TOML file
    profile: String,
    /// Moves that the reference looks ahead; all by default
    #[arg(long, value_name = "MOVES")]
    look_ahead: Option<std::num::NonZeroUsize>,
}

/// Prints the report; returns true if it is free of findings.
///
/// # Errors
/// A file cannot be read.
pub fn run(options: &Options) -> Result<bool, Failure> {
    let profile = reference_profile(&options.profile)?;
    let text = job_text(&options.gcode)?;
    let shown = |error: &dyn std::fmt::Display| format!("{}: {error}", options.trace.display());
    let trace = fs::File::open(&options.trace).map_err(|error| shown(&error))?;
    let check = TraceCheckOptions { look_ahead: options.look_ahead, ..TraceCheckOptions::default() };
    let report = check_trace(trace, &text, &profile, &check).map_err(|error| shown(&error))?;
    print!("{report}");
    Ok(report.passed())
}
