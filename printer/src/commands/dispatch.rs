//! Dispatches commands to their handlers.

use ferrostep_gcode::{
    AdvanceWords, ArcForm, AxisFlags, AxisWords, BacklashWords, BedCommand, CardCommand, Command, Decimal, PinCommand,
    PrintClockCommand, Remarks, Reply, SettingsCommand, ShaperWords, SkewCommand, SupplyCommand, TowerWords,
    WaitTarget,
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

/// A command that may wait; the type makes sure that it is executed.
enum Waiting<'a> {
    Linear {
        rapid: bool,
        axes: &'a AxisWords,
        feed: Option<Decimal>,
    },
    Arc {
        clockwise: bool,
        axes: &'a AxisWords,
        form: &'a ArcForm,
        feed: Option<Decimal>,
    },
    Dwell {
        milliseconds: u64,
    },
    Retraction {
        retract: bool,
    },
    Home(AxisFlags),
    /// M81 without a supply that can be switched.
    EverythingOff,
    DisableMotors {
        mask: u8,
    },
    Heat(Heater, WaitTarget),
    Fan {
        output: FanOutput,
        power: u8,
    },
    Autotune {
        heater: Heater,
        target: Option<Decimal>,
        cycles: Option<u8>,
        uses: bool,
    },
    Light([u8; 4]),
    Tower(Option<&'a TowerWords<'a>>),
    Stop(Stop),
    /// M92 without words.
    ReportSteps,
    /// M201 to M208 without words.
    ReportSetting(&'static str),
    ShowSettings(SettingsCommand),
    Pause(PauseReason, PauseWords<'a>),
    LoadFilament {
        loads: bool,
        length: Option<Decimal>,
        rise: Option<Decimal>,
    },
    ResumePrint,
    MotionChoice {
        interpolation: Option<u8>,
        acceleration: Option<u8>,
    },
    InputShaper {
        axes: &'a [ShaperWords<'a>; 2],
        usual: &'static str,
    },
    PressureAdvance(Option<u8>, &'a AdvanceWords),
    ShiftZ {
        words: &'a AxisWords,
        keeps_offset: bool,
    },
    OffsetZ {
        offset: Decimal,
        adds: bool,
        moves: bool,
    },
    Bed(&'a BedCommand),
    Card(&'a CardCommand<'a>),
    Supply(SupplyCommand),
    ProbePin(PinCommand),
    Tool {
        number: u32,
        stays: bool,
    },
    /// Waits until motion has ended.
    Finish(Then<'a>),
}

/// Action at a standstill.
enum Then<'a> {
    Nothing,
    /// M500 to M502.
    Settings(SettingsCommand),
    /// M92.
    StepsPerMm(Option<u8>, &'a AxisWords),
    /// M218.
    ToolOffset(Option<u8>, &'a AxisWords),
    /// M77, M78 S78.
    PrintClock(PrintClockCommand),
    /// M852.
    Skew(&'a SkewCommand),
    /// M425.
    Backlash(&'a BacklashWords),
    /// M956.
    Record {
        samples: u16,
        at_next_move: bool,
    },
}

/// A command that stops motion at once.
enum Stop {
    /// M410.
    Quick,
    /// M112.
    Emergency,
    /// M999: what M112 has stopped.
    Restart,
}

/// Result of a first look at a command.
enum Dispatched<'a> {
    Done(Answer),
    Waiting(Waiting<'a>),
}

/// Mask of the motors of the axes that a command names; all where it names none.
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
        let waiting = match self.dispatch_at_once(command)? {
            Dispatched::Done(answer) => return Ok(answer),
            Dispatched::Waiting(waiting) => waiting,
        };
        match waiting {
            Waiting::Linear { rapid, axes, feed } => self.linear(rapid, axes, feed).await?,
            Waiting::Arc { clockwise, axes, form, feed } => self.arc(clockwise, axes, *form, feed).await?,
            Waiting::Dwell { milliseconds } => self.dwell(milliseconds).await?,
            Waiting::Retraction { retract } => self.firmware_retract(retract).await?,
            Waiting::Home(axes) => self.home(axes).await?,
            Waiting::EverythingOff => self.everything_off(false).await?,
            Waiting::DisableMotors { mask } => {
                self.disable_motors(mask).await?;
                self.keep_statistics();
            }
            Waiting::Heat(heater, target) => self.wait_for_heat(heater, target).await?,
            Waiting::Autotune { heater, target, cycles, uses } => self.autotune(heater, target, cycles, uses).await?,
            Waiting::Fan { output, power } => self.motion.set_fan_power(output, power).await?,
            Waiting::Light(colors) => self.set_light(colors).await?,
            Waiting::Tower(words) => self.set_tower(words)?,
            Waiting::ShowSettings(command) => self.show_settings(command),
            Waiting::ReportSteps => self.report_steps_per_mm(),
            Waiting::ReportSetting(code) => self.report_setting(code),
            Waiting::Stop(Stop::Quick) => {
                let stops = self.motion.stops();
                self.stop_motion();
                if self.lines.source == Source::Card {
                    self.print.card.note_own_stops(self.motion.stops().wrapping_sub(stops));
                }
            }
            Waiting::Stop(Stop::Emergency) => return self.emergency_stop(),
            Waiting::Stop(Stop::Restart) => self.restart()?,
            Waiting::Pause(reason, words) => self.pause_command(reason, &words).await?,
            Waiting::LoadFilament { loads, length, rise } => self.load_filament(loads, length, rise).await?,
            Waiting::ResumePrint => self.start_print(None).await?,
            Waiting::MotionChoice { interpolation, acceleration } => {
                self.choose_motion(interpolation, acceleration).await?;
            }
            Waiting::InputShaper { axes, usual } => self.shape(axes, usual).await?,
            Waiting::PressureAdvance(tool, words) => self.advance(tool, words).await?,
            Waiting::ShiftZ { words, keeps_offset } => self.shift_z(words, keeps_offset).await?,
            Waiting::OffsetZ { offset, adds, moves } => self.offset_z(offset, adds, moves).await?,
            Waiting::Bed(command) => {
                if P::Motion::HAS_BED {
                    let printer = &mut *self;
                    <P::Motion as Motion>::Bed::only(move || printer.bed(command)).await?;
                }
            }
            Waiting::Card(command) => self.card_command(*command).await?,
            Waiting::Supply(command) => {
                if <P::Heating as Heating>::Supply::PRESENT {
                    let printer = &mut *self;
                    <P::Heating as Heating>::Supply::only(move || printer.supply(command)).await?;
                }
            }
            Waiting::ProbePin(command) => {
                if <P::Motion as Motion>::Servo::PRESENT {
                    let printer = &mut *self;
                    <P::Motion as Motion>::Servo::only(move || printer.probe_pin(command)).await?;
                }
            }
            Waiting::Tool { number, stays } => {
                if <P::Motion as Motion>::Tools::PRESENT {
                    let printer = &mut *self;
                    <P::Motion as Motion>::Tools::only(move || printer.change_tool(number, stays)).await?;
                }
            }
            // One wait for all, which takes less room than several.
            Waiting::Finish(then) => {
                self.motion.finish().await?;
                match then {
                    Then::Nothing => {}
                    Then::Settings(command) => self.change_settings(command),
                    Then::StepsPerMm(tool, words) => self.set_steps_per_mm(tool, words)?,
                    Then::ToolOffset(tool, words) => self.tool_offset(tool, words)?,
                    Then::PrintClock(command) => {
                        self.print_clock(command);
                        self.keep_statistics();
                    }
                    Then::Skew(command) => self.skew(command)?,
                    Then::Backlash(words) => self.backlash(words)?,
                    Then::Record { samples, at_next_move } => {
                        self.needed_accelerometer()?.record(samples, at_next_move)?;
                    }
                }
            }
        }
        Ok(Answer::Ok)
    }

    /// Executes a command that never waits, and names the others: one line for each. A separate
    /// function, because in a future the compiler keeps every value in memory.
    #[inline(never)]
    fn dispatch_at_once<'c>(&mut self, command: &'c Command<'_>) -> Result<Dispatched<'c>, CommandError> {
        let waiting = |waiting| Ok(Dispatched::Waiting(waiting));
        let pause = |reason, words| waiting(Waiting::Pause(reason, words));
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
                return Ok(Dispatched::Done(Answer::Given));
            }
            Command::AutoReportTemperatures { seconds } => self.signals.set_report_interval_s(seconds),
            Command::EndWait => self.signals.end_wait(),
            Command::Display(text) => self.display(text),
            Command::Progress { percent, minutes_left } => self.progress(percent, minutes_left),
            Command::Layer { current, total } => self.layer(current, total),
            Command::FilamentSensor(words) => self.filament_sensor(words)?,
            Command::PromptAnswer(button @ (0 | 1)) if self.print.power_loss.is_offered() && !self.is_paused() => {
                return waiting(Waiting::Card(if button == 0 { &RESUME } else { &FORGET }));
            }
            // Else it was acted on as its bytes arrived; pressed once, a button counts once.
            Command::PromptAnswer(button) if !self.identity.emergency_parser => self.signals.answer_prompt(button),
            Command::PromptAnswer(_) => {}
            Command::ResumePrint if self.is_paused() => return waiting(Waiting::ResumePrint),
            // It has its remark.
            Command::ResumePrint => {}
            // A host begins a job with it.
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
            Command::ReportSetting(code) => return waiting(Waiting::ReportSetting(code)),
            Command::MaxAcceleration(ref words) => self.set_max_acceleration(words)?,
            Command::StepsPerMm(_, ref words) if *words == AxisWords::default() => {
                return waiting(Waiting::ReportSteps);
            }
            Command::StepsPerMm(tool, ref words) => return waiting(Waiting::Finish(Then::StepsPerMm(tool, words))),
            Command::ToolOffset { tool, ref offset }
                if <P::Motion as Motion>::Tools::PRESENT && self.profile.has_tools() =>
            {
                return waiting(Waiting::Finish(Then::ToolOffset(tool, offset)));
            }
            Command::ToolOffset { .. } => {}
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
            Command::RecordAcceleration { samples, at_next_move } => {
                self.needed_accelerometer()?;
                return waiting(Waiting::Finish(Then::Record { samples, at_next_move }));
            }
            // Not here, where they would need more of the stack than all other commands: a tower
            // reads lines, M503 writes many, and who stops motion plans it to its end.
            Command::Tower(ref words) => return waiting(Waiting::Tower(words.as_ref())),
            Command::SoftLimits(enabled) => self.soft_limits(enabled),
            Command::FeedPercent(words) => self.feed_percent(words)?,
            Command::HomeOffset(ref words) => self.home_offset(words)?,
            Command::Skew(ref command) => return waiting(Waiting::Finish(Then::Skew(command))),
            Command::Backlash(ref words) if self.has_backlash() => {
                return waiting(Waiting::Finish(Then::Backlash(words)));
            }
            Command::Backlash(_) => {}
            Command::PrintClock(command @ (PrintClockCommand::Stop | PrintClockCommand::Clear)) => {
                return waiting(Waiting::Finish(Then::PrintClock(command)));
            }
            Command::PrintClock(command) => self.print_clock(command),
            Command::FlowPercent(tool, value) => self.flow_percent(tool, value)?,
            // ANCHOR: m302
            Command::ColdExtrusion { minimum, allow } => self.cold_extrusion(minimum, allow)?,
            // ANCHOR_END: m302
            Command::QuickStop => return waiting(Waiting::Stop(Stop::Quick)),
            Command::EmergencyStop => return waiting(Waiting::Stop(Stop::Emergency)),
            Command::Restart => return waiting(Waiting::Stop(Stop::Restart)),
            Command::CheckNozzle(diameter) => self.check_nozzle(diameter)?,
            Command::CheckModel(model) => self.check_model(model)?,
            Command::SelectTool { tool: Some(number), stays }
                if <P::Motion as Motion>::Tools::PRESENT && self.profile.has_tools() =>
            {
                return waiting(Waiting::Tool { number, stays });
            }
            Command::SelectTool { tool: None, .. } => self.report_tool(),
            Command::SelectTool { tool: Some(0), .. } => {}
            Command::SelectTool { tool: Some(tool), .. } => return Err(CommandError::InvalidTool(tool)),
            Command::Unknown(text) => self.replies.unknown(self.lines.number, text),
            Command::Linear { rapid, ref axes, feed } => return waiting(Waiting::Linear { rapid, axes, feed }),
            Command::Arc { clockwise, ref axes, ref form, feed } => {
                return waiting(Waiting::Arc { clockwise, axes, form, feed });
            }
            Command::Dwell { milliseconds } => return waiting(Waiting::Dwell { milliseconds }),
            Command::Retract => return waiting(Waiting::Retraction { retract: true }),
            Command::Recover => return waiting(Waiting::Retraction { retract: false }),
            Command::Home { axes, unless_homed: false } => return waiting(Waiting::Home(axes)),
            Command::Home { axes, unless_homed: true } => {
                if let Some(axes) = self.unhomed(axes) {
                    return waiting(Waiting::Home(axes));
                }
            }
            Command::DisableMotors(axes) => return waiting(Waiting::DisableMotors { mask: mask(axes) }),
            Command::WaitNozzle(tool, target) => return waiting(Waiting::Heat(self.nozzle_of(tool)?, target)),
            Command::WaitBed(target) => return waiting(Waiting::Heat(Heater::Bed, target)),
            Command::WaitChamber(target) if self.has_chamber() => {
                return waiting(Waiting::Heat(Heater::Chamber, target));
            }
            Command::Autotune { of, target, cycles, uses } => {
                let heater = self.tuned_heater(of)?;
                return waiting(Waiting::Autotune { heater, target, cycles, uses });
            }
            Command::HeaterModel { text, .. } if !<P::Heating as Heating>::Models::PRESENT => {
                self.replies.unknown(self.lines.number, text);
            }
            Command::HeaterModel { words, .. } => {
                if let Some(heater) = self.heater_model(words)? {
                    return waiting(Waiting::Autotune { heater, target: None, cycles: None, uses: true });
                }
            }
            Command::Fan { number: 0, power } if !self.fitted.equipment.fan && power > 0 => self.needs(false, "fan")?,
            Command::Fan { number: 0, power }
                if <P::Motion as Motion>::Tools::PRESENT && self.part_fan() != FanOutput::Part =>
            {
                let output = self.part_fan();
                self.print.power_loss.set_fan(output, power);
                return waiting(Waiting::Fan { output, power });
            }
            Command::Fan { number, power } => {
                if let Some(output) = self.numbered_fan(number) {
                    self.print.power_loss.set_fan(output, power);
                    return waiting(Waiting::Fan { output, power });
                }
            }
            Command::NamedFan { name, power } => {
                if let Some(output) = self.named_fan(name) {
                    self.print.power_loss.set_fan(output, power);
                    return waiting(Waiting::Fan { output, power });
                }
            }
            Command::SetOutput { number, power } => {
                if let Some(output) = self.numbered_output(number)? {
                    self.print.power_loss.set_fan(output, power);
                    return waiting(Waiting::Fan { output, power });
                }
            }
            Command::SetLight { .. } if !self.has_light() => {}
            Command::SetLight { colors } => return waiting(Waiting::Light(colors)),
            Command::ReportFans => self.report_fans(),
            Command::Stop { longest_ms, text } => {
                return pause(PauseReason::Stop, PauseWords { longest_ms, text, ..PauseWords::default() });
            }
            Command::Pause(park) => return pause(PauseReason::Pause, PauseWords { park, ..PauseWords::default() }),
            Command::ChangeFilament { tool, park, unload, load } => {
                self.needs_selected(tool)?;
                return pause(
                    PauseReason::FilamentChange,
                    PauseWords { park, unload, load, longest_ms: None, text: "" },
                );
            }
            Command::FilamentLengths { unload, load } => self.filament_lengths(unload, load)?,
            Command::LoadFilament { loads, tool, length, rise } => {
                self.needs_selected(tool)?;
                return waiting(Waiting::LoadFilament { loads, length, rise });
            }
            Command::MotionChoice { interpolation, acceleration } => {
                return waiting(Waiting::MotionChoice { interpolation, acceleration });
            }
            Command::InputShaper { ref axes, usual } => return waiting(Waiting::InputShaper { axes, usual }),
            Command::PressureAdvance(tool, ref words) => return waiting(Waiting::PressureAdvance(tool, words)),
            Command::ShiftZ { ref words, keeps_offset } => return waiting(Waiting::ShiftZ { words, keeps_offset }),
            Command::OffsetZ { offset, adds, moves } => return waiting(Waiting::OffsetZ { offset, adds, moves }),
            Command::Settings(command) if self.refuse_settings(command) => {}
            Command::Settings(command) if Self::needs_standstill(command) => {
                return waiting(Waiting::Finish(Then::Settings(command)));
            }
            Command::Settings(command) => return waiting(Waiting::ShowSettings(command)),
            Command::Bed(ref command) if self.has_bed() => return waiting(Waiting::Bed(command)),
            Command::Card(ref command) => return waiting(Waiting::Card(command)),
            Command::Supply(SupplyCommand::Off { .. }) if !self.has_supply() => return waiting(Waiting::EverythingOff),
            Command::Supply(_) if !self.has_supply() => {}
            Command::Supply(command) => return waiting(Waiting::Supply(command)),
            Command::ProbePin(_) if self.pin().is_none() => {}
            Command::ProbePin(command) => return waiting(Waiting::ProbePin(command)),
            Command::Finish => return waiting(Waiting::Finish(Then::Nothing)),
            // The first three are only the drivers' part. Without a display the others
            // have no effect here.
            Command::ReportDrivers
            | Command::StealthChop { .. }
            | Command::Driver(..)
            | Command::Bed(_)
            | Command::SetNozzle(_, None)
            | Command::SetBed(None)
            | Command::SetChamber(None)
            | Command::WaitChamber(_)
            | Command::Accepted => {}
        }
        Ok(Dispatched::Done(Answer::Ok))
    }
}
