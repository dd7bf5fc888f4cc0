//! Actions that a command entails: resuming a paused print, setting a tower's value, changing
//! filament that has run out.

use core::pin::pin;

use ferrostep_gcode::{Command, Real, Reply, WaitTarget};
use ferrostep_hal_shim::Heater;

use crate::commands::fans::PAUSE;
use crate::commands::filament::{CHANGE_FILAMENT, lays};
use crate::error::{CommandError, Failure};
use crate::job::command_kind::{moves, sets_modes};
use crate::job::lines::Source;
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::modal::Modal;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::{Answer, Printer};

/// Name of an axis, if it has one.
struct Letter(Option<char>);

impl core::fmt::Display for Letter {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.map_or(Ok(()), |letter| core::fmt::Write::write_char(out, letter))
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Resumes a paused print before its next move or mode, if its reader did not wait, and
    /// dispatches the command.
    pub(crate) async fn go_on_and_dispatch(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
        let is_of_print = match self.lines.source {
            Source::Host { is_numbered } => is_numbered && !self.prints_from_card(),
            Source::File | Source::Card => true,
        };
        if moves(command) {
            self.tell_lost_home();
        }
        if is_of_print
            && lays(command)
            && let Some(axis) = self.interpreter.modal.failed_home.iter().position(|failed| *failed)
        {
            return Err(CommandError::FailedHome { axis });
        }
        // A mode resumes the print as well: set while the print is paused, it would be undone when
        // the print resumes.
        if is_of_print && self.is_paused() && (moves(command) || sets_modes(command)) {
            self.resume().await?;
        }
        if is_of_print && moves(command) && self.have_heaters_rested() {
            self.replies.send(Reply::Text("echo:heaters were switched off (M86), they heat up again for this print"));
            pin!(self.heat_again(self.modes.targets_celsius)).await?;
        }
        if is_of_print
            && let Some((nozzle, celsius)) = self.cools_print(command)
            && let Err(error) = self.motion.finish().await
        {
            // A heater is switched off even if motion has failed.
            self.set_temperature(nozzle, celsius)?;
            return Err(error.into());
        }
        let mut has_waited = false;
        let due = self.due_of_tower(command);
        let mut of_tower = due.as_deref().and_then(|line| self.read_of_tower(line));
        let mut command = command;
        loop {
            // One await for all commands takes less room than several.
            let outcome = self.dispatch(of_tower.as_ref().unwrap_or(command)).await;
            if of_tower.take().is_some() {
                match outcome {
                    Err(error) if error.stops() => return Err(error),
                    Err(error) => self.fail_tower(due.as_deref().unwrap_or_default(), &Failure::Command(error)),
                    Ok(_) => {}
                }
                continue;
            }
            if is_of_print
                && !has_waited
                && matches!(outcome, Err(CommandError::ColdExtrusion { .. }))
                && !self.is_meant_cold()
            {
                has_waited = true;
                self.tell_cold_start();
                pin!(self.wait_until_hot(self.nozzle())).await?;
                continue;
            }
            self.follow_filament(command, is_of_print);
            if !is_of_print || outcome.is_err() || !lays(command) {
                return outcome;
            }
            command = match () {
                () if self.has_run_out() => &CHANGE_FILAMENT,
                () if self.has_stalled_fan() => &PAUSE,
                () => return outcome,
            };
        }
    }

    /// Returns the nozzle and its new target if a command lowers the target from one at which
    /// filament is extruded to one that is too cold for it. The moves already accepted, which may
    /// take minutes, must be made at the temperature that they were written for.
    #[inline(never)]
    fn cools_print(&self, command: &Command<'_>) -> Option<(Heater, f64)> {
        let (tool, celsius) = match *command {
            Command::SetNozzle(tool, Some(celsius))
            | Command::WaitNozzle(tool, WaitTarget::Heating(celsius) | WaitTarget::HeatingOrCooling(celsius)) => {
                (tool, celsius.to_f64())
            }
            Command::HeatersOff => (None, 0.0),
            _ => return None,
        };
        let nozzle = self.nozzle_of(tool).ok()?;
        let minimum_celsius = self.interpreter.modal.min_extrusion_celsius;
        (self.is_meant_hot(nozzle) && celsius < f64::from(minimum_celsius)).then_some((nozzle, celsius))
    }

    /// Reports that a print is waiting for its nozzle, because no line has waited for its target.
    #[cold]
    #[inline(never)]
    fn tell_cold_start(&self) {
        let status = self.heating.status(self.nozzle());
        let (celsius, target) = (Real::fixed(status.celsius, 1), Real::short(status.target_celsius, 2));
        let line = self.lines.number;
        self.replies
            .say(format_args!("echo:line {line}: the nozzle is at {celsius} C, the print waits for {target} C"));
    }

    /// Reports once that the target of a move is uncertain: motors without current may
    /// have been turned.
    #[inline(never)]
    fn tell_lost_home(&mut self) {
        let Modal { homed, lost, .. } = &mut self.interpreter.modal;
        let untold = [0, 1, 2].map(|axis| core::mem::take(&mut lost[axis]) && !homed[axis]);
        if untold == [false; 3] {
            return;
        }
        let name = |axis: usize| if untold[axis] { AXIS_NAMES.get(axis).copied() } else { None };
        let [x, y, z] = [0, 1, 2].map(|axis| Letter(name(axis)));
        let line = self.lines.number;
        self.replies.say(format_args!(
            "echo:line {line}: {x}{y}{z} lost its home when the motors were off: its position is not certain and has no soft \
             limits, home it (G28)"
        ));
    }
}
