//! Commands of Klipper's that a file expects and the profile lacks: the desk stands in for them,
//! so that a file that people have for their own printer is rehearsed to its end. A board does
//! nothing of this.

mod first_targets;
mod gcode_states;
mod lines;
mod offsets;
mod start;
mod translated;
mod words;

use std::sync::atomic::{AtomicBool, Ordering};

use ferrostep_gcode::{Command, parse};
use ferrostep_printer::{Ports, Printer};

use crate::ahead::Ahead;
use crate::command_code::code;
use crate::job::Onlooker;
use crate::remarks::RemarkKind;
use gcode_states::GcodeStates;
use offsets::Offsets;
use start::{Call, Start};

/// The usual spelling of moves.
const MOVES: [&str; 2] = ["G1", "G0"];

/// True if the command line asks for macros as a board has them: it counts for each
/// job that begins.
static AS_ON_A_BOARD: AtomicBool = AtomicBool::new(false);

/// The treatment of a file's named commands that the printer does not execute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Macros {
    /// The desk stands in for them.
    Assumed,
    /// The commands are handed to the printer, which refuses or ignores them.
    AsOnABoard,
}

impl Macros {
    /// Lets each job that begins from now on have its macros as a board has them, or not.
    pub fn choose(as_on_a_board: bool) {
        AS_ON_A_BOARD.store(as_on_a_board, Ordering::Relaxed);
    }

    /// The choice for jobs that begin now.
    pub fn chosen() -> Self {
        if AS_ON_A_BOARD.load(Ordering::Relaxed) { Self::AsOnABoard } else { Self::Assumed }
    }
}

/// Executes the lines of one file, and stands in for commands that the printer lacks.
#[derive(Debug)]
pub(crate) struct FileMacros {
    macros: Macros,
    start: Start,
    states: GcodeStates,
    offsets: Offsets,
    /// A move has pushed filament: the print has begun.
    has_extruded: bool,
    /// The lines alone do not say where the nozzle goes: a start was assumed, or a state or an
    /// offset has changed what they mean.
    pub stands_in: bool,
}

impl FileMacros {
    /// The macros of a file that begins.
    pub fn new(macros: Macros) -> Self {
        Self {
            macros,
            start: Start::default(),
            states: GcodeStates::default(),
            offsets: Offsets::default(),
            has_extruded: false,
            stands_in: false,
        }
    }

    /// Reads a portion of the file before its lines are executed.
    pub fn look(&mut self, portion: &[u8]) {
        if self.macros == Macros::Assumed && !self.has_extruded {
            self.start.look(portion);
        }
    }

    /// Executes a line.
    ///
    /// # Errors
    /// The printer refuses it, or a command that it stands for.
    pub async fn execute<P: Ports>(
        &mut self,
        printer: &mut Printer<'_, P>,
        (line, text): (u32, &str),
        ahead: &mut Ahead<'_>,
        onlooker: &mut impl Onlooker<P>,
    ) -> Result<(), String> {
        if self.macros == Macros::AsOnABoard {
            return lines::execute(printer, line, text).await;
        }
        if is_named(text) && !printer.is_macro(text) {
            // Rare: its future would make that of every line larger.
            return Box::pin(self.named(printer, (line, text), ahead, onlooker)).await;
        }
        if let Some(call) = self.start.take_call_before(text) {
            Box::pin(self.assume(printer, call, ahead, onlooker)).await?;
        }
        // A file is nearly all moves, which home nothing: the rest is read a second time for that.
        let may_home = !MOVES.iter().any(|known| known.eq_ignore_ascii_case(code(text)));
        if may_home && self.start.is_assumed_home() {
            self.start.home_truly(printer, line, text).await?;
        }
        if self.start.seeks_place() {
            self.start.learn_place(printer, text).await?;
        }
        lines::execute(printer, line, text).await?;
        if !self.has_extruded {
            self.has_extruded = printer.tally().filament_100pm > 0;
        }
        if may_home && self.offsets.are_set() {
            self.offsets.outlast_homing(printer, line, text).await?;
        }
        Ok(())
    }

    /// Executes a line that begins with a name.
    async fn named<P: Ports>(
        &mut self,
        printer: &mut Printer<'_, P>,
        (line, text): (u32, &str),
        ahead: &mut Ahead<'_>,
        onlooker: &mut impl Onlooker<P>,
    ) -> Result<(), String> {
        let name = code(text).to_ascii_uppercase();
        match name.as_str() {
            "SAVE_GCODE_STATE" => self.states.save(printer, text, &self.offsets),
            "RESTORE_GCODE_STATE" => {
                if let Some(call) = self.start.take_call() {
                    self.assume(printer, call, ahead, onlooker).await?;
                }
                self.stands_in = true;
                self.states.restore(printer, line, text, &mut self.offsets).await
            }
            "SET_GCODE_OFFSET" => {
                self.stands_in = true;
                if let Some(remark) = self.offsets.set(printer, line, text).await? {
                    onlooker.remarked(RemarkKind::Ignored, line, &format!("{name}: {remark}"));
                }
                Ok(())
            }
            _ => {
                if let Some(lines) = translated::lines(&name, text)? {
                    return lines::execute_all(printer, line, &lines).await;
                }
                let is_known = match parse(text) {
                    Ok(Command::Accepted) => true,
                    Ok(Command::Unknown(_)) => false,
                    _ => return lines::execute(printer, line, text).await,
                };
                if self.has_extruded || !start::may_be_start(&name) {
                    return lines::execute(printer, line, text).await;
                }
                match self.start.call(printer, (line, text), is_known).await? {
                    Some(call) => no_start(printer, &call, onlooker).await,
                    None => Ok(()),
                }
            }
        }
    }

    /// Assumes what a call stands for, or nothing, if other lines have homed and heated.
    async fn assume<P: Ports>(
        &mut self,
        printer: &mut Printer<'_, P>,
        call: Call,
        ahead: &mut Ahead<'_>,
        onlooker: &mut impl Onlooker<P>,
    ) -> Result<(), String> {
        let Some(remark) = self.start.assume(printer, &call, ahead).await? else {
            return no_start(printer, &call, onlooker).await;
        };
        self.stands_in = true;
        onlooker.remarked(RemarkKind::Assumed, call.line, &format!("{}: {remark}", code(&call.text)));
        Ok(())
    }

    /// The file has ended: a call that has waited for a move is the printer's.
    ///
    /// # Errors
    /// The printer refuses it.
    pub async fn end<P: Ports>(&mut self, printer: &mut Printer<'_, P>) -> Result<(), String> {
        match self.start.take_call() {
            Some(call) => lines::execute(printer, call.line, &call.text).await,
            None => Ok(()),
        }
    }
}

/// A call is no start: one of a known name has its remark, and any other goes to the printer.
async fn no_start<P: Ports>(
    printer: &mut Printer<'_, P>,
    call: &Call,
    onlooker: &mut impl Onlooker<P>,
) -> Result<(), String> {
    if !call.is_known {
        return lines::execute(printer, call.line, &call.text).await;
    }
    let remark = "other lines home and heat the machine: no effect";
    onlooker.remarked(RemarkKind::NoEffect, call.line, &format!("{}: {remark}", code(&call.text)));
    Ok(())
}

/// The value of a key among the words of a named command.
pub(crate) fn value_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    words::Words::of(text).value(key)
}

/// Returns true if a line of a file begins with a name, for which the desk may have to stand in.
pub fn has_names(text: &[u8]) -> bool {
    let mut lines = text.split(|byte| matches!(byte, b'\n' | b'\r'));
    lines.any(|line| std::str::from_utf8(line).is_ok_and(|line| is_named(line.trim_start())))
}

/// Returns true if a line begins with a word, not with a letter and a number.
fn is_named(text: &str) -> bool {
    let is_name = |byte: &u8| byte.is_ascii_alphabetic() || *byte == b'_';
    text.as_bytes().get(..2).is_some_and(|start| start.iter().all(is_name))
}
