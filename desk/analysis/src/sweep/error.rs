//! The error of a job on the printer's frame.

use std::io::Read;
use std::path::Path;

use ferrostep_printer::Profile;
use ferrostep_profiles::response::FrameMode;
use ferrostep_session::input::Input;
use ferrostep_simulator::frame::FrameSettings;
use ferrostep_simulator::plan::Machine;

use crate::simulation::Simulation;
use crate::without_commands::{Dropped, WithoutCommands};

/// Frames that are tried: as measured, and as soft and as stiff as they may be.
const SIDES: [f64; 3] = [0.0, -1.0, 1.0];

/// The distance from the path that the nozzle stays within in 99 % of the printing time, um: the
/// worst of the frames.
///
/// # Errors
/// Message that says why the job cannot be simulated.
pub fn simulated_um(file: &Path, profile: Profile, dropped: &Dropped, frame: [FrameMode; 2]) -> Result<f64, String> {
    let mut worst_um = 0.0f64;
    for side in SIDES {
        let input = Input::open(file).map_err(|error| error.to_string())?;
        let mut text = Vec::new();
        WithoutCommands::new(input, dropped).read_to_end(&mut text).map_err(|error| error.to_string())?;
        let frequency_hz = frame.map(|mode| mode.frequency_hz + side * mode.frequency_uncertainty_hz);
        // The simulator has one damping for both axes: the smaller leaves more.
        let damping = frame.iter().map(|mode| mode.damping).fold(f64::INFINITY, f64::min);
        let frame = FrameSettings { frequency_hz, damping, second: None };
        let machine = Machine { frame, ..Machine::default() };
        let simulation = Simulation::of_text(text, profile).map_err(|error| error.to_string())?;
        let ((report, _), stopped) = simulation.run(&machine, |_| {}).map_err(|error| error.to_string())?;
        if let Some(error) = stopped {
            return Err(error.to_string());
        }
        worst_um = worst_um.max(report.contour_error_um.p99);
    }
    Ok(worst_um)
}
