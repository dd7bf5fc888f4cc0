//! `ferrostep simulate`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use ferrostep_analysis::job_machine::JobMachine;
use ferrostep_analysis::simulation::{
    Compared, ComparedFilter, FilterWords, Measured, Simulated, SimulatedFilter, SimulatedMachine, Simulation, Source,
};
use ferrostep_profiles::PlannedBy;
use ferrostep_session::input;
use ferrostep_session::job::JobProgress;
use ferrostep_session::output::{Accepted, Output, Protected};
use ferrostep_session::report::Stop;
use ferrostep_session::rules::{ByRules, RuledMachine};
use ferrostep_simulator::frame::{FrameSettings, SecondMode};
use ferrostep_simulator::nozzle::{NozzleSettings, SecondSlope};
use ferrostep_simulator::plan::{ExtruderFilter, Filters, Machine};
use ferrostep_simulator::plot::draw;
use ferrostep_simulator::shapers::Shaper;
use indicatif::{ProgressBar, ProgressStyle};

use crate::arguments::{ComparedRules, SimulateArguments};
use crate::machine;
use crate::outcome::{exit_code, result};
use crate::protected::profile_file;

/// Simulates, and prints the measures.
pub fn run(arguments: &SimulateArguments) -> Result<ExitCode, String> {
    let job_machine = machine::of_file(arguments.profile.as_deref(), arguments.rules, &arguments.file)?;
    let RuledMachine { profile, by, .. } = job_machine.ruled().map_err(|error| error.to_string())?;
    let compared_by =
        arguments.compare.map(|ComparedRules::Klipper| klippers(arguments, &job_machine)).transpose()?.flatten();
    let name = input::name(&arguments.file);
    let words = filter_words(arguments);
    let plot = arguments.plot.as_deref().map(|plot| plot_output(plot, arguments)).transpose()?;
    let path = arguments.path.as_deref();
    let mut simulation = Simulation::open(&arguments.file, profile, path, arguments.path_of_steps)
        .map_err(|error| format!("{name}: {error}"))?;
    if let Some(asked) = arguments.rules.filter(|asked| *asked != PlannedBy::Own)
        && simulation.source() != Source::GCode
    {
        return Err(format!(
            "{name}: its steps are planned already: --rules {} takes the G-code that it was made from",
            asked.name()
        ));
    }
    let by = by.filter(|_| simulation.source() == Source::GCode);
    let filters = simulation.filters(&words).map_err(|error| error.to_string())?;
    simulation.set_filters(filters.steps);
    let machine = frame(arguments, filters.frame_hz)?;
    let (source, has_path) = (simulation.source(), simulation.has_path());
    let compared = match (compared_by, &filters.compared) {
        (Some(by), Some(filter)) => {
            Some(klipper(arguments, &machine, by, filter, &simulation).map_err(|error| format!("{name}: {error}"))?)
        }
        _ => None,
    };
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}") {
        bar.set_style(style);
    }
    let rules = by.as_ref().map(|by| by.rules.name());
    let outcome = match by {
        Some(by) => {
            let filters = filters.of_plan(&profile, &by).map_err(|error| error.to_string())?;
            simulation.by_rules(&machine, by, &filters)
        }
        None => simulation.run(&machine, |done: &JobProgress| {
            bar.set_message(format!("line {}, layer {}", done.lines, done.layers));
        }),
    };
    bar.finish_and_clear();
    let (measured, stopped) = outcome.map_err(|error| format!("{name}: {error}"))?;
    if let Some(mut plot) = plot {
        let others = compared.iter().map(|(compared, measured)| (compared.rules, measured));
        let columns = std::iter::once(("steps", &measured)).chain(others);
        let columns: Vec<_> = columns.filter_map(|(name, (_, snapshots))| Some((name, snapshots.as_ref()?))).collect();
        plot.write_all(draw(&name, &columns).as_bytes()).map_err(|error| plot.failed(error).to_string())?;
        plot.keep().map_err(|error| error.to_string())?;
    }
    let simulated = Simulated {
        file: arguments.file.to_string_lossy().into_owned(),
        rules,
        profile: (source != Source::Trace).then(|| job_machine.name(&profile)),
        source: match source {
            Source::GCode => "gcode",
            Source::Prepared => "prepared",
            Source::Trace => "trace",
        },
        path: if has_path { "gcode" } else { "steps" },
        machine: SimulatedMachine::from(&machine),
        detune_percent: arguments.detune,
        input_shaper: SimulatedFilter::of(&filters.steps),
        report: measured.0,
        compared: compared.map(|(compared, _)| compared),
        stopped: stopped.as_ref().map(Stop::from),
    };
    let code = result(arguments.json.then_some(&simulated), || simulated.to_string());
    Ok(match stopped {
        Some(error) => exit_code(Err(format!("{name}: {error}"))),
        None => code,
    })
}

/// The picture, which must not replace what is read.
fn plot_output(plot: &Path, arguments: &SimulateArguments) -> Result<Output, String> {
    let mut protected = vec![Protected { path: &arguments.file, what: "the file to be read" }];
    protected.extend(arguments.path.as_deref().map(|path| Protected { path, what: "the G-code of the path" }));
    protected.extend(arguments.profile.as_deref().and_then(profile_file));
    Output::create(plot, Accepted::FileOrStream, &protected).map_err(|error| error.to_string())
}

fn filter_words(arguments: &SimulateArguments) -> FilterWords {
    FilterWords {
        input_shaper: arguments.input_shaper,
        shaper_frequency_hz: arguments.shaper_frequency,
        shaper_damping: arguments.shaper_damping,
        frame_hz: [arguments.frequency_x, arguments.frequency_y],
        detune_percent: arguments.detune,
        is_compared: arguments.compare.is_some(),
        compared: arguments.shaper,
    }
}

fn frame(arguments: &SimulateArguments, frequency_hz: [f64; 2]) -> Result<Machine, String> {
    let second = match &arguments.nozzle_second_slope {
        None => None,
        Some(text) => {
            let numbers = text.split_once('@').and_then(|(time, flow)| Some((time.parse().ok()?, flow.parse().ok()?)));
            let (time_constant_s, above_mm3_per_s) =
                numbers.ok_or_else(|| format!("--nozzle-second-slope {text}: expected SECONDS@FLOW, as 0.02@8"))?;
            Some(SecondSlope { above_mm3_per_s, time_constant_s })
        }
    };
    let machine = Machine {
        frame: FrameSettings {
            frequency_hz,
            damping: arguments.damping,
            second: arguments.second_mode.then(SecondMode::default),
        },
        nozzle: NozzleSettings { time_constant_s: arguments.nozzle_time_constant, second },
    };
    machine.at_rest().map_err(|error| error.to_string())?;
    Ok(machine)
}

/// Klipper's rules with the limits of corners that are asked for: else those of an imported
/// profile, else Klipper's defaults.
fn klippers(arguments: &SimulateArguments, machine: &JobMachine) -> Result<Option<ByRules>, String> {
    let ruled = RuledMachine::parse(&machine.text, &machine.origin, Some(PlannedBy::Klipper));
    let ruled = ruled.map_err(|error| error.to_string())?;
    let klippers = |default: f64| (!ruled.has_other_firmware()).then_some(default);
    let by = ruled.by.clone().map(|by| {
        by.with_klippers_corners(
            arguments.square_corner_velocity.or(klippers(5.0)),
            arguments.minimum_cruise_ratio.or(klippers(0.5)),
            klippers(1.0),
        )
    });
    by.transpose().map_err(|error| format!("the compared plan: {error}"))
}

fn klipper(
    arguments: &SimulateArguments,
    machine: &Machine,
    by: ByRules,
    filter: &ComparedFilter,
    simulation: &Simulation,
) -> Result<(Compared, Measured), String> {
    let pressure_advance_s = arguments.pressure_advance.unwrap_or(arguments.nozzle_time_constant);
    let ComparedFilter { kind, frequency_hz: [x_hz, y_hz], damping: [x_damping, y_damping] } = *filter;
    let shaper = |hz, damping| Shaper::new(kind, hz, damping).map_err(|error| error.to_string());
    let shapers = [shaper(x_hz, x_damping)?, shaper(y_hz, y_damping)?];
    let filters = Filters { shapers, extruder: ExtruderFilter::klipper(pressure_advance_s, arguments.smooth_time) };
    let (measured, _) = simulation.by_rules(machine, by, &filters).map_err(|error| error.to_string())?;
    let compared = Compared {
        rules: "klipper",
        shaper: kind.to_string(),
        shaper_frequency_hz: filter.frequency_hz,
        pressure_advance_s,
        report: measured.0.clone(),
    };
    Ok((compared, measured))
}
