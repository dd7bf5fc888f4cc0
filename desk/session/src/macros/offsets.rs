//! SET_GCODE_OFFSET of X, Y and E, and moves by it at a speed. That of Z alone is the printer's.
//!
//! An offset of X, Y or E is a G92 by as much; through homing those of X and Y stay.

use ferrostep_gcode::{Command, Decimal, parse};
use ferrostep_printer::{Ports, Printer};

use super::lines::{Mm, as_in, execute, execute_all, feed_word, in_mm};
use super::words::Words;

/// The axes, by their words.
const AXES: [char; 4] = ['X', 'Y', 'Z', 'E'];
/// Index of Z.
const Z: usize = 2;

/// The offsets in force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Offsets {
    /// Offsets of X, Y and E, units of 10 nm; Z's is the printer's.
    offset_10nm: [i64; 4],
}

impl Offsets {
    /// Returns true if X or Y has an offset.
    pub fn are_set(&self) -> bool {
        let [x, y, ..] = self.offset_10nm;
        (x, y) != (0, 0)
    }

    /// Executes SET_GCODE_OFFSET. Returns a remark on what of it has no effect.
    ///
    /// # Errors
    /// A word cannot be read, or the printer refuses the offset; nothing has changed then.
    pub async fn set<P: Ports>(
        &mut self,
        printer: &mut Printer<'_, P>,
        line: u32,
        text: &str,
    ) -> Result<Option<&'static str>, String> {
        let words = Words::of(text);
        let state = printer.gcode_state();
        let before_10nm = {
            let [x, y, _, e] = self.offset_10nm;
            [x, y, state.z_offset_10nm, e]
        };
        let mut after_10nm = before_10nm;
        for (axis, after_10nm) in AXES.iter().zip(&mut after_10nm) {
            if let Some(offset) = words.number(&axis.to_string())? {
                *after_10nm = offset.to_10nm_from_mm();
            } else if let Some(more) = words.number(&format!("{axis}_ADJUST"))? {
                *after_10nm = after_10nm.saturating_add(more.to_10nm_from_mm());
            }
        }
        let moves = words.flag("MOVE")?;
        let speed = words.number("MOVE_SPEED")?.map(Decimal::to_f64);
        let by_10nm: [i64; 4] = std::array::from_fn(|axis| after_10nm[axis].saturating_sub(before_10nm[axis]));
        if by_10nm.iter().enumerate().all(|(axis, by_10nm)| axis == Z || *by_10nm == 0) && speed.is_none() {
            execute(printer, line, text).await?;
            return Ok(None);
        }
        let feed = feed_word(&state, speed)?;
        let mut all = Vec::new();
        if by_10nm[Z] != 0 {
            // First, because it may be refused.
            all.push(format!("SET_GCODE_OFFSET Z={}", Mm(after_10nm[Z])));
        }
        let mut new_place = String::new();
        let mut target = String::new();
        for (axis, letter) in AXES.iter().enumerate().filter(|(axis, _)| by_10nm[*axis] != 0) {
            let logical_10nm = state.logical_10nm[axis];
            if axis != Z {
                new_place += &format!(" {letter}{}", Mm(logical_10nm.saturating_sub(by_10nm[axis])));
            }
            if state.homed.get(axis).is_none_or(|is_homed| *is_homed) {
                target += &format!(" {letter}{}", Mm(logical_10nm));
            }
        }
        if !new_place.is_empty() {
            all.push(format!("G92{new_place}"));
        }
        if moves && !target.is_empty() {
            all.push("G90".to_owned());
            all.push(format!("G1{target} {feed}"));
            all.extend(as_in(&state));
        }
        execute_all(printer, line, &in_mm(state.units, all)).await?;
        self.offset_10nm = after_10nm;
        let stays = moves && (0..3).any(|axis| by_10nm[axis] != 0 && !state.homed[axis]);
        Ok(stays.then_some("MOVE moves no axis that is not homed; the offset holds from its next move on"))
    }

    /// Sets the offsets of axes again that a line has homed.
    ///
    /// # Errors
    /// The printer refuses it.
    pub async fn outlast_homing<P: Ports>(
        &self,
        printer: &mut Printer<'_, P>,
        line: u32,
        text: &str,
    ) -> Result<(), String> {
        let Ok(Command::Home { axes, .. }) = parse(text) else { return Ok(()) };
        let state = printer.gcode_state();
        let named = [axes.x, axes.y];
        let all = !(axes.x || axes.y || axes.z);
        let mut place = String::new();
        for axis in [0, 1] {
            let offset_10nm = self.offset_10nm[axis];
            if offset_10nm != 0 && (all || named[axis]) {
                place += &format!(" {}{}", AXES[axis], Mm(state.machine_10nm[axis].saturating_sub(offset_10nm)));
            }
        }
        if place.is_empty() {
            return Ok(());
        }
        execute_all(printer, line, &in_mm(state.units, vec![format!("G92{place}")])).await
    }
}
