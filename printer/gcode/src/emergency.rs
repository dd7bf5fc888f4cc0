//! Commands that act as their bytes arrive, ahead of all queues.

use crate::Checksum;
use crate::line::ChecksumScan;

/// A command that does not wait its turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Emergency {
    /// M108: end a wait.
    EndWait,
    /// M112: stop everything.
    Stop,
    /// M410: drop all motion.
    QuickStop,
    /// M876 S: answer to a prompt, the number of the button.
    PromptAnswer(u8),
}

/// Watches the bytes of one port for M108, M112, M410 and M876 S.
///
/// M112 acts at once whatever follows it, unless a digit or point makes it another command: the
/// parser reads the same lines as M112 in their turn, and a stop should not depend on its spelling,
/// nor wait until a garbled line has been sent again. The others act only as whole lines. With a
/// line number they wait for their checksum, because a single wrong bit turns the `M400` of a print
/// into `M410`; without one they act at once.
///
/// Blanks, an `N` word in front, and a checksum or comment after it do not matter. `M1121`,
/// `M112.5` and `M117 M112` are not M112. A `(` comment in front makes the line an ordinary one,
/// which still acts in its turn.
///
/// The bytes still go to the [`LineReader`](crate::LineReader): the host expects its `ok`.
#[derive(Clone, Copy, Debug)]
pub struct EmergencyScanner {
    state: State,
    /// The line begins with its number.
    is_numbered: bool,
    /// A comment has begun after a checksum.
    checksum_is_over: bool,
    checksum: ChecksumScan,
}

impl Default for EmergencyScanner {
    fn default() -> Self {
        Self::new()
    }
}

/// The part of the line so far.
#[derive(Clone, Copy, Debug, Default)]
enum State {
    /// Blanks.
    #[default]
    Start,
    /// N; whether a sign or digits have come.
    Number(Sign),
    /// N and its number, then blanks.
    AfterNumber,
    /// M, then perhaps blanks.
    Letter,
    /// M and digits.
    Code(u16),
    /// M876, then perhaps blanks.
    Prompt,
    /// M876 S, then perhaps blanks.
    PromptLetter,
    /// M876 S and digits.
    PromptDigits(u8),
    /// A whole command, then blanks.
    Whole(Emergency),
    /// A whole command, then a checksum or a comment.
    Suffix(Emergency),
    /// Some other line.
    Other,
}

/// The part of a line number so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sign {
    /// Only blanks after N so far.
    Open,
    /// A minus sign.
    Minus,
    /// Digits.
    Digits,
}

impl EmergencyScanner {
    /// A scanner at the start of a line.
    pub const fn new() -> Self {
        EmergencyScanner {
            state: State::Start,
            is_numbered: false,
            checksum_is_over: false,
            checksum: ChecksumScan::new(),
        }
    }

    /// Takes the next byte; the `\n` or `\r` that ends such a command returns it.
    pub fn feed(&mut self, byte: u8) -> Option<Emergency> {
        if byte == b'\n' || byte == b'\r' {
            let line = core::mem::take(self);
            let emergency = match line.state {
                State::Whole(emergency) | State::Suffix(emergency) => emergency,
                State::Code(number) => command(number)?,
                State::PromptDigits(answer) => Emergency::PromptAnswer(answer),
                _ => return None,
            };
            let may_act =
                emergency == Emergency::Stop || !line.is_numbered || line.checksum.verdict() == Checksum::Right;
            return may_act.then_some(emergency);
        }
        if !matches!(self.state, State::Other) {
            self.state = next(self.state, byte);
            self.is_numbered |= matches!(self.state, State::Number(_));
            // A checksum comes before the comment or, if it is not there, at its end.
            self.checksum_is_over |= byte == b';' && self.checksum.has_star();
            if !self.checksum_is_over {
                self.checksum.extend(&[byte]);
            }
        }
        None
    }
}

fn command(number: u16) -> Option<Emergency> {
    match number {
        108 => Some(Emergency::EndWait),
        112 => Some(Emergency::Stop),
        410 => Some(Emergency::QuickStop),
        _ => None,
    }
}

fn next(state: State, byte: u8) -> State {
    let digit = byte.wrapping_sub(b'0');
    match (state, byte) {
        (State::Start, b' ' | b'\t') => State::Start,
        (State::Start, b'N' | b'n') => State::Number(Sign::Open),
        (State::Number(Sign::Open), b' ' | b'\t') => State::Number(Sign::Open),
        (State::Number(Sign::Open), b'-') => State::Number(Sign::Minus),
        (State::Number(_), b'0'..=b'9') => State::Number(Sign::Digits),
        (State::Number(Sign::Digits) | State::AfterNumber, b' ' | b'\t') => State::AfterNumber,
        (State::Start | State::Number(Sign::Digits) | State::AfterNumber, b'M' | b'm') => State::Letter,
        (State::Letter, b' ' | b'\t') => State::Letter,
        (State::Letter, b'0'..=b'9') => State::Code(u16::from(digit)),
        (State::Code(number), b'0'..=b'9') => {
            // Saturates at a number that no command has.
            State::Code(number.saturating_mul(10).saturating_add(u16::from(digit)))
        }
        (State::Code(876), b' ' | b'\t') => State::Prompt,
        (State::Prompt, b' ' | b'\t') => State::Prompt,
        (State::Code(876) | State::Prompt, b'S' | b's') => State::PromptLetter,
        (State::PromptLetter, b' ' | b'\t') => State::PromptLetter,
        (State::PromptLetter, b'0'..=b'9') => State::PromptDigits(digit),
        (State::PromptDigits(answer), b'0'..=b'9') => {
            match answer.checked_mul(10).and_then(|tens| tens.checked_add(digit)) {
                Some(answer) => State::PromptDigits(answer),
                None => State::Other,
            }
        }
        (State::PromptDigits(answer), _) => after(Emergency::PromptAnswer(answer), byte),
        (State::Code(number), _) => match command(number) {
            Some(emergency) => after(emergency, byte),
            None => State::Other,
        },
        (State::Whole(emergency), _) => after(emergency, byte),
        (State::Suffix(emergency), _) => State::Suffix(emergency),
        _ => State::Other,
    }
}

/// The state when `byte` follows a whole command.
fn after(emergency: Emergency, byte: u8) -> State {
    match byte {
        b' ' | b'\t' => State::Whole(emergency),
        b'*' | b';' => State::Suffix(emergency),
        // Any text, except what would make it another number.
        b'!'..=b'~' if emergency == Emergency::Stop && byte != b'.' => State::Suffix(emergency),
        _ => State::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Command, LineReader, parse};
    use proptest::prelude::*;

    fn scan(bytes: &[u8]) -> Vec<Emergency> {
        let mut scanner = EmergencyScanner::new();
        bytes.iter().filter_map(|&byte| scanner.feed(byte)).collect()
    }

    #[test]
    fn whole_lines_act() {
        for (line, expected) in [
            ("M112\n", Emergency::Stop),
            ("M112\r\n", Emergency::Stop),
            ("  m112 \t\n", Emergency::Stop),
            ("M0112\n", Emergency::Stop),
            ("N12 M112*45\n", Emergency::Stop),
            ("N12M112*45\n", Emergency::Stop),
            ("N-1 M112 *45\n", Emergency::Stop),
            ("M112 ; stop M108\n", Emergency::Stop),
            ("M112;\r", Emergency::Stop),
            ("M108\n", Emergency::EndWait),
            ("M410*1\n", Emergency::QuickStop),
            ("M112 now!\n", Emergency::Stop),
            ("M112)\n", Emergency::Stop),
            ("M112b\n", Emergency::Stop),
            ("M112G4 P1\n", Emergency::Stop),
            ("N5 M112 5*1\n", Emergency::Stop),
            ("M876 S0\n", Emergency::PromptAnswer(0)),
            ("M876 S 255\n", Emergency::PromptAnswer(255)),
        ] {
            assert_eq!(scan(line.as_bytes()), [expected], "{line:?}");
        }
        assert_eq!(
            scan(b"G1 X5\nM108\n\nM410\nM112"),
            [Emergency::EndWait, Emergency::QuickStop],
            "the last line has not ended"
        );
    }

    #[test]
    fn other_lines_do_not() {
        for line in [
            "M1121",
            "M112.5",
            "XM112",
            "M117 M112",
            "M11 2",
            "M108 x",
            "M410M108",
            "M112.",
            "N M112",
            "N- M112",
            "N1.5 M112",
            "N1 N2 M112",
            "; M112",
            "*M112",
            "M876",
            "M876 P1",
            "M876 S",
            "M876 S256",
            "M876 S1 P1",
            "M65648",
            "M4294967408",
            "M-112",
            "G112",
            "M",
            "",
            "M112\0",
        ] {
            assert_eq!(scan(format!("{line}\n").as_bytes()), [], "{line:?}");
        }
    }

    /// A bit that changed on the line must not drop the motion of a print.
    #[test]
    fn numbered_commands_except_m112_wait_for_the_checksum() {
        let sum = |text: &str| text.bytes().fold(0, |sum, byte| sum ^ byte);
        for (text, emergency) in [
            ("N12 M410", Emergency::QuickStop),
            (" n-3m108", Emergency::EndWait),
            ("N5 M876 S1", Emergency::PromptAnswer(1)),
        ] {
            let checksum = sum(text);
            assert_eq!(scan(format!("{text}*{checksum}\n").as_bytes()), [emergency], "{text}");
            assert_eq!(scan(format!("{text} *{}  \r", sum(&format!("{text} "))).as_bytes()), [emergency], "{text}");
            assert_eq!(scan(format!("{text}*{checksum};x*3\n").as_bytes()), [emergency], "{text}");
            let commented = format!("{text} ; stop");
            assert_eq!(scan(format!("{commented}*{}\n", sum(&commented)).as_bytes()), [emergency], "{text}");
            for line in [format!("{text}*{}\n", checksum ^ 1), format!("{text}\n"), format!("{text}*\n")] {
                assert_eq!(scan(line.as_bytes()), [], "{line:?}");
            }
        }
        let m400 = "N12 M400";
        assert_eq!(scan(format!("N12 M410*{}\n", sum(m400)).as_bytes()), []);
        // The next line begins anew.
        assert_eq!(scan(format!("{m400}*{}\nM410\n", sum(m400)).as_bytes()), [Emergency::QuickStop]);
    }

    proptest! {
        /// Every line that the parser reads as M112 has acted before, except after a
        /// comment in brackets.
        #[test]
        fn m112_never_waits_its_turn(text in "[Nn]?-?[0-9 ]{0,3}[ \t]?[Mm][ ]?0?1?1?[12]?[ -~]{0,6}") {
            let bytes = format!("{text}\n");
            let mut reader = LineReader::new();
            let Some(Ok(line)) = reader.feed(bytes.as_bytes()).1 else { return Ok(()) };
            if parse(line.text) == Ok(Command::EmergencyStop) && !text.contains('(') {
                prop_assert_eq!(scan(bytes.as_bytes()), [Emergency::Stop]);
            }
        }

        #[test]
        fn what_acts_early_is_the_same_command_in_its_turn(
            text in "[Nn]?-?[0-9 ]{0,3}[ \t]?[Mm][ ]?0?(108|112|410|[0-9.]{0,4})[ xS*;(.0-9]{0,4}"
        ) {
            let bytes = format!("{text}\n");
            let mut reader = LineReader::new();
            let in_turn = match reader.feed(bytes.as_bytes()).1 {
                Some(Ok(line)) => match parse(line.text) {
                    Ok(Command::EndWait) => Some(Emergency::EndWait),
                    Ok(Command::EmergencyStop) => Some(Emergency::Stop),
                    Ok(Command::QuickStop) => Some(Emergency::QuickStop),
                    _ => None,
                },
                _ => None,
            };
            for emergency in scan(bytes.as_bytes()) {
                if !matches!(emergency, Emergency::PromptAnswer(_)) {
                    prop_assert_eq!(Some(emergency), in_turn);
                }
            }
        }
    }
}
