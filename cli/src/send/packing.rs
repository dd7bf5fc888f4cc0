//! MeatPack on the way to a printer.

use std::io;
use std::time::Duration;

use ferrostep_gcode::meatpack;

use super::error::SendError;
use super::port::{Patience, Port};

/// The line by which a board says, after M115, that its host may pack.
const KNOWS_PACKING: &str = "Cap:MEATPACK:1";

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
