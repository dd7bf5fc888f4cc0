//! Prints a job's motion time by the reference planner.
//!
//! ```text
//! cargo xtask reference-time GCODE(.gz) PROFILE.toml|NAME [--junction-deviation MM]
//!     [--without-limits] [--look-ahead N]
//! ```

use std::num::NonZeroUsize;
use std::path::PathBuf;

use ferrostep_oracle::reference::{InterpretOptions, interpret, plan};

use crate::steps::Failure;
use crate::{job_text, reference_profile};

/// Arguments of `reference-time`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// The job, plain or gzip
    gcode: PathBuf,
    /// The profile: cartesian, corexy, prusa-mini or the path of a TOML file
    profile: String,
    /// Junction deviation instead of the profile's
    #[arg(long, value_name = "MM")]
    junction_deviation: Option<f64>,
    /// Leaves out the limits that the file sets (M201 to M205)
    #[arg(long)]
    without_limits: bool,
    /// Moves that the planner looks ahead; all by default
    #[arg(long, value_name = "MOVES")]
    look_ahead: Option<NonZeroUsize>,
}

/// Prints the reference planner's result for the job.
///
/// # Errors
/// A file cannot be read.
pub fn run(options: &Options) -> Result<(), Failure> {
    let mut profile = reference_profile(&options.profile)?;
    profile.junction_deviation_mm = options.junction_deviation.unwrap_or(profile.junction_deviation_mm);
    let text = job_text(&options.gcode)?;
    let job = interpret(&text, &profile, InterpretOptions { without_limits: options.without_limits })
        .map_err(|error| format!("{}: {error}", options.gcode.display()))?;
    let plan = plan(&job, options.look_ahead);
    println!("lines          {}", job.lines);
    println!("moves          {}", job.move_count());
    println!("clamped moves  {}", job.clamped_moves);
    println!("filament       {:.5} mm", job.filament_mm());
    println!("motion time    {:.4} s", plan.motion_time_s);
    Ok(())
}
