//! The lines of a black box, put together.

use std::fmt;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use ferrostep_black_box::{END, PREFIX};

/// Reason for which lines are not a black box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinesError {
    /// A damaged line.
    Damaged(u32),
    /// A line that is missing before this one.
    Missing(u32),
    /// The last line has not arrived.
    Unfinished,
    /// No line belongs to a black box.
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

/// Assembles the lines as they arrive; others may arrive in between.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    bytes: Vec<u8>,
    next: u32,
}

impl Assembly {
    /// Takes a line: `None` if it belongs to something else, else whether it is the last. A
    /// terminal's log may have text before it.
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
            // The board sends the black box again.
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

    /// Returns true once a line has come.
    pub const fn is_begun(&self) -> bool {
        self.next > 0
    }

    /// The bytes.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// The bytes of the last whole black box in a text.
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
