//! Dispatches commands to their handlers.

use ferrostep_gcode::{
    AxisFlags, AxisWords, Command, Decimal, PrintClockCommand, Remarks, Reply, SupplyCommand, WaitTarget,
};
use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_planner::surface::Bed;

use crate::commands::power_loss::{FORGET, RESUME};
use crate::error::CommandError;
use crate::job::lines::Source;
use crate::job::paused::{PauseReason, PauseWords};
use crate::part::Part;
use crate::ports::{Heating, Motion, Ports, Replies, temperatures};
use crate::printer::{Answer, Printer};

/// The measurement of a heater.
struct Tuning {
    heater: Heater,
    target: Option<Decimal>,
    cycles: Option<u8>,
    uses: bool,
}

/// Mask of the motors of the axes that a command names; all if it names none.
fn mask(axes: AxisFlags) -> u8 {
    if axes.is_empty() {
        return 0b1111;
    }
    u8::from(axes.x) | u8::from(axes.y) << 1 | u8::from(axes.z) << 2 | u8::from(axes.e) << 3
}

impl<P: Ports> Printer<'_, P> {
    /// Executes a command.
    pub(crate) async fn dispatch(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
        self.needs_supply(command)?;
        self.motion.see(command, self.interpreter.modal.unit_mm());
        if self.drivers_part(command)?
            && let Some(drivers) = self.fitted.drivers
        {
            self.drivers_confirmed(drivers).await?;
        }
        if let Some(answer) = self.at_once(command)? {
            return Ok(answer);
        }
        // One await for all commands that wait for the same, which takes less room than several.
        match *command {
            Command::Linear { rapid, ref axes, feed } => self.linear(rapid, axes, feed).await?,
            Command::Arc { clockwise, ref axes, form, feed } => self.arc(clockwise, axes, form, feed).await?,
            Command::Dwell { milliseconds } => self.dwell(milliseconds).await?,
            Command::Retract | Command::Recover => {
                self.firmware_retract(matches!(command, Command::Retract)).await?;
            }
            Command::Home { axes, unless_homed } => {
                if let Some(axes) = if unless_homed { self.unhomed(axes) } else { Some(axes) } {
                    self.home(axes).await?;
                }
            }
            Command::DisableMotors(axes) => {
                self.disable_motors(mask(axes)).await?;
                self.keep_statistics();
            }
            Command::WaitNozzle(..) | Command::WaitBed(_) | Command::WaitChamber(_) => {
                if let Some((heater, target)) = self.awaited_heat(command)? {
                    self.wait_for_heat(heater, target).await?;
                }
            }
            Command::Autotune { .. } | Command::HeaterModel { .. } => {
                if let Some(Tuning { heater, target, cycles, uses }) = self.tuning(command)? {
                    self.autotune(heater, target, cycles, uses).await?;
                }
            }
            Command::Fan { .. } | Command::NamedFan { .. } | Command::SetOutput { .. } => {
                if let Some((output, power)) = self.switched_output(command)? {
                    self.print.power_loss.set_fan(output, power);
                    self.motion.set_fan_power(output, power).await?;
                }
            }
            Command::SetLight { colors } => self.set_light(colors).await?,
            Command::Stop { .. } | Command::Pause(_) | Command::ChangeFilament { .. } => {
                if let Some((reason, words)) = self.asked_pause(command)? {
                    self.pause_command(reason, &words).await?;
                }
            }
            Command::LoadFilament { loads, tool, length, rise } => {
                self.needs_selected(tool)?;
                self.load_filament(loads, length, rise).await?;
            }
            Command::ResumePrint => self.start_print(None).await?,
            Command::MotionChoice { interpolation, acceleration } => {
                self.choose_motion(interpolation, acceleration).await?;
            }
            Command::InputShaper { ref axes, usual } => self.shape(axes, usual).await?,
            Command::PressureAdvance(tool, ref words) => self.advance(tool, words).await?,
            Command::ShiftZ { ref words, keeps_offset } => self.shift_z(words, keeps_offset).await?,
            Command::OffsetZ { offset, adds, moves } => self.offset_z(offset, adds, moves).await?,
            Command::Bed(ref command) => {
                if P::Motion::HAS_BED {
                    let printer = &mut *self;
                    <P::Motion as Motion>::Bed::only(move || printer.bed(command)).await?;
                }
            }
            Command::Card(_) | Command::PromptAnswer(_) => {
                let asked = match *command {
                    Command::Card(card) => card,
                    Command::PromptAnswer(0) => RESUME,
                    _ => FORGET,
                };
                self.card_command(asked).await?;
            }
            Command::Supply(SupplyCommand::Off { .. }) if !self.has_supply() => self.everything_off(false).await?,
            Command::Supply(command) => {
                if <P::Heating as Heating>::Supply::PRESENT {
                    let printer = &mut *self;
                    <P::Heating as Heating>::Supply::only(move || printer.supply(command)).await?;
                }
            }
            Command::ProbePin(command) => {
                if <P::Motion as Motion>::Servo::PRESENT {
                    let printer = &mut *self;
                    <P::Motion as Motion>::Servo::only(move || printer.probe_pin(command)).await?;
                }
            }
            Command::SelectTool { tool: Some(number), stays } => {
                if <P::Motion as Motion>::Tools::PRESENT {
                    let printer = &mut *self;
                    <P::Motion as Motion>::Tools::only(move || printer.change_tool(number, stays)).await?;
                }
            }
            // Commands that do not wait. In `at_once` they would need more stack than all other
            // commands: a tower reads lines, M503 writes many, and a stop plans the motion to its
            // end.
            Command::Tower(ref words) => self.set_tower(words.as_ref())?,
            Command::Settings(command) if !Self::needs_standstill(command) => self.show_settings(command),
            Command::ReportSetting(code) => self.report_setting(code),
            Command::StepsPerMm(_, ref words) if *words == AxisWords::default() => self.report_steps_per_mm(),
            Command::QuickStop => self.quick_stop(),
            Command::EmergencyStop => return self.emergency_stop(),
            Command::Restart => self.restart()?,
            _ => {
                self.motion.finish().await?;
                self.at_standstill(command)?;
            }
        }
        Ok(Answer::Ok)
    }

    /// Executes a command that waits only for the end of motion.
    fn at_standstill(&mut self, command: &Command<'_>) -> Result<(), CommandError> {
        match *command {
            Command::Settings(command) => self.change_settings(command),
            Command::StepsPerMm(tool, ref words) => self.set_steps_per_mm(tool, words)?,
            Command::ToolOffset { tool, ref offset } => self.tool_offset(tool, offset)?,
            Command::PrintClock(command) => {
                self.print_clock(command);
                self.keep_statistics();
            }
            Command::Skew(ref command) => self.skew(command)?,
            Command::Backlash(ref words) => self.backlash(words)?,
            Command::RecordAcceleration { samples, at_next_move } => {
                self.needed_accelerometer()?.record(samples, at_next_move)?;
            }
            // M400.
            _ => {}
        }
        Ok(())
    }

    /// Stops motion at once, without a halt (M410).
    fn quick_stop(&mut self) {
        let stops = self.motion.stops();
        self.stop_motion();
        if self.lines.source == Source::Card {
            self.print.card.note_own_stops(self.motion.stops().wrapping_sub(stops));
        }
    }

    /// The heater that a command waits for, and the target; `None` on a machine without the heater.
    fn awaited_heat(&self, command: &Command<'_>) -> Result<Option<(Heater, WaitTarget)>, CommandError> {
        Ok(match *command {
            Command::WaitNozzle(tool, target) => Some((self.nozzle_of(tool)?, target)),
            Command::WaitBed(target) => Some((Heater::Bed, target)),
            Command::WaitChamber(target) if self.has_chamber() => Some((Heater::Chamber, target)),
            _ => None,
        })
    }

    /// The heater measurement that M303 or M306 asks for.
    fn tuning(&mut self, command: &Command<'_>) -> Result<Option<Tuning>, CommandError> {
        Ok(match *command {
            Command::Autotune { of, target, cycles, uses } => {
                Some(Tuning { heater: self.tuned_heater(of)?, target, cycles, uses })
            }
            Command::HeaterModel { words, .. } => {
                let heater = self.heater_model(words)?;
                heater.map(|heater| Tuning { heater, target: None, cycles: None, uses: true })
            }
            _ => None,
        })
    }

    /// The output that a command switches, and its power, 0 to 255; `None` on a machine without it.
    fn switched_output(&self, command: &Command<'_>) -> Result<Option<(FanOutput, u8)>, CommandError> {
        Ok(match *command {
            Command::Fan { number: 0, power } if !self.fitted.equipment.fan && power > 0 => {
                self.needs(false, "fan")?;
                None
            }
            Command::Fan { number: 0, power }
                if <P::Motion as Motion>::Tools::PRESENT && self.part_fan() != FanOutput::Part =>
            {
                Some((self.part_fan(), power))
            }
            Command::Fan { number, power } => self.numbered_fan(number).map(|output| (output, power)),
            Command::NamedFan { name, power } => self.named_fan(name).map(|output| (output, power)),
            Command::SetOutput { number, power } => self.numbered_output(number)?.map(|output| (output, power)),
            _ => None,
        })
    }

    /// The pause that a command asks for.
    fn asked_pause<'c>(&self, command: &Command<'c>) -> Result<Option<(PauseReason, PauseWords<'c>)>, CommandError> {
        Ok(match *command {
            Command::Stop { longest_ms, text } => {
                Some((PauseReason::Stop, PauseWords { longest_ms, text, ..PauseWords::default() }))
            }
            Command::Pause(park) => Some((PauseReason::Pause, PauseWords { park, ..PauseWords::default() })),
            Command::ChangeFilament { tool, park, unload, load } => {
                self.needs_selected(tool)?;
                Some((PauseReason::FilamentChange, PauseWords { park, unload, load, longest_ms: None, text: "" }))
            }
            _ => None,
        })
    }

    /// Executes a command that never waits; `None` for the others. It is separate, because in a
    /// future the compiler would keep every value in memory.
    #[inline(never)]
    fn at_once(&mut self, command: &Command<'_>) -> Result<Option<Answer>, CommandError> {
        match *command {
            Command::SetUnits(units) => self.interpreter.modal.units = units,
            Command::AbsolutePositioning => self.interpreter.modal.set_relative(false),
            Command::RelativePositioning => self.interpreter.modal.set_relative(true),
            Command::SetPosition(ref words) => self.set_position(words)?,
            Command::EnableMotors(axes) => self.motion.set_motors_enabled(mask(axes), true),
            Command::IdleTimeout { seconds } => self.signals.set_idle_timeout_s(seconds),
            Command::HeaterTimeout(Some(seconds)) => self.signals.set_heater_timeout_s(seconds),
            Command::HeaterTimeout(None) => self.replies.send(Reply::HeaterTimeout(self.signals.heater_timeout_s())),
            Command::AbsoluteExtrusion => self.interpreter.modal.set_relative_extruder(false),
            Command::RelativeExtrusion => self.interpreter.modal.set_relative_extruder(true),
            Command::SetNozzle(tool, _) | Command::WaitNozzle(tool, _) | Command::NozzleGains(tool, _)
                if self.is_for_no_tool(tool) => {}
            Command::FlowPercent(tool, _) | Command::PressureAdvance(tool, _) if self.is_for_no_tool(tool) => {}
            Command::StepsPerMm(tool, _) if self.is_for_no_tool(tool) => {}
            Command::SetNozzle(tool, Some(celsius)) => {
                let nozzle = self.nozzle_of(tool)?;
                self.set_temperature(nozzle, celsius.to_f64())?;
            }
            Command::SetBed(Some(celsius)) => self.set_temperature(Heater::Bed, celsius.to_f64())?,
            Command::SetChamber(Some(celsius)) => self.set_chamber(celsius)?,
            Command::NozzleGains(tool, ref words) => {
                let nozzle = self.nozzle_of(tool)?;
                self.heater_gains(nozzle, words)?;
            }
            Command::BedGains(ref words) => self.heater_gains(Heater::Bed, words)?,
            Command::ChamberGains(ref words) if self.has_chamber() => self.heater_gains(Heater::Chamber, words)?,
            Command::ChamberGains(_) => {}
            Command::HeatersOff => {
                self.nozzles_off()?;
                self.set_temperature(Heater::Bed, 0.0)?;
                self.set_chamber(Decimal::ZERO)?;
            }
            Command::ReportTemperatures => {
                self.needs(self.fitted.equipment.heaters, "thermometers")?;
                self.replies.send(Reply::OkTemperatures(temperatures(&self.heating)));
                return Ok(Some(Answer::Given));
            }
            Command::AutoReportTemperatures { seconds } => self.signals.set_report_interval_s(seconds),
            Command::EndWait => self.signals.end_wait(),
            Command::Display(text) => self.display(text),
            Command::Progress { percent, minutes_left } => self.progress(percent, minutes_left),
            Command::Layer { current, total } => self.layer(current, total),
            Command::FilamentSensor(words) => self.filament_sensor(words)?,
            Command::PromptAnswer(0 | 1) if self.print.power_loss.is_offered() && !self.is_paused() => {
                return Ok(None);
            }
            // With the emergency parser, the answer acted as its bytes arrived: a button pressed
            // once must count once.
            Command::PromptAnswer(button) if !self.identity.emergency_parser => self.signals.answer_prompt(button),
            Command::PromptAnswer(_) => {}
            // The parser's remark suffices.
            Command::ResumePrint if !self.is_paused() => {}
            // A host begins a job with M110.
            Command::SetLineNumber(Some(_)) => {
                self.lines.said = Remarks::NONE;
                self.end_begun_tower();
                self.forget_rested_heaters();
            }
            Command::SetLineNumber(None) => self.replies.send(Reply::LastLine(self.lines.last)),
            Command::KeepAlive(Some(seconds)) => self.signals.set_keep_alive_s(seconds),
            Command::KeepAlive(None) => self.replies.send(Reply::KeepAlive(self.signals.keep_alive_s())),
            Command::ReportPosition => self.replies.send(Reply::Position(self.position())),
            Command::ReportFirmware => self.report_firmware(),
            Command::ReportEndStops => {
                self.needs(self.fitted.equipment.end_stops, "end stops")?;
                self.report_end_stops();
            }
            Command::ReportMotion => self.replies.send(Reply::Motion(self.motion.figures())),
            Command::AdaptiveExtrusion { on, layer_height, line_width, filament_diameter } => {
                self.adaptive_extrusion(on, [layer_height, line_width, filament_diameter])?;
            }
            Command::Timing { on, clear } => self.timing(on, clear),
            Command::BlackBox { clear } => self.send_black_box(clear)?,
            Command::ReceiveJob { size, silence_s } => self.request_job(size, silence_s)?,
            Command::Echo { echo_prefix, action_prefix, text } => self.echo(echo_prefix, action_prefix, text),
            Command::MaxAcceleration(ref words) => self.set_max_acceleration(words)?,
            Command::ToolOffset { .. } if !(<P::Motion as Motion>::Tools::PRESENT && self.profile.has_tools()) => {}
            Command::MaxFeed(ref words) => self.set_max_feed(words)?,
            Command::Acceleration { print, retract, travel, both } => {
                self.set_acceleration(print, retract, travel, both)?;
            }
            Command::VelocityLimit { velocity, acceleration, corner, .. } => {
                self.set_velocity_limit(velocity, acceleration, corner)?;
            }
            Command::Junction { deviation, corner_velocity } => self.set_corners(deviation, &corner_velocity)?,
            Command::RetractSettings(ref words) => self.set_retraction(words, false)?,
            Command::RecoverSettings(ref words) => self.set_retraction(words, true)?,
            Command::ProbeOffset(ref words) => self.probe_offset(words)?,
            Command::Accelerometer { rate_hz, resolution_bits } => {
                self.accelerometer_settings(rate_hz, resolution_bits)?;
            }
            Command::RecordAcceleration { .. } => {
                self.needed_accelerometer()?;
                return Ok(None);
            }
            Command::SoftLimits(enabled) => self.soft_limits(enabled),
            Command::FeedPercent(words) => self.feed_percent(words)?,
            Command::HomeOffset(ref words) => self.home_offset(words)?,
            Command::Backlash(_) if !self.has_backlash() => {}
            Command::PrintClock(PrintClockCommand::Stop | PrintClockCommand::Clear) => return Ok(None),
            Command::PrintClock(command) => self.print_clock(command),
            Command::FlowPercent(tool, value) => self.flow_percent(tool, value)?,
            // ANCHOR: m302
            Command::ColdExtrusion { minimum, allow } => self.cold_extrusion(minimum, allow)?,
            // ANCHOR_END: m302
            Command::CheckNozzle(diameter) => self.check_nozzle(diameter)?,
            Command::CheckModel(model) => self.check_model(model)?,
            Command::SelectTool { tool: Some(_), .. }
                if <P::Motion as Motion>::Tools::PRESENT && self.profile.has_tools() =>
            {
                return Ok(None);
            }
            Command::SelectTool { tool: None, .. } => self.report_tool(),
            Command::SelectTool { tool: Some(0), .. } => {}
            Command::SelectTool { tool: Some(tool), .. } => return Err(CommandError::InvalidTool(tool)),
            Command::Unknown(text) => self.replies.unknown(self.lines.number, text),
            Command::HeaterModel { text, .. } if !<P::Heating as Heating>::Models::PRESENT => {
                self.replies.unknown(self.lines.number, text);
            }
            Command::SetLight { .. } if !self.has_light() => {}
            Command::ReportFans => self.report_fans(),
            Command::FilamentLengths { unload, load } => self.filament_lengths(unload, load)?,
            Command::Settings(command) if self.refuse_settings(command) => {}
            Command::Bed(_) if !self.has_bed() => {}
            Command::Supply(SupplyCommand::Off { .. }) if !self.has_supply() => return Ok(None),
            Command::Supply(_) if !self.has_supply() => {}
            Command::ProbePin(_) if self.pin().is_none() => {}
            // The first three are handled by the drivers' part alone. Without a display the others
            // have no effect here.
            Command::ReportDrivers
            | Command::StealthChop { .. }
            | Command::Driver(..)
            | Command::SetNozzle(_, None)
            | Command::SetBed(None)
            | Command::SetChamber(None)
            | Command::Accepted => {}
            // Commands that wait or need much stack: `dispatch` executes them.
            Command::Linear { .. }
            | Command::Arc { .. }
            | Command::Dwell { .. }
            | Command::Retract
            | Command::Recover
            | Command::Home { .. }
            | Command::DisableMotors(_)
            | Command::WaitNozzle(..)
            | Command::WaitBed(_)
            | Command::WaitChamber(_)
            | Command::Autotune { .. }
            | Command::HeaterModel { .. }
            | Command::Fan { .. }
            | Command::NamedFan { .. }
            | Command::SetOutput { .. }
            | Command::SetLight { .. }
            | Command::Stop { .. }
            | Command::Pause(_)
            | Command::ChangeFilament { .. }
            | Command::LoadFilament { .. }
            | Command::ResumePrint
            | Command::MotionChoice { .. }
            | Command::InputShaper { .. }
            | Command::PressureAdvance(..)
            | Command::ShiftZ { .. }
            | Command::OffsetZ { .. }
            | Command::Bed(_)
            | Command::Card(_)
            | Command::Supply(_)
            | Command::ProbePin(_)
            | Command::Tower(_)
            | Command::Settings(_)
            | Command::ReportSetting(_)
            | Command::StepsPerMm(..)
            | Command::QuickStop
            | Command::EmergencyStop
            | Command::Restart
            | Command::ToolOffset { .. }
            | Command::Skew(_)
            | Command::Backlash(_)
            | Command::Finish => return Ok(None),
        }
        Ok(Some(Answer::Ok))
    }
}
