//! Bytes in portions: the lines must be the same as from one portion, and the emergency scanner
//! must agree with the parser about every line it acts on.
#![no_main]

use ferrostep_gcode::{
    Checksum, Command, Emergency, EmergencyScanner, LineError, LineNumbers, LineReader, Reply, Verdict, parse,
};
use libfuzzer_sys::fuzz_target;

/// A line or the reason it was refused, free of borrows.
#[derive(Debug, PartialEq)]
enum Read {
    Line(u32, String, Option<i64>, Checksum),
    Refused(LineError),
}

fn read<'a>(portions: impl Iterator<Item = &'a [u8]>) -> (Vec<Read>, LineNumbers) {
    let mut reader = LineReader::new();
    let mut numbers = LineNumbers::new();
    let mut lines = Vec::new();
    let mut take = |line: Result<ferrostep_gcode::Line<'_>, LineError>| {
        let verdict = match &line {
            Ok(line) => Some(numbers.check(line)),
            Err(error) => numbers.check_unreadable(error),
        };
        if let Some(Verdict::Resend(reason, last)) = verdict {
            assert!(Reply::Resend { reason, last }.to_string().ends_with("\nok"));
        }
        lines.push(match line {
            Ok(line) => Read::Line(line.line_number, line.text.to_owned(), line.number, line.checksum),
            Err(error) => Read::Refused(error),
        });
    };
    for portion in portions {
        let mut rest = portion;
        while !rest.is_empty() {
            let (consumed, line) = reader.feed(rest);
            assert!(consumed > 0 && (line.is_some() || consumed == rest.len()));
            rest = &rest[consumed..];
            if let Some(line) = line {
                take(line);
            }
        }
    }
    if let Some(line) = reader.finish() {
        take(line);
    }
    (lines, numbers)
}

fuzz_target!(|data: &[u8]| {
    let Some((&size, bytes)) = data.split_first() else { return };
    let whole = read(std::iter::once(bytes));
    assert_eq!(whole, read(bytes.chunks(usize::from(size).max(1))));

    let mut scanner = EmergencyScanner::new();
    for line in bytes.split_inclusive(|&byte| byte == b'\n' || byte == b'\r') {
        let mut reader = LineReader::new();
        let in_turn = match reader.feed(line).1 {
            Some(Ok(line)) => match parse(line.text) {
                Ok(Command::EndWait) => Some(Emergency::EndWait),
                Ok(Command::EmergencyStop) => Some(Emergency::Stop),
                Ok(Command::QuickStop) => Some(Emergency::QuickStop),
                _ => None,
            },
            // A line number of hundreds of digits, or a checksum that is not text.
            Some(Err(_)) => continue,
            None => None,
        };
        for &byte in line {
            match scanner.feed(byte) {
                None | Some(Emergency::PromptAnswer(_)) => {}
                early => assert_eq!(early, in_turn),
            }
        }
    }
});
