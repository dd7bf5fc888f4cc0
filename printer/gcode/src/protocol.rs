//! Line numbers and checksums of the serial protocol: which lines are executed, and which are
//! requested again.

use crate::line::ChecksumScan;
use crate::{Checksum, Command, Line, LineError, ResendReason, parse};

/// Treatment of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Execute it and answer `ok`.
    Execute,
    /// The line was executed already: answer `ok` only.
    Repeat,
    /// Request the line after the last good one, whose number is the second field.
    Resend(ResendReason, i64),
}

/// The last good line number of one port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineNumbers {
    last: i64,
}

impl LineNumbers {
    /// Line 1 comes next.
    pub const fn new() -> Self {
        LineNumbers { last: 0 }
    }

    /// Number of the last good line, or what M110 set.
    pub const fn last(&self) -> i64 {
        self.last
    }

    /// Decides about a line and, if it is good, remembers its number.
    ///
    /// A line without a number is good, unless it is what is left of a numbered line whose
    /// beginning was damaged: after a line with a number, one whose checksum is wrong. Executed,
    /// it would be an unknown command, or another one. M110 takes effect here, so that the lines
    /// after it are checked against the new number: `N12 M110 N5` makes 5 the last number,
    /// `N12 M110` makes it 12, and `M110` alone changes nothing. It is exempt from the sequence
    /// but not from the checksum.
    ///
    /// The number is checked before the checksum, as hosts expect from the error that they read. A
    /// line counts as repeated only if its checksum is right too: a garbled number must not make a
    /// new line pass for an old one.
    pub fn check(&mut self, line: &Line<'_>) -> Verdict {
        if line.number.is_none() && self.last > 0 && has_lost_its_number(line.text) {
            return Verdict::Resend(ResendReason::NoNumber, self.last);
        }
        self.judge(line.number, line.checksum, line_number_command(line.text))
    }

    fn judge(&mut self, number: Option<i64>, checksum: Checksum, line_number_command: Option<Option<i64>>) -> Verdict {
        let Some(number) = number else {
            if let Some(Some(new)) = line_number_command {
                self.last = new;
            }
            return Verdict::Execute;
        };
        let repeated = number == self.last || self.last.checked_sub(1).is_some_and(|before| number == before);
        let in_sequence = self.last.checked_add(1) == Some(number);
        if line_number_command.is_none() && !in_sequence && !repeated {
            return Verdict::Resend(ResendReason::WrongNumber, self.last);
        }
        match checksum {
            Checksum::Right => {}
            Checksum::Absent => return Verdict::Resend(ResendReason::NoChecksum, self.last),
            Checksum::Wrong { .. } | Checksum::Malformed => {
                return Verdict::Resend(ResendReason::WrongChecksum, self.last);
            }
        }
        match line_number_command {
            Some(new) => self.last = new.unwrap_or(number),
            None if repeated => return Verdict::Repeat,
            None => self.last = number,
        }
        Verdict::Execute
    }

    /// Decides about a line that could not be read. `None`: it is answered by a notice and `ok`.
    ///
    /// One that began with a number, or has lost it as its checksum shows, is requested again as if
    /// its checksum had failed, unless its checksum says that it came as the host sent it: it would
    /// come the same again, endlessly. Its number counts then as that of a good line.
    pub fn check_unreadable(&mut self, error: &LineError) -> Option<Verdict> {
        if let Some(number) = error.number_of_whole_line() {
            let verdict = self.judge(Some(number), Checksum::Right, None);
            return (verdict != Verdict::Execute).then_some(verdict);
        }
        let reason = if error.is_numbered() { ResendReason::WrongChecksum } else { ResendReason::NoNumber };
        let is_damaged = error.is_numbered() || self.last > 0 && error.has_lost_its_number();
        is_damaged.then_some(Verdict::Resend(reason, self.last))
    }
}

/// True if a line is an `N` without a number, or ends in a checksum that is not that of its text.
fn has_lost_its_number(text: &str) -> bool {
    if matches!(text, "N" | "n") {
        return true;
    }
    if !text.contains('*') {
        return false;
    }
    let mut scan = ChecksumScan::new();
    scan.extend(text.as_bytes());
    matches!(scan.verdict(), Checksum::Wrong { .. })
}

/// The N word of an M110 (`Some(None)` without one); `None` for every other command.
fn line_number_command(text: &str) -> Option<Option<i64>> {
    // Nearly every line is another command and should not be parsed twice.
    if !matches!(text.as_bytes().first(), Some(b'M' | b'm')) {
        return None;
    }
    match parse(text) {
        Ok(Command::SetLineNumber(number)) => Some(number),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::LineReader;

    /// Judges the lines of `text` in turn.
    fn judge(numbers: &mut LineNumbers, text: &str) -> Vec<Verdict> {
        let mut reader = LineReader::new();
        let mut rest = text.as_bytes();
        let mut verdicts = Vec::new();
        while !rest.is_empty() {
            let (consumed, line) = reader.feed(rest);
            rest = &rest[consumed..];
            match line {
                Some(Ok(line)) => verdicts.push(numbers.check(&line)),
                Some(Err(error)) => verdicts.extend(numbers.check_unreadable(&error)),
                None => {}
            }
        }
        verdicts
    }

    /// `text` with its checksum and a line end.
    fn with_checksum(text: &str) -> String {
        format!("{text}*{}\n", text.bytes().fold(0, |sum, byte| sum ^ byte))
    }

    /// Whatever one byte of a numbered line becomes: the line is executed as it was sent, or
    /// asked for again.
    #[test]
    fn a_line_with_a_damaged_byte_is_asked_for_again() {
        for command in ["G1 Z.2", "M117 10*3", "G1 X10 Y20 E0.5 F1200", "T0", "RESPOND MSG=5*3"] {
            let sent = with_checksum(&format!("N15 {command}"));
            for at in 0..sent.len() - 1 {
                for byte in (0..=255_u8).filter(|&byte| byte != sent.as_bytes()[at]) {
                    let mut reader = LineReader::new();
                    let mut numbers = LineNumbers { last: 14 };
                    let (mut damaged, mut asks, mut answers, mut rest) = (sent.clone().into_bytes(), 0, 0, 0);
                    damaged[at] = byte;
                    while rest < damaged.len() {
                        let (consumed, line) = reader.feed(&damaged[rest..]);
                        rest += consumed;
                        let (verdict, text) = match line {
                            Some(Ok(line)) => (Some(numbers.check(&line)), line.text.to_owned()),
                            Some(Err(error)) => (numbers.check_unreadable(&error), String::new()),
                            None => break,
                        };
                        answers += 1;
                        match verdict {
                            Some(Verdict::Resend(_, 14)) => asks += 1,
                            // A piece of a line that was cut in two may hold no command.
                            _ if text == command || text.bytes().all(|byte| byte == b'N' || byte.is_ascii_digit()) => {}
                            verdict => panic!("{:?}: {verdict:?}", String::from_utf8_lossy(&damaged)),
                        }
                    }
                    // A comment is not answered, and sent again after a while.
                    let is_safe = asks > 0 || answers == 0 || numbers.last() == 15;
                    assert!(is_safe, "{:?}", String::from_utf8_lossy(&damaged));
                }
            }
        }
    }

    #[test]
    fn lines_of_a_person_need_no_number() {
        let mut numbers = LineNumbers { last: 7 };
        for text in ["M117 10 * 3 =\n", "M118 a*300\n", "G1 X5*\n", "G28\n"] {
            assert_eq!(judge(&mut numbers, text), [Verdict::Execute], "{text}");
        }
        assert_eq!(judge(&mut LineNumbers::new(), "F98 G1 X5*3\n"), [Verdict::Execute]);
    }

    #[test]
    fn hosts_connect_with_m110() {
        let mut numbers = LineNumbers::new();
        let octoprint = "N0 M110 N0*125\nN0 M110 N0*125\nN0 M110 N0*125\nN1 M115*39\nM21\nM155 S2\nN0 M110 N0*125\n\
                         N1 M73 P0 R21*39\nN2 M73 Q0 S21*36\nN3 M201 X1000 Y1000 Z200 E5000*10\n";
        assert_eq!(judge(&mut numbers, octoprint), [Verdict::Execute; 10]);
        assert_eq!(numbers.last(), 3);
        let printcore = "M105\nN-1 M110 N-1*125\nN0 M73 P0 R21*38\nN1 M73 Q0 S21*39\n";
        assert_eq!(judge(&mut numbers, printcore), [Verdict::Execute; 4]);
        assert_eq!(numbers.last(), 1);
        let with_comments = "N0 M110 N0*125\nN1 M73 P0 R21*39\nN2 M73 Q0 S21*36\n\
                             N3 M201 X1000 Y1000 Z200 E5000 ; sets maximum accelerations, mm/sec^2*3\n\
                             N4 M203 X200 Y200 Z12 E60 ; sets maximum feedrates, mm / sec*90\n";
        assert_eq!(judge(&mut numbers, with_comments), [Verdict::Execute; 5]);
        assert_eq!(numbers.last(), 4);
    }

    #[test]
    fn wrong_lines_are_requested_again() {
        let mut numbers = LineNumbers { last: 10 };
        use ResendReason::*;
        for (text, reason) in [
            (with_checksum("N12 G28"), WrongNumber),
            (with_checksum("N8 G28"), WrongNumber),
            ("N12 G28*1\n".into(), WrongNumber),
            ("N11 G28*1\n".into(), WrongChecksum),
            ("N11 G28*x\n".into(), WrongChecksum),
            ("N11 G28\n".into(), NoChecksum),
            ("N10 G28*1\n".into(), WrongChecksum),
            ("N3 M110 N3\n".into(), NoChecksum),
            ("N3 M110 N3*1\n".into(), WrongChecksum),
            (format!("N11 G1 {}\n", "x".repeat(300)), WrongChecksum),
            (format!("N11 G1 {}*1\n", "x".repeat(300)), WrongChecksum),
            (with_checksum(&format!("N12 G1 {}", "x".repeat(300))), WrongNumber),
            ("N11 G28\u{1}*1\n".into(), WrongChecksum),
        ] {
            assert_eq!(judge(&mut numbers, &text), [Verdict::Resend(reason, 10)], "{text:?}");
        }
        assert_eq!(judge(&mut numbers, "G28\u{1}\n"), []);
        assert_eq!(judge(&mut numbers, &with_checksum("N11 G28")), [Verdict::Execute]);
        assert_eq!(judge(&mut numbers, &with_checksum("N11 G28")), [Verdict::Repeat]);
        assert_eq!(judge(&mut numbers, &with_checksum("N10 G28")), [Verdict::Repeat]);
        assert_eq!(numbers.last(), 11);
    }

    /// Lines that can never be read, though they come as they were sent: a host that is asked for
    /// them again gives up.
    #[test]
    fn a_whole_line_that_cannot_be_read_is_not_requested_again() {
        let mut numbers = LineNumbers { last: 10 };
        let long = with_checksum(&format!("N11 G1 {}", "x".repeat(300)));
        assert_eq!(judge(&mut numbers, &long), []);
        assert_eq!(judge(&mut numbers, &long), [Verdict::Repeat]);
        assert_eq!(judge(&mut numbers, &with_checksum("N12 G28\u{1}")), []);
        assert_eq!(judge(&mut numbers, &with_checksum(&format!("N13 M117 {}", "x".repeat(300)))), [Verdict::Execute]);
        assert_eq!(judge(&mut numbers, &with_checksum("N14 M118 \u{7f}")), [Verdict::Execute]);
        assert_eq!(numbers.last(), 14);
    }

    #[test]
    fn m110_in_all_its_forms() {
        for (text, last) in [
            (with_checksum("N12 M110 N5"), 5),
            (with_checksum("N12 M110"), 12),
            (with_checksum("N12 M110 ; x"), 12),
            ("M110 N7\n".into(), 7),
            ("m110n-3\n".into(), -3),
            ("M110\n".into(), 99),
            ("M1100 N3\n".into(), 99),
            ("M117 M110 N3\n".into(), 99),
        ] {
            let mut numbers = LineNumbers { last: 99 };
            assert_eq!(judge(&mut numbers, &text), [Verdict::Execute], "{text:?}");
            assert_eq!(numbers.last(), last, "{text:?}");
        }
    }

    #[test]
    fn the_ends_of_the_range() {
        let mut numbers = LineNumbers { last: i64::MAX };
        let text = with_checksum("N99999999999999999999 G28");
        assert_eq!(judge(&mut numbers, &text), [Verdict::Repeat]);
        let mut numbers = LineNumbers { last: i64::MIN };
        assert_eq!(judge(&mut numbers, &text), [Verdict::Resend(ResendReason::WrongNumber, i64::MIN)]);
    }
}
