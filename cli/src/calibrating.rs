//! `ferrostep calibrate`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use ferrostep::calibrate::advance::{AdvanceLines, AdvanceSteps};
use ferrostep::calibrate::{self, FrameMeasurement, chart};
use ferrostep::output::{Accepted, Output, Protected};
use ferrostep::terminal;

use crate::arguments::{CalibrateAdvanceArguments, CalibrateShaperArguments, Calibration};
use crate::outcome::{exit_code, result};

/// Measures what is asked for.
pub fn run(calibration: &Calibration) -> Result<ExitCode, String> {
    match calibration {
        Calibration::Shaper(arguments) => shaper(arguments),
        Calibration::Advance(arguments) => advance(arguments),
    }
}

fn shaper(arguments: &CalibrateShaperArguments) -> Result<ExitCode, String> {
    let measured = measured(arguments)?;
    if let Some(plot) = &arguments.plot {
        let record = arguments.record.as_deref().unwrap_or(plot);
        let protected = [Protected { path: record, what: "the record" }];
        let drawn = chart::draw(&measured).ok_or("--plot draws a record of an accelerometer, and there is none")?;
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
        nozzle_celsius: arguments.nozzle,
        bed_celsius: arguments.bed,
    };
    let text = lines.gcode(&profile).map_err(|error| error.to_string())?;
    let protected = [Protected { path: Path::new(&arguments.profile), what: "the profile" }];
    let mut out = Output::create(out, Accepted::FileOrStream, &protected).map_err(|error| error.to_string())?;
    out.write_all(text.as_bytes()).map_err(|error| out.failed(error).to_string())?;
    out.keep().map_err(|error| error.to_string())?;
    Ok(ExitCode::SUCCESS)
}

fn measured(arguments: &CalibrateShaperArguments) -> Result<FrameMeasurement, String> {
    let axis = arguments.axis.index();
    match (&arguments.record, arguments.waves, arguments.over_mm, arguments.speed) {
        (Some(file), ..) => {
            calibrate::from_record(file, axis).map_err(|error| format!("{}: {error}", terminal::name(file)))
        }
        (None, Some(waves), Some(over_mm), Some(speed)) => {
            calibrate::from_waves(axis, waves, over_mm, arguments.reading_mm, speed).map_err(|error| error.to_string())
        }
        _ => Err("expected a record of an accelerometer, or --waves, --over-mm and --speed from a print".to_owned()),
    }
}
