//! SAVE_GCODE_STATE and RESTORE_GCODE_STATE: modes, offsets, percentages and the place, by names.
//!
//! Source: Klipper's *G-Codes* and `klippy/extras/gcode_move.py`: E keeps the value that it had
//! when the state was noted.

use std::collections::BTreeMap;

use ferrostep_gcode::Decimal;
use ferrostep_printer::{GcodeState, Ports, Printer};

use super::lines::{Mm, as_in, execute_all, feed_word, in_mm};
use super::offsets::Offsets;
use super::words::Words;

/// Maximum number of names that a file may note; a broken one could have any number.
const MAX_STATES: usize = 100;

/// The name of a state without one.
const DEFAULT_NAME: &str = "default";

/// The noted states.
#[derive(Debug, Default)]
pub(super) struct GcodeStates(BTreeMap<String, (GcodeState, Offsets)>);

impl GcodeStates {
    /// Notes the state under a name; one of this name before is forgotten.
    ///
    /// # Errors
    /// Too many names.
    pub fn save<P: Ports>(&mut self, printer: &Printer<'_, P>, text: &str, offsets: &Offsets) -> Result<(), String> {
        let name = Words::of(text).value("NAME").unwrap_or(DEFAULT_NAME);
        if self.0.len() >= MAX_STATES && !self.0.contains_key(name) {
            return Err(format!("at most {MAX_STATES} states can be noted: use the name of one before again"));
        }
        self.0.insert(name.to_owned(), (printer.gcode_state(), *offsets));
        Ok(())
    }

    /// Returns to a noted state. With MOVE=1 the nozzle goes back to its place.
    ///
    /// # Errors
    /// No state of this name is noted, or the printer refuses the move.
    pub async fn restore<P: Ports>(
        &self,
        printer: &mut Printer<'_, P>,
        line: u32,
        text: &str,
        offsets: &mut Offsets,
    ) -> Result<(), String> {
        let words = Words::of(text);
        let name = words.value("NAME").unwrap_or(DEFAULT_NAME);
        let Some((saved, saved_offsets)) = self.0.get(name) else {
            return Err(format!("no state \"{name}\" is noted: write SAVE_GCODE_STATE NAME={name} before"));
        };
        let moves = words.flag("MOVE")?;
        let speed = words.number("MOVE_SPEED")?.map(Decimal::to_f64);
        let units = printer.gcode_state().units;
        // The percentages are set first: the feed of the way back follows them.
        let feed = feed_word(saved, speed)?;
        let mut all = Vec::new();
        let now = printer.gcode_state();
        if now.feed_percent != saved.feed_percent {
            all.push(format!("M220 S{}", saved.feed_percent));
        }
        if now.flow_percent != saved.flow_percent {
            all.push(format!("M221 S{}", saved.flow_percent));
        }
        if now.z_offset_10nm != saved.z_offset_10nm {
            all.push(format!("SET_GCODE_OFFSET Z={}", Mm(saved.z_offset_10nm)));
        }
        execute_all(printer, line, &all).await?;
        *offsets = *saved_offsets;

        // An offset of Z changes where the G-code sees the nozzle.
        let now = printer.gcode_state();
        let mut place = String::new();
        for (axis, letter) in ["X", "Y", "Z"].into_iter().enumerate() {
            let base_10nm = saved.logical_10nm[axis].saturating_sub(saved.machine_10nm[axis]);
            let logical_10nm = now.machine_10nm[axis].saturating_add(base_10nm);
            if logical_10nm != now.logical_10nm[axis] {
                place += &format!(" {letter}{}", Mm(logical_10nm));
            }
        }
        let mut all = vec![format!("G92{place} E{}", Mm(saved.logical_10nm[3]))];
        if moves {
            let [x, y, z, _] = saved.logical_10nm.map(Mm);
            all.extend(["G90".to_owned(), format!("G1 X{x} Y{y} Z{z} {feed}")]);
        }
        all.extend(as_in(saved));
        execute_all(printer, line, &in_mm(units, all)).await
    }
}
