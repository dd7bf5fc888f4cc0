//! The printer: a line in, its effects and its replies out.

use core::future::{Future, poll_fn};
use core::pin::pin;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{BedArea, Command, Remarks, Reply};
use ferrostep_hal_shim::{Clock, Heater};

use crate::accelerometer::Accelerometer;
use crate::black_box::BlackBox;
use crate::card::Card;
use crate::command_kind::{WhileHalted, while_halted};
use crate::error::{CommandError, Failure};
use crate::interpreter::MoveInterpreter;
use crate::modal::Tally;
use crate::part::Part;
use crate::paused::Paused;
use crate::ports::{Equipment, Heating, Motion, MotorDrivers, Ports, Replies, Timing};
use crate::power_loss::PowerLoss;
use crate::print_clock::PrintClock;
use crate::profile::Profile;
use crate::signals::Signals;
use crate::stored::KeepsSettings;
use crate::tool_box::ToolBox;
use crate::tower::Tower;
use crate::waits::Waits;

/// Masks of all motors.
const ALL_MOTORS: u8 = 0b1111;

/// The answer to an executed command.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// `ok` has still to be sent.
    Ok,
    /// `ok` has been sent, with more text.
    Given,
}

/// A host that wants to send a prepared job (M790).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobRequest {
    /// Length of the job, bytes.
    pub size: u32,
    /// Longest silence of the host, s.
    pub silence_s: u16,
}

/// The source of a line: it decides whether a person can be asked, and where a pause waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A host, which waits for the answer. The lines of a print have numbers; those that a person types have none.
    Host {
        /// The line has a number.
        is_numbered: bool,
    },
    /// A file that is read to its end: there is no person to ask.
    File,
    /// A card, while hosts are heard as well: its reader waits while [`Printer::is_paused`].
    Card,
}

/// Executes commands on the machine's parts, and answers each line.
///
/// The commands are in modules by their subject (`moves`, `temperatures`, `settings`, ...); only `dispatch` knows which command
/// is where.
pub struct Printer<'a, P: Ports> {
    pub(crate) profile: &'a Profile,
    pub(crate) motion: P::Motion,
    pub(crate) heating: P::Heating,
    pub(crate) clock: P::Clock,
    pub(crate) replies: &'a P::Replies,
    pub(crate) signals: &'a Signals,
    pub(crate) interpreter: MoveInterpreter<'a>,
    /// Number of the line being executed.
    pub(crate) line: u32,
    pub(crate) last_line: i64,
    /// Remarks made on this job's lines.
    pub(crate) said: Remarks,
    pub(crate) version: &'a str,
    pub(crate) identifier: Option<[u32; 3]>,
    pub(crate) emergency_parser: bool,
    pub(crate) meatpack: bool,
    pub(crate) timing: Option<&'a dyn Timing>,
    pub(crate) drivers: Option<&'a dyn MotorDrivers>,
    pub(crate) equipment: Equipment,
    pub(crate) settings_memory: Option<&'a dyn KeepsSettings<P>>,
    pub(crate) receives_jobs: bool,
    pub(crate) job_request: Option<JobRequest>,
    pub(crate) card: Card<'a>,
    /// Of the present line.
    pub(crate) source: Source,
    pub(crate) paused: Option<Paused>,
    /// Progress by M73: percent, and minutes left.
    pub(crate) progress: (Option<u8>, Option<u16>),
    /// Targets that commands have set, degrees Celsius. A heater that is off against them was switched off by its timeout.
    pub(crate) targets_celsius: [f32; Heater::COUNT],
    /// Whether the hosts know that their prints end because the machine is halted.
    pub(crate) told_halted: bool,
    /// A print pauses when its filament has run out (M412).
    pub(crate) pauses_at_runout: bool,
    /// A print is laying lines whose filament an encoder watches.
    pub(crate) lays_lines: bool,
    /// What a filament change draws out and pushes in, units of 10 nm (M603).
    pub(crate) filament_10nm: [i64; 2],
    /// What changes with the height (TUNING_TOWER).
    pub(crate) tower: Option<Tower>,
    pub(crate) print_clock: PrintClock,
    /// The command at hand is a line of a macro.
    pub(crate) is_in_macro: bool,
    pub(crate) accelerometer: Option<&'a dyn Accelerometer>,
    pub(crate) power_loss: PowerLoss,
    pub(crate) black_box: Option<&'a dyn BlackBox>,
    /// M555: which part of the bed is measured next.
    pub(crate) bed_area: Option<BedArea>,
    /// The selected tool, of several.
    pub(crate) tools: <<P::Motion as Motion>::Tools as Part>::Of<ToolBox>,
}

impl<'a, M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Printer<'a, (M, H, T, R)> {
    /// A printer that has just been switched on: nothing homed, everything cold.
    pub fn new(profile: &'a Profile, motion: M, heating: H, clock: T, replies: &'a R, signals: &'a Signals) -> Self {
        signals.set_heater_timeout_s(profile.heater_timeout_s);
        if M::FOLLOWS_FILAMENT
            && let Some(length_10nm) = profile.filament_sensor.and_then(|sensor| sensor.detection_10nm())
        {
            signals.set_filament_detection_10nm(length_10nm as u32);
            signals.count_filament_anew();
        }
        Self {
            profile,
            motion,
            heating,
            clock,
            replies,
            signals,
            interpreter: MoveInterpreter::new(profile),
            line: 0,
            last_line: 0,
            said: Remarks::NONE,
            version: env!("CARGO_PKG_VERSION"),
            identifier: None,
            emergency_parser: false,
            meatpack: false,
            timing: None,
            drivers: None,
            equipment: Equipment::ALL,
            settings_memory: None,
            receives_jobs: false,
            job_request: None,
            card: Card::none(),
            source: Source::File,
            paused: None,
            progress: (None, None),
            targets_celsius: [0.0; Heater::COUNT],
            told_halted: false,
            pauses_at_runout: profile.filament_sensor.is_some(),
            lays_lines: false,
            filament_10nm: profile.pause.filament_10nm(),
            tower: None,
            print_clock: PrintClock::new(),
            is_in_macro: false,
            accelerometer: None,
            power_loss: PowerLoss::new(),
            black_box: None,
            bed_area: None,
            tools: M::Tools::of(ToolBox::new(profile)),
        }
    }
}

impl<'a, P: Ports> Printer<'a, P> {
    /// Version of the firmware as M115 reports it, `0.1.0 (commit abcdef0)`; without this it has no commit.
    pub fn set_version(&mut self, version: &'a str) {
        self.version = version;
    }

    /// The board's own number, such as its chip's unique identifier: M115 reports it as a UUID.
    pub fn set_identifier(&mut self, identifier: [u32; 3]) {
        self.identifier = Some(identifier);
    }

    /// Says that M112, M108 and M410 are acted on as their bytes arrive (M115 reports it).
    pub fn set_emergency_parser(&mut self, present: bool) {
        self.emergency_parser = present;
    }

    /// Says that the ports' bytes may be packed (M115 reports it).
    pub fn set_meatpack(&mut self, present: bool) {
        self.meatpack = present;
    }

    /// The board measures its times (M798).
    pub fn set_timing(&mut self, timing: &'a dyn Timing) {
        self.timing = Some(timing);
    }

    /// The motors' drivers can be set (M122, M569, M906, M913, M914); nothing moves before all have confirmed their settings.
    pub fn set_drivers(&mut self, drivers: &'a dyn MotorDrivers) {
        self.drivers = Some(drivers);
    }

    /// The parts of the board that can be used; all without this.
    pub fn set_equipment(&mut self, equipment: Equipment) {
        self.equipment = equipment;
    }

    /// Counts of what has been done so far.
    pub fn tally(&self) -> Tally {
        self.interpreter.tally
    }

    /// X, Y, Z and E as the G-code sees them, units of 10 nm.
    pub fn logical_10nm(&self) -> [i64; 4] {
        self.interpreter.modal.logical_10nm()
    }

    /// The feed of the moves to come, at the present percentage, mm/s.
    pub fn feed_mm_per_s(&self) -> f64 {
        let modal = &self.interpreter.modal;
        modal.feed_mm_per_s(modal.feed_10nm_per_min).into()
    }

    pub(crate) fn replies(&self) -> &'a P::Replies {
        self.replies
    }

    pub(crate) fn set_last_line(&mut self, number: i64) {
        self.last_line = number;
    }

    /// Waits until all motion has ended, as at the end of a job.
    pub async fn finish(&mut self) -> Result<(), CommandError> {
        Ok(self.motion.finish().await?)
    }

    /// Executes a line of a host, which waits for each answer: as [`Self::execute`], but with about 1 s of motion at hand a
    /// move is answered when there is less.
    pub async fn execute_for_host(&mut self, line: u32, text: &str, is_numbered: bool) -> Result<(), Failure> {
        // The moves of a prepared job, between which a host is answered, fill the ring.
        self.motion.set_bounded_in_time(!self.interpreter.modal.in_prepared_job);
        self.execute_from(Source::Host { is_numbered }, line, text).await
    }

    /// Executes the text of a line and answers it with exactly one `ok`; before it an `echo:` explains a refusal. Moves fill the
    /// whole look-ahead ring.
    pub async fn execute(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        self.motion.set_bounded_in_time(false);
        self.execute_from(Source::File, line, text).await
    }

    async fn execute_from(&mut self, source: Source, line: u32, text: &str) -> Result<(), Failure> {
        (self.source, self.line) = (source, line);
        self.signals.note_host();
        // A command at work keeps the motors on. If the idle timeout has switched them off before, the printer learns it now.
        self.signals.set_at_work(true);
        if self.motion.take_switched_off() {
            self.interpreter.modal.forget_home(ALL_MOTORS);
        }
        if let Some(black_box) = self.black_box {
            black_box.command(line, text);
        }
        self.log_line(text).await;
        let outcome = self.answer(line, text).await;
        // A paused print keeps them on, too, because it must know its position.
        self.signals.set_at_work(self.is_paused());
        outcome
    }

    /// Executes a command and, while it takes long, says `busy` as often as M113 asks: after too long a silence hosts give the
    /// printer up. A wait for heat reports temperatures instead.
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
                    replies.send(if signals.is_paused_for_user() { Reply::PausedForUser } else { Reply::Busy });
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
            // M410 has acted as its bytes arrived; its line may never be executed.
            let dropped_100pm = self.motion.take_dropped_100pm();
            self.reckon_stop(dropped_100pm);
        }
        if self.signals.is_halted() && !matches!(command, Command::Restart) {
            self.cancel();
            self.stop_print_clock(false);
            // Ask what has happened now: the planner task may not have followed the stop yet.
            self.stop_motion();
            match while_halted(command) {
                WhileHalted::Works => {}
                WhileHalted::IsOff => return Ok(Answer::Ok),
                WhileHalted::Refused => return Err(CommandError::Halted),
            }
        }
        let result = match self.motion.take_fault() {
            Some(fault) => Err(CommandError::MotionFault(fault)),
            None => self.go_on_and_dispatch(command).await,
        };
        if let Err(error) = result {
            self.follow_after(error);
        }
        result
    }

    /// After a failed command: if motion was stopped, the G-code's position becomes that of the motors. If a motor does not stand
    /// where its block ends, no position is certain.
    pub(crate) fn follow_after(&mut self, error: CommandError) {
        match error {
            CommandError::MotionFault(_) => {
                self.interpreter.forget_home(ALL_MOTORS);
                self.follow_the_motors();
            }
            CommandError::Stopped | CommandError::Halted | CommandError::NeedsReset(_) => self.follow_the_motors(),
            // Where it sticks out it would scratch over the bed.
            CommandError::ProbePin(_) => self.interpreter.modal.note_failed_home([false, false, true], true),
            _ => {}
        }
    }

    /// After a stop the G-code's position becomes that of the motors. A halt also takes their current away, and with it the homed
    /// position.
    pub(crate) fn follow_the_motors(&mut self) {
        if self.signals.is_halted() {
            self.motion.set_motors_enabled(ALL_MOTORS, false);
            self.interpreter.modal.forget_home(ALL_MOTORS);
        }
        self.interpreter.modal.lift_10nm = 0;
        self.interpreter.follow(self.motion.position_10nm());
    }

    /// Stops motion at once; position, extruder and filament become what has really happened.
    pub(crate) fn stop_motion(&mut self) {
        let dropped_100pm = self.motion.stop();
        self.reckon_stop(dropped_100pm);
    }

    /// Motion was stopped, with this much filament unpushed.
    fn reckon_stop(&mut self, dropped_100pm: i64) {
        let [x, y, z, _] = self.motion.motor_steps();
        self.interpreter.take_back(dropped_100pm, [x, y, z]);
        self.follow_the_motors();
    }

    /// M999. The halt has stopped the motors, but the filament that they left unpushed has not been
    /// subtracted. A heater fault that is still there halts the machine again at once.
    pub(crate) fn restart(&mut self) -> Result<(), CommandError> {
        if !self.signals.is_halted() {
            return Ok(());
        }
        self.targets_celsius = [0.0; Heater::COUNT];
        self.end_tower("the machine was halted");
        self.stop_print_clock(false);
        self.stop_motion();
        // First the flag, then the heaters: these report a fault in between themselves.
        self.signals.restart();
        if let Err(fault) = self.heating.restart() {
            self.signals.halt();
            self.replies.say(format_args!("{fault}"));
            self.replies.send(Reply::Killed);
            return Err(if fault.trip.needs_reset() { CommandError::NeedsReset(fault) } else { CommandError::Halted });
        }
        self.told_halted = false;
        if self.supplied().is_err() {
            self.replies.say(format_args!("echo:{}", CommandError::SupplyOff));
        }
        Ok(())
    }

    /// The waits of the present command.
    pub(crate) fn waits(&self) -> Waits<'a, P::Clock> {
        Waits { clock: self.clock.clone(), signals: self.signals }
    }

    /// Whether the line's source is a host.
    pub(crate) fn has_host(&self) -> bool {
        self.source != Source::File
    }

    /// Refuses a command whose parts the board does not have.
    pub(crate) fn needs(&self, is_there: bool, what: &'static str) -> Result<(), CommandError> {
        if is_there { Ok(()) } else { Err(CommandError::NotEquipped(what)) }
    }

    /// M112: heat first, then motion.
    pub(crate) fn emergency_stop(&mut self) -> Result<Answer, CommandError> {
        self.heating.halt();
        self.stop_motion();
        self.signals.halt();
        self.replies.send(Reply::Killed);
        Err(CommandError::Halted)
    }
}
