//! Switches MeatPack on if the printer supports it.

use std::io;
use std::time::Duration;

use ferrostep_gcode::meatpack;

use super::error::SendError;
use super::meeting::meet;
use super::packing::Packing;
use super::port::{Patience, Port};

/// Line in the answer to M115 by which a board says that it supports MeatPack.
const KNOWS_PACKING: &str = "Cap:MEATPACK:1";

/// Asks the board whether it supports MeatPack, and switches MeatPack on if it does; `hear`
/// receives the board's lines.
///
/// # Errors
/// The board does not answer, or is gone.
pub fn begin_packing(
    port: &mut impl Port,
    patience: Patience,
    mut hear: impl FnMut(&str),
) -> Result<Packing, SendError> {
    // An earlier host may have left MeatPack on. A board without MeatPack reads these bytes as part
    // of a line and answers that line.
    port.send(&meatpack::END)?;
    meet(port, Packing::Plain, patience, &mut hear)?;
    port.send(b"M115\n")?;
    let mut is_known = false;
    loop {
        let Some(said) = receive(port, patience.give_up)? else {
            return Err(SendError::Silent(vec!["(nothing after M115)".to_owned()]));
        };
        hear(&said);
        is_known |= said == KNOWS_PACKING;
        if said.starts_with("ok") {
            break;
        }
    }
    if !is_known {
        return Ok(Packing::Plain);
    }
    port.send(&meatpack::BEGIN)?;
    let on = meatpack::Settings { packing: true, no_spaces: false }.to_string();
    // Reports on earlier commands come first.
    while let Some(said) = receive(port, patience.give_up)? {
        hear(&said);
        if said == on {
            return Ok(Packing::MeatPack);
        }
    }
    Err(SendError::Silent(vec![format!("(no {on:?} after MeatPack was switched on)")]))
}

/// Receives the board's next line, if it arrives in time.
fn receive(port: &mut impl Port, patience: Duration) -> io::Result<Option<String>> {
    let until = port.now() + patience;
    port.receive(until)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::send::scripted::{Scripted, echo};

    const NAMES: &str = "FIRMWARE_NAME:Other 1.0 (2020) MACHINE_TYPE:Mill";

    /// Calls [`begin_packing`] on a printer with these answers to the end-of-packing bytes and to
    /// M115; returns the outcome and the number of the printer's lines that were not read.
    fn begin(to_end: &[&'static str], to_m115: &[&'static str]) -> (Result<Packing, SendError>, usize) {
        let lines = |lines: &[&str]| lines.iter().map(|&line| line.to_owned()).collect();
        let mut port = Scripted::new(|line: &str, _| match line {
            "M115" => lines(to_m115),
            line if line.contains("M110") => lines(&["ok"]),
            line => echo(line).unwrap_or_else(|| lines(to_end)),
        });
        let packing = begin_packing(&mut port, Patience::DEFAULT, |_| {});
        (packing, port.unheard())
    }

    #[test]
    fn the_answer_to_the_bytes_before_is_not_that_to_m115() {
        for to_end in [&[][..], &["ok"], &["echo:Unknown command: \"\"", "ok"]] {
            let (packing, unheard) = begin(to_end, &[NAMES, "Cap:MEATPACK:0", "ok"]);
            assert_eq!((packing.unwrap(), unheard), (Packing::Plain, 0), "{to_end:?}");
            // Klipper puts its answer after the `ok`.
            let (packing, unheard) = begin(to_end, &["ok FIRMWARE_NAME:Klipper"]);
            assert_eq!((packing.unwrap(), unheard), (Packing::Plain, 0), "{to_end:?}");
        }
    }

    #[test]
    fn a_printer_that_does_not_know_m115_gets_text() {
        let (packing, unheard) = begin(&["ok"], &["echo:Unknown command: \"M115\"", "ok"]);
        assert_eq!((packing.unwrap(), unheard), (Packing::Plain, 0));
        let (packing, _) = begin(&["ok"], &[]);
        assert!(matches!(packing, Err(SendError::Silent(_))));
    }
}
