//! Lines of G-code that stand for a command, executed one after the other.

use std::fmt;

use ferrostep_gcode::Units;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::{GcodeState, Ports, Printer};

/// A length in units of 10 nm, written in mm.
pub(super) struct Mm(pub i64);

impl fmt::Display for Mm {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let per_mm = UNITS_PER_MM.unsigned_abs();
        let (sign, units) = (if self.0 < 0 { "-" } else { "" }, self.0.unsigned_abs());
        write!(out, "{sign}{}.{:05}", units / per_mm, units % per_mm)
    }
}

/// Executes a line of the file.
///
/// # Errors
/// The printer refuses it.
pub(super) async fn execute<P: Ports>(printer: &mut Printer<'_, P>, line: u32, text: &str) -> Result<(), String> {
    printer.execute(line, text).await.map_err(|failure| failure.to_string())
}

/// Executes the lines that a line of the file stands for.
///
/// # Errors
/// The printer refuses one, which the message names.
pub(super) async fn execute_all<P: Ports>(
    printer: &mut Printer<'_, P>,
    line: u32,
    texts: &[String],
) -> Result<(), String> {
    for text in texts {
        execute(printer, line, text).await.map_err(|message| format!("{text}: {message}"))?;
    }
    Ok(())
}

/// The lines between those that read lengths in mm, whatever the file's units.
pub(super) fn in_mm(units: Units, lines: Vec<String>) -> Vec<String> {
    match units {
        Units::Millimetres => lines,
        Units::Inches => {
            let around = |code: &str| std::iter::once(code.to_owned());
            around("G21").chain(lines).chain(around("G20")).collect()
        }
    }
}

/// The lines after which words are read as in a state: absolute or relative, and the feed.
pub(super) fn as_in(state: &GcodeState) -> [String; 3] {
    let axes = if state.is_relative { "G91" } else { "G90" };
    // After G90 and G91, which rule the extruder too.
    let extruder = if state.is_extruder_relative { "M83" } else { "M82" };
    [axes.to_owned(), extruder.to_owned(), format!("G1 F{}", Mm(state.feed_10nm_per_min))]
}

/// The word of a feed, at the present percentage: of this speed, or that of the state.
///
/// # Errors
/// The speed is not above 0.
pub(super) fn feed_word(state: &GcodeState, mm_per_s: Option<f64>) -> Result<String, String> {
    let Some(mm_per_s) = mm_per_s else { return Ok(format!("F{}", Mm(state.feed_10nm_per_min))) };
    let mm_per_min = mm_per_s * 60.0 * 100.0 / f64::from(state.feed_percent.max(1));
    if !(mm_per_min > 0.0 && mm_per_min < 1e7) {
        return Err("MOVE_SPEED takes a speed above 0 in mm/s, as in MOVE_SPEED=100".to_owned());
    }
    Ok(format!("F{mm_per_min:.5}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_written_exactly() {
        for (units, text) in [(0, "0.00000"), (-1, "-0.00001"), (123_456_789, "1234.56789"), (-100_000, "-1.00000")] {
            assert_eq!(Mm(units).to_string(), text);
        }
    }
}
