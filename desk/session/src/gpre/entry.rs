//! A prepared job entered at one of its frames: the settings made before it, and the travel there.

use std::io::Read;

use ferrostep_gcode::{Command, HeaterModelWords, parse};
use ferrostep_gpre::compact::{Decoder, FrameState};
use ferrostep_gpre::{Fault, Item};
use ferrostep_printer::{CommandError, Ports, Printer, Profile};

use super::part_reader::PartReader;
use crate::job::JobError;

/// Height of the nozzle above the print while X and Y are homed and while it travels,
/// units of 10 nm: 5 mm.
const CLEARANCE_10NM: i64 = 500_000;

/// Feed of the travel to the frame's start, mm/min.
const TRAVEL_MM_PER_MIN: u32 = 3_000;

/// Settings from before the entry that stay in force and that no frame contains.
#[derive(Debug, Default)]
pub struct Passed {
    /// Settings of the motors' drivers: sent before anything moves.
    drivers: Vec<(u32, String)>,
    /// The others: sent when the machine has reached the frame's start.
    others: Vec<(u32, String)>,
}

impl Passed {
    /// Takes the settings of a frame that is skipped.
    pub fn pass(&mut self, items: &mut Decoder<'_>) -> Result<(), Fault> {
        while let Some(item) = items.next_item()? {
            let Item::Command { line, text } = item else { continue };
            match parse(text) {
                Ok(Command::StealthChop { .. } | Command::Driver(..)) => {
                    self.drivers.push((line, text.to_owned()));
                }
                Ok(
                    Command::SetUnits(_)
                    | Command::AbsolutePositioning
                    | Command::RelativePositioning
                    | Command::AbsoluteExtrusion
                    | Command::RelativeExtrusion
                    | Command::RetractSettings(_)
                    | Command::RecoverSettings(_)
                    | Command::SoftLimits(_)
                    | Command::FilamentSensor(_)
                    | Command::ColdExtrusion { .. }
                    // The frame has nozzle and bed only.
                    | Command::SetChamber(_)
                    | Command::WaitChamber(_)
                    | Command::NozzleGains(..)
                    | Command::BedGains(_)
                    | Command::ChamberGains(_)
                    | Command::MotionChoice { .. }
                    | Command::InputShaper { .. }
                    | Command::PressureAdvance(..)
                    | Command::AdaptiveExtrusion { .. }
                    // Values that B has stored are in no frame; the frame sets those of S again.
                    | Command::FeedPercent(_)
                    | Command::FilamentLengths { .. }
                    | Command::HomeOffset(_)
                    | Command::Skew(_)
                    | Command::Backlash(_)
                    | Command::PrintClock(_)
                    // The frame has the part-cooling fan only.
                    | Command::Fan { number: 1.., .. }
                    | Command::NamedFan { .. }
                    | Command::SetOutput { .. }
                    | Command::SetLight { .. }
                    | Command::AutoReportTemperatures { .. }
                    | Command::KeepAlive(Some(_))
                    | Command::IdleTimeout { .. }
                    | Command::HeaterTimeout(Some(_)),
                ) => self.others.push((line, text.to_owned())),
                Ok(Command::HeaterModel { words, .. }) => {
                    if HeaterModelWords::read(words).is_ok_and(|words| !words.tunes) {
                        self.others.push((line, text.to_owned()));
                    }
                }
                // The frame itself contains what these have set.
                Ok(
                    Command::SetPosition(_)
                    | Command::SetNozzle(..)
                    | Command::WaitNozzle(..)
                    | Command::SetBed(_)
                    | Command::WaitBed(_)
                    | Command::Fan { number: 0, .. }
                    | Command::MaxAcceleration(_)
                    | Command::MaxFeed(_)
                    // A job with other steps than the profile's is refused.
                    | Command::StepsPerMm(..)
                    | Command::Acceleration { .. }
                    | Command::VelocityLimit { .. }
                    | Command::HeatersOff
                    | Command::Junction { .. }
                    | Command::FlowPercent(..),
                ) => {}
                // Commands without lasting effect: motion, waits, reports, queries, M500 to M502 in
                // a job. No job contains a tower. M851 matters when Z is homed, as it is not here.
                Ok(
                    Command::Linear { .. }
                    | Command::Arc { .. }
                    | Command::Dwell { .. }
                    | Command::Retract
                    | Command::Recover
                    | Command::Home { .. }
                    | Command::ProbeOffset(_)
                    // No job follows a mesh.
                    | Command::Bed(_)
                    | Command::Settings(_)
                    | Command::ShiftZ { .. }
                    // A job with another offset than 0 is not prepared.
                    | Command::OffsetZ { .. }
                    | Command::Tower(_)
                    | Command::Accelerometer { .. }
                    | Command::RecordAcceleration { .. }
                    | Command::EnableMotors(_)
                    | Command::DisableMotors(_)
                    // The supply is on when a job is entered.
                    | Command::Supply(_)
                    | Command::ProbePin(_)
                    | Command::Finish
                    | Command::Stop { .. }
                    | Command::Pause(_)
                    | Command::ChangeFilament { .. }
                    | Command::LoadFilament { .. }
                    | Command::ResumePrint
                    | Command::ReportFans
                    | Command::Autotune { .. }
                    | Command::PromptAnswer(_)
                    | Command::QuickStop
                    | Command::EmergencyStop
                    | Command::Restart
                    | Command::EndWait
                    // No job selects another tool than the first.
                    | Command::SelectTool { .. }
                    | Command::ToolOffset { .. }
                    | Command::SetLineNumber(_)
                    | Command::Card(_)
                    | Command::ReceiveJob { .. }
                    | Command::BlackBox { .. }
                    | Command::Timing { .. }
                    | Command::Display(_)
                    | Command::Progress { .. }
                    | Command::Layer { .. }
                    | Command::Echo { .. }
                    | Command::KeepAlive(None)
                    | Command::HeaterTimeout(None)
                    | Command::ReportTemperatures
                    | Command::ReportDrivers
                    | Command::ReportPosition
                    | Command::ReportSetting(_)
                    | Command::ReportFirmware
                    | Command::ReportEndStops
                    | Command::ReportMotion
                    | Command::CheckNozzle(_)
                    | Command::CheckModel(_)
                    | Command::Accepted
                    | Command::Unknown(_),
                )
                | Err(_) => {}
            }
        }
        Ok(())
    }
}

/// Error for a frame number outside the job.
pub fn no_such_frame(number: u32, frames: u32) -> JobError {
    let last = frames.saturating_sub(1);
    JobError::Entry { frame: number, message: format!("there is no such frame, expected one from 0 to {last}") }
}

/// Error for a job in packets, which has no frames to enter at.
pub fn no_frames(number: u32) -> JobError {
    let message = "packets cannot be entered: prepare the job with --format compact".to_owned();
    JobError::Entry { frame: number, message }
}

/// Error for a frame that cannot be entered, with the next one that can; the reader has
/// just read the frame.
pub fn not_here<R: Read>(number: u32, reader: &mut PartReader<R>, frames: u32) -> JobError {
    let next = loop {
        match reader.frame(frames) {
            Ok(Some((frame, _))) => match frame.items() {
                Ok(items) if items.start().can_be_entered => break Some(frame.number),
                Ok(_) => {}
                Err(_) => break None,
            },
            Ok(None) | Err(_) => break None,
        }
    };
    let next = match next {
        Some(next) => format!("the next one that can be entered is {next}"),
        None => "no later one can".to_owned(),
    };
    let message = format!("a job cannot be entered here, because its first move continues the one before; {next}");
    JobError::Entry { frame: number, message }
}

/// Brings the machine to where a frame begins, and takes over the settings in force there.
///
/// The nozzle is assumed at the frame's height: after a power cut it is on or in the print, and Z
/// cannot be homed. Bed and nozzle are heated before anything moves, so that nothing is torn off.
/// Then the nozzle is raised, X and Y are homed, and it travels over the print to the frame's
/// start, and down.
///
/// # Errors
/// The command that could not be executed, as for a line of G-code.
pub async fn approach<P: Ports>(
    state: &FrameState,
    number: u32,
    passed: &Passed,
    profile: &Profile,
    printer: &mut Printer<'_, P>,
) -> Result<(), JobError> {
    let failed = |error: CommandError| JobError::Entry { frame: number, message: error.to_string() };
    let [x, y, z] = state.position_10nm;
    let (nozzle, bed) = (state.modal.nozzle_celsius, state.modal.bed_celsius);
    let mut heat = Vec::new();
    if bed > 0 {
        heat.push(format!("M190 S{bed}"));
    }
    if nozzle > 0 {
        heat.push(format!("M109 S{nozzle}"));
    }
    let raised = (z + CLEARANCE_10NM).min(profile.size_10nm[2]).max(z);
    let z_feed = (profile.homing[2].fast_mm_per_s * 60.0).round();
    let mm = |length_10nm: i64| {
        format!(
            "{}{}.{:05}",
            if length_10nm < 0 { "-" } else { "" },
            length_10nm.abs() / 100_000,
            length_10nm.abs() % 100_000
        )
    };
    let travel = [
        format!("G1 Z{} F{z_feed}", mm(raised)),
        "G28 X Y".to_owned(),
        format!("G1 X{} Y{} F{TRAVEL_MM_PER_MIN}", mm(x), mm(y)),
        format!("G1 Z{} F{z_feed}", mm(z)),
        "M400".to_owned(),
    ];
    run(passed.drivers.iter().map(|(line, text)| (*line, text.as_str())), number, printer).await?;
    run(heat.iter().map(|text| (state.line, text.as_str())), number, printer).await?;
    printer.take_height(z).await.map_err(failed)?;
    run(travel.iter().map(|text| (state.line, text.as_str())), number, printer).await?;
    run(passed.others.iter().map(|(line, text)| (*line, text.as_str())), number, printer).await?;
    printer.enter_prepared(state).await.map_err(failed)
}

/// Executes commands before a frame is entered.
async fn run<'a, P: Ports>(
    commands: impl Iterator<Item = (u32, &'a str)>,
    frame: u32,
    printer: &mut Printer<'_, P>,
) -> Result<(), JobError> {
    for (line, text) in commands {
        let failed = |failure| JobError::Entry { frame, message: format!("before it is entered: {text:?}: {failure}") };
        printer.execute(line, text).await.map_err(failed)?;
    }
    Ok(())
}
