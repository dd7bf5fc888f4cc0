//! Assembles a black box from the lines in which a board sends it (M791).

use std::fmt;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use ferrostep_black_box::{END, PREFIX};

/// Reason why lines are not a black box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinesError {
    /// The line with this number is damaged.
    Damaged(u32),
    /// The line with this number is missing.
    Missing(u32),
    /// The last line is missing.
    Unfinished,
    /// The text has no line of a black box.
    None,
}

impl fmt::Display for LinesError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged(number) => write!(out, "line {number} of the black box is damaged: fetch it again"),
            Self::Missing(number) => write!(out, "line {number} of the black box is missing: fetch it again"),
            Self::Unfinished => out.write_str("the black box breaks off: fetch it again"),
            Self::None => out.write_str(
                "not a black box: expected a file that `ferrostep blackbox -o` has written, or a terminal's log with the answer \
                 to M791",
            ),
        }
    }
}

impl std::error::Error for LinesError {}

/// Assembles the lines as they arrive; other lines may come in between.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    bytes: Vec<u8>,
    next: u32,
}

impl Assembly {
    /// Takes a line. Returns `None` if it is not part of a black box, `Some(true)` if it is the
    /// last line, otherwise `Some(false)`. A line of a terminal's log may have other text before
    /// it.
    ///
    /// # Errors
    /// [`LinesError`]
    pub fn take(&mut self, line: &str) -> Result<Option<bool>, LinesError> {
        let Some((_, line)) = line.split_once(PREFIX) else { return Ok(None) };
        let damaged = LinesError::Damaged(self.next);
        let (place, contents) = line.trim_end().split_once(':').ok_or(damaged)?;
        let number = if place == END { contents } else { place };
        let number: u32 = number.parse().map_err(|_| damaged)?;
        if place != END && number == 0 {
            // The board starts to send the black box again.
            *self = Self::default();
        }
        if number != self.next {
            return Err(LinesError::Missing(self.next));
        }
        if place == END {
            return Ok(Some(true));
        }
        BASE64_STANDARD.decode_vec(contents, &mut self.bytes).map_err(|_| damaged)?;
        self.next += 1;
        Ok(Some(false))
    }

    /// Returns true once the first line has arrived.
    pub const fn is_begun(&self) -> bool {
        self.next > 0
    }

    /// Returns the bytes assembled so far.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// Extracts the last whole black box from a text.
///
/// # Errors
/// [`LinesError`]: the text contains no whole black box.
pub fn from_text(text: &str) -> Result<Vec<u8>, LinesError> {
    let mut assembly = Assembly::default();
    let mut last = Err(LinesError::None);
    for line in text.lines() {
        match assembly.take(line) {
            Ok(None) => {}
            Ok(Some(true)) => last = Ok(std::mem::take(&mut assembly).into_bytes()),
            Ok(Some(false)) => {
                if last == Err(LinesError::None) {
                    last = Err(LinesError::Unfinished);
                }
            }
            Err(error) => {
                assembly = Assembly::default();
                // Errors after the first follow from it.
                if matches!(last, Err(LinesError::None | LinesError::Unfinished)) {
                    last = Err(error);
                }
            }
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_log_may_hold_several() {
        let log = "Recv: start\nRecv: blackbox:0:AAAA\nSend: M791\nRecv: ok\nRecv: blackbox:0:RkJY\r\n T:20\nRecv: blackbox:1:MQ==\n\
                   Recv: blackbox:end:2\nRecv: blackbox:0:AAAA\n";
        assert_eq!(from_text(log), Ok(b"FBX1".to_vec()));
        assert_eq!(from_text("T:20\n"), Err(LinesError::None));
        assert_eq!(from_text("blackbox:0:AAAA\n"), Err(LinesError::Unfinished));
        assert_eq!(from_text("blackbox:0:AAAA\nblackbox:2:AAAA\nblackbox:end:3"), Err(LinesError::Missing(1)));
        assert_eq!(from_text("blackbox:0:AA!A\n"), Err(LinesError::Damaged(0)));
    }

    proptest! {
        #[test]
        fn anything_can_be_in_a_log(lines in prop::collection::vec("(.{0,20}|blackbox:[0-9e].{0,20}|blackbox:(0|1|end):[A-Za-z0-9+/=]{0,8})", 0..20)) {
            let _ = from_text(&lines.join("\n"));
        }
    }
}
