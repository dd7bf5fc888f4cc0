//! `ferrostep calibrate`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use ferrostep_analysis::calibrate::advance::{AdvanceLines, AdvanceSteps};
use ferrostep_analysis::calibrate::flow::{FlowSteps, FlowTube};
use ferrostep_analysis::calibrate::pattern::Temperatures;
use ferrostep_analysis::calibrate::speed::{SpeedMoves, SpeedSteps, Tried};
use ferrostep_analysis::calibrate::{self, FrameMeasurement, chart};
use ferrostep_host::printable;
use ferrostep_session::output::{Accepted, Output, Protected};

use crate::arguments::{
    CalibrateAdvanceArguments, CalibrateFlowArguments, CalibrateShaperArguments, CalibrateSpeedArguments, Calibration,
    HeatArguments, TriedArgument,
};
use crate::outcome::{exit_code, result};
use crate::terminal;

/// Measures what is asked for.
pub fn run(calibration: &Calibration) -> Result<ExitCode, String> {
    match calibration {
        Calibration::Shaper(arguments) => shaper(arguments),
        Calibration::Advance(arguments) => advance(arguments),
        Calibration::Flow(arguments) => flow(arguments),
        Calibration::Speed(arguments) => speed(arguments),
    }
}

fn shaper(arguments: &CalibrateShaperArguments) -> Result<ExitCode, String> {
    let measured = measured(arguments)?;
    if let Some(plot) = &arguments.plot {
        let record = arguments.record.as_deref().unwrap_or(plot);
        let protected = [Protected { path: record, what: "the record" }];
        let drawn = chart::draw(&measured).ok_or("--plot draws the record of an accelerometer: give its file")?;
        let mut plot = Output::create(plot, Accepted::FileOrStream, &protected).map_err(|error| error.to_string())?;
        plot.write_all(drawn.as_bytes()).map_err(|error| plot.failed(error).to_string())?;
        plot.keep().map_err(|error| error.to_string())?;
    }
    Ok(result(arguments.json.then_some(&measured), || measured.to_string()))
}

fn advance(arguments: &CalibrateAdvanceArguments) -> Result<ExitCode, String> {
    let steps = AdvanceSteps { first_s: arguments.from, step_s: arguments.step, lines: arguments.lines };
    let Some(out) = &arguments.out else {
        let keys = steps.keys(arguments.best.unwrap_or_default()).map_err(|error| error.to_string())?;
        return Ok(exit_code(terminal::write_result(&keys)));
    };
    let profile = ferrostep_profiles::load(&arguments.profile).map_err(|error| error.to_string())?;
    let lines = AdvanceLines {
        steps,
        slow_mm_per_s: arguments.slow,
        fast_mm_per_s: arguments.fast,
        temperatures: temperatures(arguments.heat),
    };
    write(out, &arguments.profile, &lines.gcode(&profile).map_err(|error| error.to_string())?)
}

fn flow(arguments: &CalibrateFlowArguments) -> Result<ExitCode, String> {
    let profile = ferrostep_profiles::load(&arguments.profile).map_err(|error| error.to_string())?;
    let steps = FlowSteps { first_mm3_per_s: arguments.from, step_mm3_per_s: arguments.step, bands: arguments.bands };
    let keys = match (&arguments.out, arguments.whole_to_mm) {
        (Some(out), _) => {
            let tube = FlowTube { steps, temperatures: temperatures(arguments.heat), fan_percent: arguments.fan };
            return write(out, &arguments.profile, &tube.gcode(&profile).map_err(|error| error.to_string())?);
        }
        (None, Some(whole_mm)) => steps.keys_of_height(whole_mm, &profile),
        (None, None) => FlowSteps::keys_of_walls(&arguments.walls, &profile),
    };
    Ok(exit_code(terminal::write_result(&keys.map_err(|error| error.to_string())?)))
}

fn speed(arguments: &CalibrateSpeedArguments) -> Result<ExitCode, String> {
    let (tried, first, step) = match arguments.of {
        TriedArgument::Acceleration => (Tried::Acceleration, 1000.0, 1000.0),
        TriedArgument::Speed => (Tried::Speed, 100.0, 50.0),
    };
    let [first, step] = [arguments.from.unwrap_or(first), arguments.step.unwrap_or(step)];
    let steps = SpeedSteps { tried, first, step, stages: arguments.stages };
    let Some(out) = &arguments.out else {
        let keys = steps.keys(arguments.good.unwrap_or_default()).map_err(|error| error.to_string())?;
        return Ok(exit_code(terminal::write_result(&keys)));
    };
    let profile = ferrostep_profiles::load(&arguments.profile).map_err(|error| error.to_string())?;
    let moves = SpeedMoves { steps, repeats: arguments.repeats, temperatures: temperatures(arguments.heat) };
    write(out, &arguments.profile, &moves.gcode(&profile).map_err(|error| error.to_string())?)
}

fn temperatures(heat: HeatArguments) -> Temperatures {
    Temperatures { nozzle_celsius: heat.nozzle, bed_celsius: heat.bed }
}

/// Writes a pattern, which must not replace the profile.
fn write(out: &Path, profile: &str, text: &str) -> Result<ExitCode, String> {
    let protected = [Protected { path: Path::new(profile), what: "the profile" }];
    let mut out = Output::create(out, Accepted::FileOrStream, &protected).map_err(|error| error.to_string())?;
    out.write_all(text.as_bytes()).map_err(|error| out.failed(error).to_string())?;
    out.keep().map_err(|error| error.to_string())?;
    Ok(ExitCode::SUCCESS)
}

fn measured(arguments: &CalibrateShaperArguments) -> Result<FrameMeasurement, String> {
    let axis = arguments.axis.index();
    match (&arguments.record, arguments.waves, arguments.over_mm, arguments.speed) {
        (Some(file), ..) => {
            calibrate::from_record(file, axis).map_err(|error| format!("{}: {error}", printable::name(file)))
        }
        (None, Some(waves), Some(over_mm), Some(speed)) => {
            calibrate::from_waves(axis, waves, over_mm, arguments.reading_mm, speed).map_err(|error| error.to_string())
        }
        _ => Err("expected a record of an accelerometer, or --waves, --over-mm and --speed from a print".to_owned()),
    }
}
