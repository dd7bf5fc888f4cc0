//! MeatPack on the way to a printer.

use std::io;
use std::time::Duration;

use ferrostep_gcode::meatpack;

use super::error::SendError;
use super::port::{Patience, Port};

/// The line by which a board says, after M115, that its host may pack.
const KNOWS_PACKING: &str = "Cap:MEATPACK:1";

/// In the board's answer to M115, and in no other line.
const NAME: &str = "FIRMWARE_NAME";

/// The form in which lines of G-code go to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// Text.
    Plain,
    /// MeatPack: two characters in a byte.
    MeatPack,
}

impl Packing {
    /// The bytes of a line.
    pub(super) fn bytes(self, line: &str) -> Vec<u8> {
        match self {
            Self::Plain => line.as_bytes().to_vec(),
            Self::MeatPack => {
                let mut bytes = Vec::with_capacity(line.len());
                meatpack::pack(line, |byte| bytes.push(byte));
                bytes
            }
        }
    }
}

/// Asks the board whether it knows MeatPack, and switches it on if it does; `hear` hears what it says.
///
/// # Errors
/// The board does not answer, or is gone.
pub fn begin_packing(
    port: &mut impl Port,
    patience: Patience,
    mut hear: impl FnMut(&str),
) -> Result<Packing, SendError> {
    // An earlier host may have left it on, and a line unfinished.
    port.send(&meatpack::END)?;
    port.send(b"\nM115\n")?;
    let (mut is_known, mut is_named) = (false, false);
    let mut nameless_until = None;
    loop {
        let until = nameless_until.unwrap_or(port.now() + patience.give_up);
        let Some(said) = port.receive(until)? else {
            // A board without an answer to M115 has at least an `ok` for it.
            if nameless_until.is_some() {
                break;
            }
            return Err(SendError::Silent(vec!["(nothing after M115)".to_owned()]));
        };
        hear(&said);
        is_named |= said.contains(NAME);
        is_known |= said == KNOWS_PACKING;
        if said.starts_with("ok") {
            if is_named {
                break;
            }
            // It may answer the unfinished line, which a board that does not know packing has ended with bytes that it cannot
            // read. If it were taken for M115's, every line would be sent before the one before it is executed.
            nameless_until = Some(port.now() + patience.repeat);
        }
    }
    if !is_known {
        return Ok(Packing::Plain);
    }
    port.send(&meatpack::BEGIN)?;
    let on = meatpack::Settings { packing: true, no_spaces: false }.to_string();
    // Reports of the commands before it come first.
    while let Some(said) = receive(port, patience.give_up)? {
        hear(&said);
        if said == on {
            return Ok(Packing::MeatPack);
        }
    }
    Err(SendError::Silent(vec![format!("(no {on:?} after MeatPack was switched on)")]))
}

/// The board's next line, if it comes in time.
fn receive(port: &mut impl Port, patience: Duration) -> io::Result<Option<String>> {
    let until = port.now() + patience;
    port.receive(until)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::send::scripted::Scripted;

    const NAMES: &str = "FIRMWARE_NAME:Other 1.0 (2020) MACHINE_TYPE:Mill";

    /// What begins with a printer that answers the bytes that end packing, and M115; and its lines that were not heard.
    fn begin(to_end: &[&'static str], to_m115: &[&'static str]) -> (Result<Packing, SendError>, usize) {
        let mut port = Scripted::new(|line: &str, _| match line {
            "M115" => to_m115.to_vec(),
            line if line.chars().any(|char| char.is_ascii_alphabetic()) => panic!("{line}"),
            _ => to_end.to_vec(),
        });
        let packing = begin_packing(&mut port, Patience::DEFAULT, |_| {});
        (packing, port.unheard())
    }

    #[test]
    fn the_answer_to_the_bytes_before_is_not_that_to_m115() {
        for to_end in [&[][..], &["ok"], &["echo:Unknown command: \"\"", "ok"]] {
            let (packing, unheard) = begin(to_end, &[NAMES, "Cap:MEATPACK:0", "ok"]);
            assert_eq!((packing.unwrap(), unheard), (Packing::Plain, 0), "{to_end:?}");
            // Klipper's form.
            let (packing, unheard) = begin(to_end, &["ok FIRMWARE_NAME:Klipper"]);
            assert_eq!((packing.unwrap(), unheard), (Packing::Plain, 0), "{to_end:?}");
        }
    }

    #[test]
    fn a_printer_that_does_not_know_m115_gets_text() {
        let (packing, unheard) = begin(&["ok"], &["echo:Unknown command: \"M115\"", "ok"]);
        assert_eq!((packing.unwrap(), unheard), (Packing::Plain, 0));
        let (packing, _) = begin(&[], &[]);
        assert!(matches!(packing, Err(SendError::Silent(_))));
    }
}
