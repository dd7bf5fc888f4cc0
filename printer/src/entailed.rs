//! A command, and what it entails: a paused print goes on, a tower sets its value, filament that has run out is changed.

use ferrostep_gcode::{Command, Reply};

use crate::axis_names::AXIS_NAMES;
use crate::command_kind::{moves, sets_modes};
use crate::error::{CommandError, Failure};
use crate::fan_commands::PAUSE;
use crate::filament::{CHANGE_FILAMENT, lays};
use crate::modal::Modal;
use crate::ports::{Ports, Replies};
use crate::printer::{Answer, Printer, Source};

/// An axis' name, where it has one.
struct Letter(Option<char>);

impl core::fmt::Display for Letter {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.map_or(Ok(()), |letter| core::fmt::Write::write_char(out, letter))
    }
}

impl<P: Ports> Printer<'_, P> {
    /// If its reader did not wait, the next move or mode of a print resumes it.
    pub(crate) async fn go_on_and_dispatch(&mut self, command: &Command<'_>) -> Result<Answer, CommandError> {
        let is_of_print = match self.source {
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
        // A mode too: set while the print is paused, it would be undone when the print goes on.
        if is_of_print && self.is_paused() && (moves(command) || sets_modes(command)) {
            self.resume().await?;
        }
        if is_of_print && moves(command) && self.have_heaters_rested() {
            self.replies.send(Reply::Text("echo:heaters were switched off (M86), they heat up again for this print"));
            self.heat_again(self.targets_celsius).await?;
        }
        let due = self.due_of_tower(command);
        let mut of_tower = due.as_deref().and_then(|line| self.read_of_tower(line));
        let mut command = command;
        loop {
            // One wait for all, which takes less room than several.
            let outcome = self.dispatch(of_tower.as_ref().unwrap_or(command)).await;
            if of_tower.take().is_some() {
                match outcome {
                    Err(error) if error.stops() => return Err(error),
                    Err(error) => self.fail_tower(due.as_deref().unwrap_or_default(), &Failure::Command(error)),
                    Ok(_) => {}
                }
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

    /// Reports once that the target of a move is uncertain: motors without current may have been turned.
    fn tell_lost_home(&mut self) {
        let Modal { homed, lost, .. } = &mut self.interpreter.modal;
        let untold = [0, 1, 2].map(|axis| core::mem::take(&mut lost[axis]) && !homed[axis]);
        if untold == [false; 3] {
            return;
        }
        let name = |axis: usize| if untold[axis] { AXIS_NAMES.get(axis).copied() } else { None };
        let [x, y, z] = [0, 1, 2].map(|axis| Letter(name(axis)));
        let line = self.line;
        self.replies.say(format_args!(
            "echo:line {line}: {x}{y}{z} lost its home when the motors were off: its position is not certain and has no soft \
             limits, home it (G28)"
        ));
    }
}
