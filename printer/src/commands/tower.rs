//! TUNING_TOWER: a live value that changes with the height of the print.

use core::fmt;

use ferrostep_gcode::{Command, ParseError, Real, Remarks, ShortText, TowerWords, parse_with_remarks};

use crate::error::{CommandError, Failure};
use crate::job::tower::{MM, Tower, TowerLine, TowerRefusal};
use crate::ports::{Ports, Replies};
use crate::printer::Printer;

/// Drop of a line below the tower's last height that indicates another print, as in Klipper; units
/// of 10 nm.
const LOWER_10NM: i64 = 2 * MM;

impl<P: Ports> Printer<'_, P> {
    /// Executes TUNING_TOWER. It replaces any earlier tower.
    #[cold]
    #[inline(never)]
    pub(crate) fn set_tower(&mut self, words: Option<&TowerWords<'_>>) -> Result<(), CommandError> {
        if let Some(words) = words {
            if self.interpreter.modal.in_prepared_job {
                return Err(CommandError::Tower(TowerRefusal::InJob));
            }
            let tower = Tower::new(words).map_err(CommandError::Tower)?;
            if !tower.sets_a_value() {
                return Err(CommandError::Tower(TowerRefusal::NoNumber(ShortText::new(words.parameter))));
            }
            self.print.tower = Some(tower);
            return Ok(());
        }
        match &self.print.tower {
            None => self.replies.send(ferrostep_gcode::Reply::Text("echo:TUNING_TOWER: none")),
            Some(tower) => {
                self.replies.say(format_args!("echo:{tower}"));
                if let (Some(value), Some(height_10nm)) = (tower.value, tower.height_10nm) {
                    let height = Real::fixed(height_10nm as f64 / MM as f64, 2);
                    self.replies.say(format_args!("echo:TUNING_TOWER at Z{height}: {}{value}", tower.prefix));
                }
            }
        }
        Ok(())
    }

    /// The line that a tower has to execute before this command, the first that prints
    /// at a new height.
    #[inline]
    pub(crate) fn due_of_tower(&mut self, command: &Command<'_>) -> Option<TowerLine> {
        if self.print.tower.is_some() { self.line_of_tower(command) } else { None }
    }

    #[cold]
    #[inline(never)]
    fn line_of_tower(&mut self, command: &Command<'_>) -> Option<TowerLine> {
        let modal = &self.interpreter.modal;
        let (axes, is_rapid, is_arc) = match command {
            Command::Linear { axes, rapid, .. } => (axes, *rapid, false),
            Command::Arc { axes, .. } => (axes, false, true),
            _ => return None,
        };
        let (target_10nm, extruder_10nm) = modal.target(axes)?;
        let by_length = modal.extrusion.settings().adaptive && axes.e.is_none() && !is_rapid && !modal.retracted;
        // A full circle ends where it begins.
        let displaces = is_arc || target_10nm != modal.machine_10nm;
        let [.., height_10nm] = target_10nm;
        let is_in_plane = height_10nm == modal.machine_10nm[2];
        if !displaces || !(extruder_10nm > modal.extruder_10nm || (by_length && is_in_plane)) {
            return None;
        }
        let seen_10nm = height_10nm + modal.offset_10nm[2];
        let tower = self.print.tower.as_mut()?;
        let before_10nm = tower.height_10nm.replace(height_10nm);
        if before_10nm == Some(height_10nm) {
            return None;
        }
        if before_10nm.is_some_and(|before_10nm| height_10nm < before_10nm - LOWER_10NM) {
            self.end_tower("the print continues lower");
            return None;
        }
        let value = tower.value_at(seen_10nm);
        if tower.value.replace(value) == Some(value) { None } else { Some(tower.line(value)) }
    }

    /// Parses a tower's line; an unreadable one ends the tower.
    #[cold]
    #[inline(never)]
    pub(crate) fn read_of_tower<'l>(&mut self, line: &'l str) -> Option<Command<'l>> {
        let mut remarks = Remarks::NONE;
        let read: Result<_, ParseError> = parse_with_remarks(line, &mut remarks);
        if matches!(read, Ok(Command::Accepted)) {
            self.fail_tower(line, &remarks);
            return None;
        }
        if !remarks.is_empty() {
            self.remark(self.lines.number, line, &remarks);
        }
        read.map_err(|error| self.fail_tower(line, &Failure::Parse(error))).ok()
    }

    /// Ends a tower whose line was refused: the print continues with the previous value.
    #[cold]
    #[inline(never)]
    pub(crate) fn fail_tower(&mut self, line: &str, failure: &impl fmt::Display) {
        self.print.tower = None;
        self.replies
            .say(format_args!("echo:line {}: TUNING_TOWER has ended, \"{line}\": {failure}", self.lines.number));
    }

    /// Ends a tower that has begun; its value stays. One that still waits for its print keeps
    /// waiting: a print begins by homing.
    #[cold]
    #[inline(never)]
    pub(crate) fn end_begun_tower(&mut self) {
        if self.print.tower.as_ref().is_some_and(|tower| tower.value.is_some()) {
            self.end_tower("the print has ended");
        }
    }

    /// Ends the tower, if any; its value stays.
    #[cold]
    #[inline(never)]
    pub(crate) fn end_tower(&mut self, why: &str) {
        if self.print.tower.take().is_some() {
            self.replies.say(format_args!("echo:TUNING_TOWER has ended: {why}"));
        }
    }
}

#[cfg(test)]
mod tests;
