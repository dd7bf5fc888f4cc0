//! `ferrostep serve`.

pub mod image;
mod page;

use std::io::IsTerminal;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ferrostep_host::printable;
use ferrostep_host_line::Line;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::HomeSensor;
use ferrostep_profiles::response::FrameMode;
use ferrostep_session::card_image::CardImage;
use ferrostep_session::duration::hms;
use ferrostep_session::report::{Motors, Stop, Summary};
use ferrostep_session::serve::{self, Hosts, Served, Settings, Status};
use ferrostep_session::settings_file::SettingsFile;
use ferrostep_simulator::frame::Mode;
use indicatif::{ProgressBar, ProgressStyle};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use crate::arguments::ServeArguments;
use crate::outcome::{exit_code, result};
use crate::terminal::tell;
use page::VirtualPage;

/// The frame that a profile knows along X and Y.
fn frame(profile: &str) -> Result<Option<[Mode; 2]>, String> {
    let text = ferrostep_profiles::text(profile).map_err(|error| error.to_string())?;
    let budget = ferrostep_profiles::error_budget(&text, profile).map_err(|error| error.to_string())?;
    let [Some(x), Some(y)] = budget.frame else { return Ok(None) };
    let mode = |of: FrameMode| Mode::new(of.frequency_hz, of.damping).map_err(|error| error.to_string());
    Ok(Some([mode(x)?, mode(y)?]))
}

/// Serves until the process is interrupted, then prints a summary.
///
/// # Errors
/// The profile has an error, or the line cannot be opened.
pub fn run(arguments: &ServeArguments) -> Result<ExitCode, String> {
    let profile = ferrostep_profiles::load(&arguments.profile).map_err(|error| error.to_string())?;
    let card = arguments.card.as_ref().map(|path| CardImage::open(path)).transpose()?;
    let memory = arguments.settings.as_ref().map(|path| SettingsFile::open(path)).transpose()?;
    // Registered before the line exists, so that the line never outlives the program.
    let ends = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // A second one ends the program at once.
        flag::register_conditional_shutdown(signal, 1, Arc::clone(&ends)).map_err(|error| error.to_string())?;
        flag::register(signal, Arc::clone(&ends)).map_err(|error| error.to_string())?;
    }
    if card.is_none() && arguments.fault.iter().any(|fault| fault.kind.is_of_card()) {
        return Err("--fault card-pull and card-back need a card: add --card IMAGE|FOLDER".to_owned());
    }
    if profile.filament_sensor.is_none() && arguments.fault.iter().any(|fault| fault.kind.is_of_filament()) {
        return Err(
            "--fault filament-out and filament-back need a sensor: add [filament_sensor] to the profile".to_owned()
        );
    }
    if profile.supply_signal.is_none() && arguments.fault.iter().any(|fault| fault.kind.is_of_supply()) {
        return Err("--fault power-loss and power-back need a signal: add [power_loss] to the profile".to_owned());
    }
    let sees_it_move = profile.filament_sensor.is_some_and(|sensor| sensor.detection_10nm().is_some());
    if !sees_it_move && arguments.fault.iter().any(|fault| fault.kind.is_of_moving_filament()) {
        return Err(
            "--fault filament-jam and filament-free need a sensor that sees filament move: add [filament_sensor] with \
                    kind = \"motion\" to the profile"
                .to_owned(),
        );
    }
    let [.., z] = &profile.homing;
    let has_pin = profile.bltouch.is_some() && z.sensor == HomeSensor::Probe;
    if !has_pin && arguments.fault.iter().any(|fault| fault.kind.is_of_pin()) {
        return Err("--fault pin-stays-in, pin-stays-out and pin-works need a probe with a pin: add [bltouch] to a profile with \
                    homing.z.sensor = \"probe\""
            .to_owned());
    }
    if let (Some(address), Some(port)) = (arguments.web, &arguments.port) {
        return page::before_a_port(arguments, address, port, profile, &ends);
    }
    let outside = match (&arguments.pty, arguments.tcp) {
        (Some(path), _) => Some(Line::pty(path)?),
        (None, Some(port)) => Some(Line::tcp(port)?),
        (None, None) => None,
    };
    let outside_address = outside.as_ref().map(Line::address);
    let page =
        arguments.web.map(|address| VirtualPage::open(arguments, address, profile, outside_address.clone(), &ends));
    let (page, page_line) = page.transpose()?.unzip();
    let address = match (outside_address, &page) {
        (Some(address), _) => address,
        (None, Some(page)) => page.address(),
        (None, None) => return Err("no line to serve on: add --pty PATH, --tcp PORT or --web".to_owned()),
    };
    tell(format_args!(
        "{} on {}, speed {}; Ctrl-C ends it",
        profile.name,
        printable::one_line(&address),
        arguments.speed
    ));
    if let Some(page) = &page {
        page.announce();
    }
    let settings = Settings {
        profile,
        speed: arguments.speed,
        faults: arguments.fault.clone(),
        frame: frame(&arguments.profile)?,
        card: card.as_ref().map(|card| card.bytes.clone()),
    };
    let bar = std::io::stderr().is_terminal().then(status_line);
    let started = Instant::now();
    let served = serve::serve(
        Hosts::new(outside, page_line),
        &settings,
        memory.as_ref(),
        || ends.load(Ordering::Relaxed),
        |status| {
            if let Some(page) = &page {
                page.show(status);
            }
            if let Some(bar) = &bar {
                bar.set_message(describe(status));
            }
        },
    );
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    drop(page);
    if let (Some(card), Some(image)) = (&card, &served.card)
        && card.bytes != *image
    {
        match &card.written_to {
            Some(path) => std::fs::write(path, image).map_err(|error| format!("{}: {error}", path.display()))?,
            None => tell("note: what was written to the card is gone: a folder given as --card is only read"),
        }
    }
    let failed = served.failed.clone();
    let summary = summary(served, address, profile.name, started.elapsed());
    let code = result(arguments.json.then_some(&summary), || format!("{summary}\n"));
    Ok(failed.map_or(code, |error| exit_code(Err(format!("the line to the host is broken: {error}")))))
}

/// A status line at the terminal's bottom.
fn status_line() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{wide_msg}") {
        bar.set_style(style);
    }
    bar
}

fn describe(status: &Status) -> String {
    let [x, y, z] = status.position_mm;
    let heat = &status.temperatures;
    format!(
        "{}{}  X{x:.1} Y{y:.1} Z{z:.2}  nozzle {:.0}/{:.0} bed {:.0}/{:.0}  {} lines  queue {}  {}",
        status.state.name(),
        if status.is_connected { "" } else { ", no host" },
        heat.nozzle,
        heat.nozzle_target,
        heat.bed,
        heat.bed_target,
        status.lines,
        status.queued_entries,
        hms(status.time_s)
    )
}

fn summary(served: Served, address: String, profile: &str, wall: Duration) -> Summary {
    let wall_s = wall.as_secs_f64();
    let figures = &served.figures;
    Summary {
        file: address,
        profile: profile.to_owned(),
        lines: served.lines,
        moves: served.tally.moves,
        unknown_commands: served.unknown_commands,
        clamped_moves: served.tally.clamped_moves,
        extent_mm: None,
        print_time_s: figures.print_time_s,
        motion_time_s: figures.motion_time_s,
        filament_mm: served.tally.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
        position_mm: served.logical_10nm.map(|length| length as f64 / UNITS_PER_MM as f64).into(),
        motors: Some(Motors::from(figures)),
        wall_s,
        realtime_factor: figures.motion_time_s / wall_s.max(1e-9),
        slicer: None,
        layers: 0,
        rules: None,
        took: None,
        limits: None,
        parts: None,
        slicer_time_s: None,
        remarks: None,
        stopped: served.failed.map(|message| Stop { line: None, message }),
    }
}
