//! Kinds of commands, before they are executed.

use ferrostep_gcode::{
    AdvanceWords, AxisWords, BacklashWords, CardCommand, Command, FeedWords, GainWords, PrintClockCommand,
    SettingsCommand, ShaperWords, SupplyCommand,
};

/// Treatment of a command while the machine is halted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WhileHalted {
    /// The command only asks or reports, and is executed.
    Works,
    /// The command switches something off that is off already, and has no effect.
    IsOff,
    /// The command is refused until M999.
    Refused,
}

/// Returns the treatment of a command while the machine is halted. A host that connects can still
/// learn that it is halted.
pub(crate) fn while_halted(command: &Command<'_>) -> WhileHalted {
    match command {
        Command::ReportTemperatures
        | Command::AutoReportTemperatures { .. }
        | Command::SetLineNumber(_)
        | Command::KeepAlive(_)
        | Command::HeaterTimeout(_)
        | Command::ReportPosition
        | Command::ReportFirmware
        | Command::ReportEndStops
        | Command::ReportMotion
        | Command::Timing { .. }
        | Command::BlackBox { .. }
        | Command::Display(_)
        | Command::Progress { .. }
        | Command::Layer { .. }
        | Command::Echo { .. }
        | Command::EndWait
        | Command::PromptAnswer(_)
        | Command::Settings(SettingsCommand::Report { .. } | SettingsCommand::Validate)
        | Command::SoftLimits(None)
        | Command::Tower(None)
        | Command::PrintClock(PrintClockCommand::Report)
        | Command::FlowPercent(_, None)
        | Command::SelectTool { tool: None, .. }
        | Command::MotionChoice { interpolation: None, acceleration: None }
        | Command::Card(
            CardCommand::List { .. }
            | CardCommand::Mount
            | CardCommand::ReportProgress
            | CardCommand::ReportFile
            | CardCommand::AutoReport { .. }
            | CardCommand::ReportTime
            | CardCommand::ReportLongPath(_),
        )
        | Command::Supply(SupplyCommand::Report)
        | Command::Accepted
        | Command::Unknown(_)
        | Command::ReportSetting(_)
        | Command::Restart => WhileHalted::Works,
        Command::Bed(bed) if bed.is_query() => WhileHalted::Works,
        Command::Skew(skew) if skew.is_query() => WhileHalted::Works,
        Command::Backlash(words) if *words == BacklashWords::default() => WhileHalted::Works,
        Command::FilamentSensor(words) if words.is_query() => WhileHalted::Works,
        Command::FeedPercent(words) if *words == FeedWords::default() => WhileHalted::Works,
        Command::HomeOffset(words) | Command::StepsPerMm(_, words) | Command::ToolOffset { offset: words, .. }
            if *words == AxisWords::default() =>
        {
            WhileHalted::Works
        }
        Command::InputShaper { axes, .. } if *axes == [ShaperWords::default(); 2] => WhileHalted::Works,
        Command::PressureAdvance(_, words) if *words == AdvanceWords::default() => WhileHalted::Works,
        Command::NozzleGains(_, words) | Command::BedGains(words) | Command::ChamberGains(words)
            if *words == GainWords::default() =>
        {
            WhileHalted::Works
        }
        Command::DisableMotors(_) | Command::HeatersOff | Command::Supply(SupplyCommand::Off { .. }) => {
            WhileHalted::IsOff
        }
        Command::SetNozzle(_, Some(celsius)) | Command::SetBed(Some(celsius)) | Command::SetChamber(Some(celsius))
            if celsius.nanos() <= 0 =>
        {
            WhileHalted::IsOff
        }
        _ => WhileHalted::Refused,
    }
}

/// Returns true if a command moves the nozzle or the filament as a print does.
pub(crate) fn moves(command: &Command<'_>) -> bool {
    matches!(command, Command::Linear { .. } | Command::Arc { .. } | Command::Retract | Command::Recover)
}

/// Returns true for a command that sets how the words of later moves are read: a resumed print has
/// these as before its pause.
pub(crate) fn sets_modes(command: &Command<'_>) -> bool {
    matches!(
        command,
        Command::SetUnits(_)
            | Command::AbsolutePositioning
            | Command::RelativePositioning
            | Command::AbsoluteExtrusion
            | Command::RelativeExtrusion
            | Command::SetPosition(_)
    )
}
