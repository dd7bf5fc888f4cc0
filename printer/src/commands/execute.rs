//! Execution of a line: its source, the effects of a stop or a halt on it, and busy messages during
//! long commands.

use core::future::{Future, poll_fn};
use core::pin::pin;

use ferrostep_gcode::{Command, Reply};
use ferrostep_hal_shim::Clock;

use crate::commands::waits::Waits;
use crate::error::{CommandError, Failure};
use crate::job::command_kind::{WhileHalted, while_halted};
use crate::job::lines::Source;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::{ALL_MOTORS, Answer, Printer};

impl<'a, P: Ports> Printer<'a, P> {
    /// Waits until all motion has ended, as at the end of a job.
    pub async fn finish(&mut self) -> Result<(), CommandError> {
        Ok(self.motion.finish().await?)
    }

    /// Executes a line of a host, which waits for each answer: as [`Self::execute`], but a move is
    /// answered as soon as less than about 1 s of motion is queued.
    pub async fn execute_for_host(&mut self, line: u32, text: &str, is_numbered: bool) -> Result<(), Failure> {
        // Moves of a prepared job, between which hosts are answered, fill the ring.
        self.motion.set_bounded_in_time(!self.interpreter.modal.in_prepared_job);
        self.execute_from(Source::Host { is_numbered }, line, text).await
    }

    /// Executes the text of a line and answers it with exactly one `ok`; before it an `echo:`
    /// explains a refusal. Moves fill the whole look-ahead ring.
    pub async fn execute(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        self.motion.set_bounded_in_time(false);
        self.execute_from(Source::File, line, text).await
    }

    async fn execute_from(&mut self, source: Source, line: u32, text: &str) -> Result<(), Failure> {
        self.lines.begin(source, line);
        self.signals.note_host();
        // A command at work keeps the motors on. If the idle timeout has switched them off before,
        // the printer reads that here.
        self.signals.set_at_work(true);
        if self.motion.take_switched_off() {
            self.interpreter.modal.forget_home(ALL_MOTORS);
        }
        if let Some(black_box) = self.fitted.black_box {
            black_box.command(line, text);
        }
        self.log_line(text).await;
        let outcome = self.answer(line, text).await;
        // A paused print keeps the motors on as well, because it must know its position.
        self.signals.set_at_work(self.is_paused());
        outcome
    }

    /// Executes a command and meanwhile reports `busy` at M113's interval: hosts give up a printer
    /// that is silent for too long. A wait for heat reports temperatures instead.
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
            // M410 acted as its bytes arrived; its line may never be executed.
            let dropped_100pm = self.motion.take_dropped_100pm();
            self.reckon_stop(dropped_100pm);
        }
        if self.signals.is_halted() && !matches!(command, Command::Restart) {
            self.cancel();
            self.stop_print_clock(false);
            // The planner task may not have followed the stop yet: ask now.
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

    /// Follows the motors after a failed command: if motion was stopped, the G-code's position
    /// becomes theirs. If a motor is not where its block ends, the position is unknown.
    pub(crate) fn follow_after(&mut self, error: CommandError) {
        match error {
            CommandError::MotionFault(_) => {
                self.interpreter.forget_home(ALL_MOTORS);
                self.follow_the_motors();
            }
            CommandError::Stopped | CommandError::Halted | CommandError::NeedsReset(_) => self.follow_the_motors(),
            // A probe pin that sticks out would scratch over the bed.
            CommandError::ProbePin(_) => self.interpreter.modal.note_failed_home([false, false, true], true),
            _ => {}
        }
    }

    /// Makes the G-code's position that of the motors, after a stop. A halt also takes their
    /// current away, and with it the homed position.
    pub(crate) fn follow_the_motors(&mut self) {
        if self.signals.is_halted() {
            self.motion.set_motors_enabled(ALL_MOTORS, false);
            self.interpreter.modal.forget_home(ALL_MOTORS);
        }
        self.interpreter.modal.lift_10nm = 0;
        self.interpreter.follow(self.motion.position_10nm());
    }

    /// Stops motion at once; position, extruder and filament follow the motors.
    pub(crate) fn stop_motion(&mut self) {
        let dropped_100pm = self.motion.stop();
        self.reckon_stop(dropped_100pm);
    }

    /// Accounts for a motion stop that left this much filament unpushed.
    fn reckon_stop(&mut self, dropped_100pm: i64) {
        let [x, y, z, _] = self.motion.motor_steps();
        self.interpreter.take_back(dropped_100pm, [x, y, z]);
        self.follow_the_motors();
    }

    /// Executes M999. The halt has stopped the motors, but the filament that they left unpushed has
    /// not been subtracted. A heater fault that persists halts the machine again at once.
    pub(crate) fn restart(&mut self) -> Result<(), CommandError> {
        if !self.signals.is_halted() {
            return Ok(());
        }
        self.modes.forget_targets();
        self.end_tower("the machine was halted");
        self.stop_print_clock(false);
        self.stop_motion();
        // The flag first, then the heaters, which report a fault in between themselves.
        self.signals.restart();
        if let Err(fault) = self.heating.restart() {
            self.signals.halt();
            self.replies.say(format_args!("{fault}"));
            self.replies.send(Reply::Killed);
            return Err(if fault.trip.needs_reset() { CommandError::NeedsReset(fault) } else { CommandError::Halted });
        }
        self.lines.told_halted = false;
        if self.supplied().is_err() {
            self.replies.say(format_args!("echo:{}", CommandError::SupplyOff));
        }
        Ok(())
    }

    /// The waits of the present command.
    pub(crate) fn waits(&self) -> Waits<'a, P::Clock> {
        Waits { clock: self.clock.clone(), signals: self.signals }
    }

    /// Returns true if the line's source is a host.
    pub(crate) fn has_host(&self) -> bool {
        self.lines.has_host()
    }

    /// Refuses a command if the board lacks its parts.
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
