//! Which command goes where.

use ferrostep_gcode::{AxisFlags, AxisWords, Command, Remarks, Reply};
use ferrostep_hal_shim::Heater;

use crate::error::CommandError;
use crate::paused::PauseReason;
use crate::ports::{Motion, Ports, Replies, temperatures};
use crate::printer::{Answer, Printer};

/// Mask of the motors of the axes that a command names; all where it names none.
fn mask(axes: AxisFlags) -> u8 {
    if axes.is_empty() {
        return 0b1111;
    }
    u8::from(axes.x) | u8::from(axes.y) << 1 | u8::from(axes.z) << 2 | u8::from(axes.e) << 3
}

impl<P: Ports> Printer<'_, P> {
    /// Executes a command: one line for each that may wait.
    pub(crate) async fn dispatch(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
        if self.drivers_part(command)?
            && let Some(drivers) = self.drivers
        {
            self.drivers_confirmed(drivers).await?;
        }
        match *command {
            Command::Linear { rapid, ref axes, feed } => self.linear(rapid, axes, feed).await?,
            Command::Arc { clockwise, ref axes, form, feed } => self.arc(clockwise, axes, form, feed).await?,
            Command::Dwell { milliseconds } => self.dwell(milliseconds).await?,
            Command::Retract => self.firmware_retract(true).await?,
            Command::Recover => self.firmware_retract(false).await?,
            Command::Home(axes) => self.home(axes).await?,
            Command::DisableMotors(axes) => self.disable_motors(mask(axes)).await?,
            Command::WaitNozzle(target) => self.wait_for_heat(Heater::Nozzle, target).await?,
            Command::WaitBed(target) => self.wait_for_heat(Heater::Bed, target).await?,
            Command::Fan { index: 0, power } => {
                self.needs(self.equipment.fan || power == 0, "fan")?;
                self.motion.set_fan_power(power).await?;
            }
            Command::Stop { longest_ms } => {
                self.pause_command(PauseReason::Stop, &AxisWords::default(), longest_ms).await?;
            }
            Command::Pause(ref park) => self.pause_command(PauseReason::Pause, park, None).await?,
            Command::ChangeFilament(ref park) => self.pause_command(PauseReason::FilamentChange, park, None).await?,
            Command::ResumePrint if self.is_paused() => self.start_print(None).await?,
            Command::MotionChoice { interpolation, acceleration } => {
                self.choose_motion(interpolation, acceleration).await?;
            }
            Command::ShiftZ { ref words, keeps_offset } => self.shift_z(words, keeps_offset).await?,
            Command::Card(command) => self.card_command(command).await?,
            Command::Finish => self.motion.finish().await?,
            _ => return self.dispatch_at_once(command),
        }
        Ok(Answer::Ok)
    }

    /// Executes a command that never waits: one line for each. A function of its own, because in a future the compiler keeps every
    /// value in memory.
    #[inline(never)]
    fn dispatch_at_once(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
        match *command {
            Command::SetUnits(units) => self.interpreter.modal.units = units,
            Command::AbsolutePositioning => self.interpreter.modal.set_relative(false),
            Command::RelativePositioning => self.interpreter.modal.set_relative(true),
            Command::SetPosition(ref words) => self.set_position(words)?,
            Command::EnableMotors(axes) => self.motion.set_motors_enabled(mask(axes), true),
            Command::IdleTimeout { seconds } => self.signals.set_idle_timeout_s(seconds),
            Command::HeaterTimeout(Some(seconds)) => self.signals.set_heater_timeout_s(seconds),
            Command::HeaterTimeout(None) => self.replies.send(Reply::HeaterTimeout(self.signals.heater_timeout_s())),
            Command::AbsoluteExtrusion => self.interpreter.modal.relative_extruder = false,
            Command::RelativeExtrusion => self.interpreter.modal.relative_extruder = true,
            Command::SetNozzle(Some(celsius)) => self.set_temperature(Heater::Nozzle, celsius.to_f64())?,
            Command::SetBed(Some(celsius)) => self.set_temperature(Heater::Bed, celsius.to_f64())?,
            Command::HeatersOff => {
                self.set_temperature(Heater::Nozzle, 0.0)?;
                self.set_temperature(Heater::Bed, 0.0)?;
            }
            Command::ReportTemperatures => {
                self.needs(self.equipment.heaters, "thermometers")?;
                self.replies.send(Reply::OkTemperatures(temperatures(&self.heating)));
                return Ok(Answer::Given);
            }
            Command::AutoReportTemperatures { seconds } => self.signals.set_report_interval_s(seconds),
            Command::EndWait => self.signals.end_wait(),
            Command::Display(text) => self.display(text),
            Command::Progress { percent, minutes_left } => self.progress(percent, minutes_left),
            Command::Layer { current, total } => self.layer(current, total),
            Command::PromptAnswer(button) => self.signals.answer_prompt(button),
            Command::ResumePrint => return Err(CommandError::NotPaused),
            // A host begins a job with it.
            Command::SetLineNumber(Some(_)) => {
                self.said = Remarks::NONE;
                self.forget_rested_heaters();
            }
            Command::SetLineNumber(None) => self.replies.send(Reply::LastLine(self.last_line)),
            Command::EmergencyStop => return self.emergency_stop(),
            Command::KeepAlive(Some(seconds)) => self.signals.set_keep_alive_s(seconds),
            Command::KeepAlive(None) => self.replies.send(Reply::KeepAlive(self.signals.keep_alive_s())),
            Command::ReportPosition => self.replies.send(Reply::Position(self.position())),
            Command::ReportFirmware => self.report_firmware(),
            Command::ReportEndStops => {
                self.needs(self.equipment.end_stops, "end stops")?;
                self.report_end_stops();
            }
            Command::ReportMotion => self.replies.send(Reply::Motion(self.motion.figures())),
            Command::AdaptiveExtrusion { on, layer_height, line_width, filament_diameter } => {
                self.adaptive_extrusion(on, [layer_height, line_width, filament_diameter])?;
            }
            Command::Timing { on, clear } => self.timing(on, clear),
            Command::ReceiveJob { size, silence_s } => self.request_job(size, silence_s)?,
            Command::Echo { echo_prefix, action_prefix, text } => self.echo(echo_prefix, action_prefix, text),
            Command::MaxAcceleration(ref words) => self.set_max_acceleration(words)?,
            Command::MaxFeed(ref words) => self.set_max_feed(words)?,
            Command::Acceleration { print, retract, travel, both } => {
                self.set_acceleration(print, retract, travel, both)?;
            }
            Command::VelocityLimit { velocity, acceleration } => self.set_velocity_limit(velocity, acceleration)?,
            Command::Junction { deviation, corner_velocity } => self.set_corners(deviation, &corner_velocity)?,
            Command::RetractSettings(ref words) => self.set_retraction(words, false)?,
            Command::RecoverSettings(ref words) => self.set_retraction(words, true)?,
            Command::ProbeOffset(ref words) => self.probe_offset(words)?,
            Command::SoftLimits(enabled) => self.soft_limits(enabled),
            Command::FeedPercent(value) => self.feed_percent(value)?,
            Command::FlowPercent(value) => self.flow_percent(value)?,
            // ANCHOR: m302
            Command::ColdExtrusion { minimum, allow } => self.cold_extrusion(minimum, allow)?,
            // ANCHOR_END: m302
            Command::QuickStop => self.stop_motion(),
            Command::CheckNozzle(diameter) => self.check_nozzle(diameter)?,
            Command::CheckModel(model) => self.check_model(model)?,
            Command::Restart => self.restart()?,
            Command::SelectTool(0) => {}
            Command::SelectTool(tool) => return Err(CommandError::InvalidTool(tool)),
            Command::Unknown(text) => self.replies.unknown(self.line, text),
            // The first four concern the drivers alone, which have been served. The next ones have no effect without a display or
            // a second fan. The rest may wait, see `dispatch`.
            Command::ReportDrivers
            | Command::StealthChop { .. }
            | Command::DriverCurrent(_)
            | Command::StallThreshold(_)
            | Command::Fan { .. }
            | Command::SetNozzle(None)
            | Command::SetBed(None)
            | Command::Accepted
            | Command::Linear { .. }
            | Command::Arc { .. }
            | Command::Dwell { .. }
            | Command::Retract
            | Command::Recover
            | Command::Home(_)
            | Command::DisableMotors(_)
            | Command::WaitNozzle(_)
            | Command::WaitBed(_)
            | Command::Stop { .. }
            | Command::Pause(_)
            | Command::ChangeFilament(_)
            | Command::MotionChoice { .. }
            | Command::ShiftZ { .. }
            | Command::Card(_)
            | Command::Finish => {}
        }
        Ok(Answer::Ok)
    }
}
