//! A job without some of its commands.

use std::io::{self, Read};

use ferrostep_session::command_code::code;

/// Commands to leave out.
#[derive(Clone, Debug)]
pub(crate) struct Dropped {
    commands: Vec<&'static str>,
    longest: usize,
}

impl Dropped {
    pub fn new(commands: Vec<&'static str>) -> Self {
        // One more character distinguishes M20 from M201.
        let longest = commands.iter().map(|command| command.len() + 1).max().unwrap_or(0);
        Self { commands, longest }
    }

    fn contains(&self, line: &[u8]) -> bool {
        let text = std::str::from_utf8(line).unwrap_or_default();
        self.commands.iter().any(|command| command.eq_ignore_ascii_case(code(text)))
    }
}

/// Position of the reader in a line.
enum Place {
    /// At the beginning of a line: the characters so far, without spaces before them.
    Start(Vec<u8>),
    /// The rest of a line that stays.
    Kept,
    /// The rest of a line whose text is left out.
    Dropped,
}

/// Text of a job whose lines with some commands are empty, so that all others keep their numbers.
pub(crate) struct WithoutCommands<'a, R> {
    inner: R,
    dropped: &'a Dropped,
    place: Place,
    lines_dropped: u64,
    /// Bytes that have been read and not returned yet.
    ready: Vec<u8>,
}

impl<'a, R: Read> WithoutCommands<'a, R> {
    pub fn new(inner: R, dropped: &'a Dropped) -> Self {
        Self { inner, dropped, place: Place::Start(Vec::new()), lines_dropped: 0, ready: Vec::new() }
    }

    pub fn lines_dropped(&self) -> u64 {
        self.lines_dropped
    }

    /// The beginning of a line is known: it stays, or its text is left out.
    fn decide(&mut self, start: &[u8]) -> Place {
        if self.dropped.contains(start) {
            self.lines_dropped += 1;
            Place::Dropped
        } else {
            self.ready.extend_from_slice(start);
            Place::Kept
        }
    }

    fn take(&mut self, byte: u8) {
        let ends_line = matches!(byte, b'\n' | b'\r');
        let place = std::mem::replace(&mut self.place, Place::Kept);
        let place = match place {
            Place::Start(start) if start.is_empty() && matches!(byte, b' ' | b'\t') => Place::Start(start),
            Place::Start(mut start) if !ends_line && start.len() < self.dropped.longest => {
                start.push(byte);
                Place::Start(start)
            }
            Place::Start(start) => self.decide(&start),
            other => other,
        };
        self.place = match place {
            Place::Start(start) => Place::Start(start),
            decided => {
                if ends_line || matches!(decided, Place::Kept) {
                    self.ready.push(byte);
                }
                if ends_line { Place::Start(Vec::new()) } else { decided }
            }
        };
    }
}

impl<R: Read> Read for WithoutCommands<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.ready.is_empty() {
            let length = self.inner.read(buffer)?;
            if length == 0 {
                if let Place::Start(start) = std::mem::replace(&mut self.place, Place::Kept) {
                    self.place = self.decide(&start);
                }
                break;
            }
            for &byte in buffer.iter().take(length) {
                self.take(byte);
            }
        }
        let length = self.ready.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.ready.drain(..length)) {
            *place = byte;
        }
        Ok(length)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    const COMMANDS: [&str; 2] = ["M204", "SET_VELOCITY_LIMIT"];

    fn without(text: &[u8], portion: usize) -> (Vec<u8>, u64) {
        let dropped = Dropped::new(COMMANDS.to_vec());
        let mut reader = WithoutCommands::new(text, &dropped);
        let (mut out, mut buffer) = (Vec::new(), vec![0; portion]);
        loop {
            let length = reader.read(&mut buffer).unwrap();
            if length == 0 {
                return (out, reader.lines_dropped());
            }
            out.extend_from_slice(&buffer[..length]);
        }
    }

    #[test]
    fn lines_with_these_commands_are_empty() {
        let text = "G1 X1\n M204 S500 ; now\nm204s1\r\nM2040\nM20\nset_velocity_limit ACCEL=5\nSET_VELOCITY\n\nM204";
        let expected = "G1 X1\n\n\r\nM2040\nM20\n\nSET_VELOCITY\n\n";
        for portion in [1, 2, 7, 1000] {
            let (left, dropped) = without(text.as_bytes(), portion);
            assert_eq!((String::from_utf8(left).unwrap().as_str(), dropped), (expected, 4), "{portion}");
        }
    }

    proptest! {
        #[test]
        fn all_other_lines_stay(lines in prop::collection::vec("[ -~]{0,40}", 0..20), portion in 1usize..50) {
            let lines: Vec<&str> = lines.iter().map(|line| line.trim_start()).collect();
            let has = |line: &str| COMMANDS.iter().any(|command| command.eq_ignore_ascii_case(code(line)));
            let expected: Vec<&str> = lines.iter().map(|line| if has(line) { "" } else { line }).collect();
            let (left, dropped) = without(lines.join("\n").as_bytes(), portion);
            prop_assert_eq!(String::from_utf8(left).unwrap(), expected.join("\n"));
            prop_assert_eq!(dropped, lines.iter().filter(|line| has(line)).count() as u64);
        }
    }
}
