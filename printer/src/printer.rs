//! The printer: a line in, its effects and its replies out.

use core::future::{Future, poll_fn};
use core::pin::pin;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{
    AxisFlags, Command, EndStopState, FirmwareInfo, Position, Remarks, Reply, ShortText, parse_with_remarks,
};
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_planner::{AccelerationProfile, Interpolation};

use crate::error::{CommandError, Failure};
use crate::modal::{Modal, Tally};
use crate::moves::NewestRetraction;
use crate::ports::{Equipment, Heating, Motion, MotorDrivers, Ports, Replies, Signals, Timing};
use crate::prepared::BlockExtruder;
use crate::profile::{HomeEnd, HomeSensor, Profile};
use crate::transfer::JobRequest;
use crate::waits::temperatures;

/// A line of text that is put together here.
pub(crate) type Text = heapless::String<384>;

/// Masks of all motors, and of those that a command names.
const ALL_MOTORS: u8 = 0b1111;

/// How a command that has been executed is answered.
// `repr(u32)`: with a one-byte tag the compiler copies the `Result` byte by byte.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// `ok` is to follow.
    Ok,
    /// It has been said, and more with it.
    Given,
}

fn mask(axes: AxisFlags) -> u8 {
    if axes.is_empty() {
        return ALL_MOTORS;
    }
    u8::from(axes.x) | u8::from(axes.y) << 1 | u8::from(axes.z) << 2 | u8::from(axes.e) << 3
}

/// Executes commands.
pub struct Printer<'a, P: Ports> {
    pub(crate) profile: &'a Profile,
    pub(crate) motion: P::Motion,
    pub(crate) heating: P::Heating,
    pub(crate) clock: P::Clock,
    pub(crate) replies: &'a P::Replies,
    pub(crate) signals: &'a Signals,
    pub(crate) modal: Modal,
    pub(crate) tally: Tally,
    /// Since the first block of a prepared job, or since G92.
    pub(crate) block_extruder: Option<BlockExtruder>,
    /// Number of the line being executed.
    pub(crate) line: u32,
    last_line: i64,
    /// What has been said of this job's lines.
    said: Remarks,
    pub(crate) newest_retraction: Option<NewestRetraction>,
    version: &'a str,
    emergency_parser: bool,
    timing: Option<&'a dyn Timing>,
    pub(crate) drivers: Option<&'a dyn MotorDrivers>,
    pub(crate) equipment: Equipment,
    pub(crate) receives_jobs: bool,
    pub(crate) job_request: Option<JobRequest>,
}

impl<'a, M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Printer<'a, (M, H, T, R)> {
    /// A printer that has just been switched on: nothing homed, everything cold.
    pub fn new(profile: &'a Profile, motion: M, heating: H, clock: T, replies: &'a R, signals: &'a Signals) -> Self {
        signals.set_heater_timeout_s(profile.heater_timeout_s);
        Self {
            profile,
            motion,
            heating,
            clock,
            replies,
            signals,
            modal: Modal::new(profile),
            tally: Tally::default(),
            block_extruder: None,
            line: 0,
            last_line: 0,
            said: Remarks::NONE,
            newest_retraction: None,
            version: env!("CARGO_PKG_VERSION"),
            emergency_parser: false,
            timing: None,
            drivers: None,
            equipment: Equipment::ALL,
            receives_jobs: false,
            job_request: None,
        }
    }
}

impl<'a, P: Ports> Printer<'a, P> {
    /// Version of the firmware as M115 reports it, `0.1.0 (commit abcdef0)`; without this it has no commit.
    pub fn set_version(&mut self, version: &'a str) {
        self.version = version;
    }

    /// Says that M112, M108 and M410 are acted on as their bytes arrive (M115 reports it).
    pub fn set_emergency_parser(&mut self, present: bool) {
        self.emergency_parser = present;
    }

    /// The board measures times of itself (M798).
    pub fn set_timing(&mut self, timing: &'a dyn Timing) {
        self.timing = Some(timing);
    }

    /// The motors' drivers can be set (M122, M569, M906, M914); nothing moves before all have confirmed that they are.
    pub fn set_drivers(&mut self, drivers: &'a dyn MotorDrivers) {
        self.drivers = Some(drivers);
    }

    /// The parts of the board that can be used; all without this.
    pub fn set_equipment(&mut self, equipment: Equipment) {
        self.equipment = equipment;
    }

    /// What has been done so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// X, Y, Z and E as the G-code sees them, units of 10 nm.
    pub fn logical_10nm(&self) -> [i64; 4] {
        self.modal.logical_10nm()
    }

    pub(crate) fn replies(&self) -> &'a P::Replies {
        self.replies
    }

    pub(crate) fn set_last_line(&mut self, number: i64) {
        self.last_line = number;
    }

    /// Waits until all motion has ended, as at the end of a job.
    pub async fn finish(&mut self) -> Result<(), CommandError> {
        self.block_extruder = None;
        Ok(self.motion.finish().await?)
    }

    /// Executes the text of a line and answers it with exactly one `ok`; a refused one is explained by an `echo:`
    /// before it.
    pub async fn execute(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        self.line = line;
        self.signals.note_host();
        // A command at work keeps the motors on. If the idle timeout switched them off before, it is noticed now.
        self.signals.set_at_work(true);
        if self.motion.take_switched_off() {
            self.modal.forget_home(ALL_MOTORS);
        }
        let outcome = self.answer(line, text).await;
        self.signals.set_at_work(false);
        outcome
    }

    async fn answer(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        let mut remarks = Remarks::NONE;
        let parsed = parse_with_remarks(text, &mut remarks);
        if !remarks.is_empty() && parsed.is_ok() {
            self.remark(line, text, &remarks);
        }
        let failure = match &parsed {
            Ok(command) => match self.command_with_signs_of_life(command).await {
                Ok(answer) => {
                    if answer == Answer::Ok {
                        self.replies.send(Reply::Ok);
                    }
                    return Ok(());
                }
                Err(error) => Failure::Command(error),
            },
            Err(error) => Failure::Parse(*error),
        };
        self.replies.refuse(line, &failure);
        self.replies.send(Reply::Ok);
        Err(failure)
    }

    /// Says what of a line is ignored or changed, each thing once a job.
    #[cold]
    fn remark(&mut self, line: u32, text: &str, remarks: &Remarks) {
        let new = self.said.merge(remarks);
        if new.is_empty() {
            return;
        }
        let mut reply = Text::new();
        let text = ShortText::new(text);
        // What does not fit is cut.
        let _ = core::fmt::write(&mut reply, format_args!("echo:line {line}: \"{text}\": {new} (said once a job)"));
        self.replies.send(Reply::Text(&reply));
    }

    /// Executes a command and, while it takes long, says `busy` as often as M113 asks: hosts take a printer that is
    /// silent for too long for dead. A wait for heat reports temperatures instead.
    pub(crate) async fn command_with_signs_of_life(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
        let (clock, replies, signals) = (self.clock.clone(), self.replies, self.signals);
        let mut execution = pin!(self.command(command));
        let mut last_sign_ms = None;
        poll_fn(|context| {
            let progress = execution.as_mut().poll(context);
            if progress.is_pending() {
                let now_ms = clock.now_ms();
                let since_ms = now_ms - *last_sign_ms.get_or_insert(now_ms);
                let interval_ms = u64::from(signals.keep_alive_s()) * 1000;
                if signals.is_waiting_for_heat() {
                    last_sign_ms = Some(now_ms);
                } else if interval_ms > 0 && since_ms >= interval_ms {
                    last_sign_ms = Some(now_ms);
                    replies.send(Reply::Busy);
                }
            }
            progress
        })
        .await
    }

    /// Executes a command.
    async fn command(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
        let was_stopped = self.motion.begin_command();
        if was_stopped {
            // M410 has acted as its bytes arrived; its line may never come to be executed.
            let dropped_100pm = self.motion.take_dropped_100pm();
            self.reckon_stop(dropped_100pm);
        }
        if self.signals.is_halted() && *command != Command::Restart {
            self.follow_the_motors();
            return Err(CommandError::Halted);
        }
        let result = match self.motion.take_fault() {
            Some(fault) => Err(CommandError::MotionFault(fault)),
            None => self.dispatch(command).await,
        };
        if let Err(error) = result {
            self.follow_after(error);
        }
        result
    }

    /// After a command that failed: where motion was stopped, the G-code's position is where the motors stand. A motor that
    /// stands elsewhere than its block ends makes no position certain.
    pub(crate) fn follow_after(&mut self, error: CommandError) {
        match error {
            CommandError::MotionFault(_) => {
                self.forget_home(ALL_MOTORS);
                self.follow_the_motors();
            }
            CommandError::Stopped | CommandError::Halted | CommandError::NeedsReset(_) => self.follow_the_motors(),
            _ => {}
        }
    }

    /// After a stop the G-code's position is where the motors stand. A halt also takes their current away, and with it
    /// what homing knew.
    pub(crate) fn follow_the_motors(&mut self) {
        if self.signals.is_halted() {
            self.motion.set_motors_enabled(ALL_MOTORS, false);
            self.modal.forget_home(ALL_MOTORS);
        }
        self.modal.lift_10nm = 0;
        let [x, y, z] = self.motion.position_10nm();
        self.modal.machine_10nm = [x, y, self.modal.machine_z_10nm(z)];
    }

    /// Motion stops at once; position, extruder and filament are what has really happened.
    pub(crate) fn stop_motion(&mut self) {
        let dropped_100pm = self.motion.stop();
        self.reckon_stop(dropped_100pm);
    }

    /// Motion was stopped, with so much filament unpushed.
    fn reckon_stop(&mut self, dropped_100pm: i64) {
        self.tally.filament_100pm -= dropped_100pm;
        // What moves extrude by their length is no part of the G-code's position, nor is a firmware retraction.
        if !self.modal.extrusion.settings().adaptive {
            let counted_100pm = dropped_100pm - self.retraction_dropped_100pm(dropped_100pm);
            self.modal.extruder_10nm -= counted_100pm / i64::from(self.modal.flow_percent.max(1));
        }
        self.newest_retraction = None;
        self.follow_the_motors();
    }

    /// M999. The halt has stopped the motors, but the filament that they left unpushed has not been
    /// subtracted. A heater fault that is still there halts the machine again at once.
    fn restart(&mut self) -> Result<(), CommandError> {
        if !self.signals.is_halted() {
            return Ok(());
        }
        self.stop_motion();
        // First the flag, then the heaters: a fault in between would be told by the heaters themselves.
        self.signals.restart();
        if let Err(fault) = self.heating.restart() {
            self.signals.halt();
            let mut line = Text::new();
            // Shorter than the longest line.
            let _ = core::fmt::write(&mut line, format_args!("{fault}"));
            self.replies.send(Reply::Text(&line));
            self.replies.send(Reply::Killed);
            return Err(if fault.trip.needs_reset() { CommandError::NeedsReset(fault) } else { CommandError::Halted });
        }
        Ok(())
    }

    async fn dispatch(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
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
            Command::SetUnits(units) => self.modal.units = units,
            Command::Home(axes) => self.home(axes).await?,
            Command::AbsolutePositioning => self.set_relative(false),
            Command::RelativePositioning => self.set_relative(true),
            Command::SetPosition(ref words) => self.set_position(words)?,
            Command::EnableMotors(axes) => self.motion.set_motors_enabled(mask(axes), true),
            Command::DisableMotors(axes) => self.disable_motors(axes).await?,
            Command::IdleTimeout { seconds } => self.signals.set_idle_timeout_s(seconds),
            Command::HeaterTimeout(Some(seconds)) => self.signals.set_heater_timeout_s(seconds),
            Command::HeaterTimeout(None) => self.replies.send(Reply::HeaterTimeout(self.signals.heater_timeout_s())),
            Command::AbsoluteExtrusion => self.modal.relative_extruder = false,
            Command::RelativeExtrusion => self.modal.relative_extruder = true,
            Command::SetNozzle(Some(celsius)) => self.set_temperature(Heater::Nozzle, celsius.to_f64())?,
            Command::SetBed(Some(celsius)) => self.set_temperature(Heater::Bed, celsius.to_f64())?,
            Command::WaitNozzle(target) => self.wait_for_heat(Heater::Nozzle, target).await?,
            Command::WaitBed(target) => self.wait_for_heat(Heater::Bed, target).await?,
            Command::ReportTemperatures => {
                self.needs(self.equipment.heaters, "thermometers")?;
                self.replies.send(Reply::OkTemperatures(temperatures(&self.heating)));
                return Ok(Answer::Given);
            }
            Command::AutoReportTemperatures { seconds } => self.signals.set_report_interval_s(seconds),
            Command::Fan { index: 0, power } => {
                self.needs(self.equipment.fan || power == 0, "fan")?;
                self.motion.set_fan_power(power).await?;
            }
            Command::EndWait => self.signals.end_wait(),
            // A host begins a job with it.
            Command::SetLineNumber(Some(_)) => self.said = Remarks::NONE,
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
            Command::MotionChoice { interpolation, acceleration } => {
                self.choose_motion(interpolation, acceleration).await?;
            }
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
            Command::Junction { deviation, corner_velocity } => self.set_corners(deviation, &corner_velocity)?,
            Command::RetractSettings(ref words) => self.set_retraction(words, false)?,
            Command::RecoverSettings(ref words) => self.set_retraction(words, true)?,
            Command::ProbeOffset(ref words) => self.probe_offset(words)?,
            Command::ShiftZ { ref words, keeps_offset } => self.shift_z(words, keeps_offset).await?,
            Command::SoftLimits(enabled) => self.soft_limits(enabled),
            Command::FeedPercent(value) => self.feed_percent(value)?,
            Command::FlowPercent(value) => self.flow_percent(value)?,
            // ANCHOR: m302
            Command::ColdExtrusion { minimum, allow } => self.cold_extrusion(minimum, allow)?,
            // ANCHOR_END: m302
            Command::Finish => self.motion.finish().await?,
            Command::QuickStop => self.stop_motion(),
            Command::Restart => self.restart()?,
            Command::SelectTool(0) => {}
            Command::SelectTool(tool) => return Err(CommandError::InvalidTool(tool)),
            Command::Unknown(text) => self.replies.send(Reply::UnknownCommand(text)),
            // The drivers' part is all that there is to the first four. Without a display or a second fan the others
            // change nothing here.
            Command::ReportDrivers
            | Command::StealthChop { .. }
            | Command::DriverCurrent(_)
            | Command::StallThreshold(_)
            | Command::Display(_)
            | Command::Fan { .. }
            | Command::SetNozzle(None)
            | Command::SetBed(None)
            | Command::Accepted => {}
        }
        Ok(Answer::Ok)
    }

    /// Refuses what the board has not.
    pub(crate) fn needs(&self, is_there: bool, what: &'static str) -> Result<(), CommandError> {
        if is_there { Ok(()) } else { Err(CommandError::NotEquipped(what)) }
    }

    /// G90, G91: as in Marlin they rule the extruder too, until M82 or M83 says otherwise.
    fn set_relative(&mut self, relative: bool) {
        self.modal.relative = relative;
        self.modal.relative_extruder = relative;
    }

    /// M18, M84: a motor without current may be turned by hand, so its axis is no longer homed.
    async fn disable_motors(&mut self, axes: AxisFlags) -> Result<(), CommandError> {
        self.motion.finish().await?;
        let motors = mask(axes);
        self.motion.set_motors_enabled(motors, false);
        self.forget_home(motors);
        Ok(())
    }

    /// The motors in the mask may not be where their steps say: no axis that they move is homed any more.
    pub(crate) fn forget_home(&mut self, motors: u8) {
        self.modal.forget_home(self.profile.kinematics.axes_of_motors(motors));
    }

    /// M112: heat first, then motion.
    fn emergency_stop(&mut self) -> Result<Answer, CommandError> {
        self.heating.all_off();
        self.stop_motion();
        self.signals.halt();
        self.replies.send(Reply::Killed);
        Err(CommandError::Halted)
    }

    pub(crate) fn position(&self) -> Position {
        let [x, y, z, _] = self.motion.motor_steps();
        Position {
            logical_10nm: self.modal.logical_10nm(),
            motor_steps: [x, y, z],
            motor_names: self.profile.kinematics.motor_names(),
        }
    }

    fn report_firmware(&self) {
        self.replies.send(Reply::Firmware(FirmwareInfo {
            version: self.version,
            machine: self.profile.name,
            kinematics: self.profile.kinematics.reported_name(),
            lower_end_10nm: self.profile.lower_end_10nm,
            size_10nm: self.profile.size_10nm,
            emergency_parser: self.emergency_parser,
            thermal_protection: self.equipment.heaters,
        }));
    }

    /// M796. The machine stands still before its motion changes.
    async fn choose_motion(&mut self, interpolation: Option<u8>, acceleration: Option<u8>) -> Result<(), CommandError> {
        let mut choice = self.motion.motion_choice();
        let number = |number: Option<u8>| number.map(usize::from);
        if let Some(chosen) = number(interpolation).and_then(|number| Interpolation::ALL.get(number)) {
            choice.interpolation = *chosen;
        }
        if let Some(chosen) = number(acceleration).and_then(|number| AccelerationProfile::ALL.get(number)) {
            choice.acceleration = *chosen;
        }
        if interpolation.is_some() || acceleration.is_some() {
            self.needs(choice.is_offered(), "code for this method, but for its profile's (M796)")?;
            self.motion.finish().await?;
            self.motion.set_motion_choice(&choice);
        } else {
            self.replies.send(Reply::MotionChoice {
                interpolation: choice.interpolation.name(),
                acceleration: choice.acceleration.name(),
            });
        }
        Ok(())
    }

    /// M798. Measuring begins anew when it is switched on, so that what is reported has all been measured alike.
    fn timing(&self, on: Option<bool>, clear: bool) {
        let Some(timing) = self.timing else {
            return self.replies.send(Reply::Text("echo:timing: this machine measures none"));
        };
        if on == Some(false) {
            timing.switch(false);
        }
        if clear || on == Some(true) {
            timing.clear();
        }
        if on == Some(true) {
            timing.switch(true);
        }
        if on.is_none() && !clear {
            timing.figures().into_iter().for_each(|figures| self.replies.send(Reply::Timing(figures)));
        }
    }

    fn report_end_stops(&self) {
        const NAMES: [[&str; 2]; 3] = [["x_min", "x_max"], ["y_min", "y_max"], ["z_min", "z_max"]];
        let mut states = [EndStopState { name: "", triggered: false }; 3];
        for (axis, state) in states.iter_mut().enumerate() {
            let homing = &self.profile.homing[axis];
            let name = match homing.sensor {
                HomeSensor::Probe => "z_probe",
                HomeSensor::EndStop | HomeSensor::Stall => NAMES[axis][usize::from(homing.end == HomeEnd::Max)],
            };
            *state = EndStopState { name, triggered: self.motion.is_end_stop_triggered(axis) };
        }
        self.replies.send(Reply::EndStops(&states));
    }

    fn echo(&self, echo_prefix: bool, action_prefix: bool, text: &str) {
        let mut reply = Text::new();
        let prefix = match (echo_prefix, action_prefix) {
            (true, _) => "echo:",
            (false, true) => "//",
            (false, false) => "",
        };
        if core::fmt::write(&mut reply, format_args!("{prefix}{text}")).is_ok() {
            self.replies.send(Reply::Text(&reply));
        }
    }
}
