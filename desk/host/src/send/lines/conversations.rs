//! Tests hostile conversations: damaged bytes; lost, doubled or late lines and answers; printers
//! that restart their count.

#![allow(clippy::unwrap_used)]

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use ferrostep_random_cases::{Random, share_of};

use super::*;

/// Maximum number of lines in a conversation, to stop a host that repeats lines forever.
const MOST_LINES: usize = 3_000;

/// Mishap of a line or its answer.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mishap {
    /// One byte of the line changes.
    Damage,
    LineLost,
    AnswerLost,
    /// The answer comes after the host has stopped waiting for it.
    AnswerLate,
    /// The printer answers the line with `ok` twice.
    OkTwice,
    /// The printer executes this line but asks for an arbitrary other one.
    AsksForAnother,
    /// From here on the printer counts from another number, as after another host's M110.
    CountsAnew,
    /// From here on the printer is silent.
    Deaf,
}

/// Printer that counts lines as Marlin does, written from the protocol's description and without
/// this firmware's reader.
struct Printer {
    last: i64,
    executed: Vec<String>,
    /// True if a line with a checksum but no number makes the printer ask for it again; otherwise
    /// the line is an unknown command.
    asks_without_number: bool,
    /// True if the printer only answers a repeat of the last line; otherwise it asks for the next
    /// one.
    answers_repeats: bool,
    knows_m118: bool,
}

impl Printer {
    /// Takes a line's bytes and returns the printer's answer.
    fn take(&mut self, line: &[u8]) -> Vec<String> {
        let text = String::from_utf8_lossy(line).into_owned();
        let numbered = text.strip_prefix('N').and_then(|rest| {
            let digits = rest.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(rest.len());
            Some((rest[..digits].parse::<i64>().ok()?, rest[digits..].trim_start()))
        });
        let Some((number, rest)) = numbered else {
            if self.asks_without_number && text.contains('*') {
                return self.ask("No Line Number with checksum");
            }
            return vec![format!("echo:Unknown command: \"{text}\""), "ok".into()];
        };
        let Some((command, sum)) = rest.rsplit_once('*') else { return self.ask("No Checksum with line number") };
        let star = line.iter().rposition(|&byte| byte == b'*').unwrap();
        let is_right = sum.parse() == Ok(line[..star].iter().fold(0_u8, |sum, byte| sum ^ byte));
        if !is_right {
            return self.ask("checksum mismatch");
        }
        if let Some(new) = command.strip_prefix("M110 N") {
            self.last = new.parse().unwrap();
            return vec!["ok".into()];
        }
        if self.answers_repeats && number == self.last {
            return vec!["ok".into()];
        }
        if number != self.last + 1 {
            return self.ask("Line Number is not Last Line Number+1");
        }
        self.last = number;
        if let Some(text) = command.strip_prefix("M118 ") {
            return if self.knows_m118 { vec![text.into(), "ok".into()] } else { vec!["ok".into()] };
        }
        self.executed.push(command.into());
        vec!["ok".into()]
    }

    fn ask(&self, why: &str) -> Vec<String> {
        vec![format!("Error:{why}, Last Line: {}", self.last), format!("Resend: {}", self.last + 1), "ok".into()]
    }
}

/// The line between host and printer.
struct Line {
    printer: Printer,
    random: Random,
    /// One line in this many has a mishap.
    one_in: u64,
    mishaps: Vec<Mishap>,
    is_deaf: bool,
    /// Number of lines sent.
    lines: usize,
    said: VecDeque<(Instant, String)>,
    now: Instant,
}

impl Line {
    fn below(&mut self, bound: u64) -> u64 {
        self.random.bits() % bound
    }

    fn mishap(&mut self, line: &[u8]) -> Option<Mishap> {
        // The job begins with the line after M110 N0 and M118.
        let is_of_job = line.starts_with(b"N")
            && !line.starts_with(b"N0 ")
            && !line.windows(15).any(|part| part == b"M118 ferrostep ");
        if !is_of_job || self.mishaps.is_empty() || self.below(self.one_in) > 0 {
            return None;
        }
        let at = self.below(self.mishaps.len() as u64) as usize;
        let mishap = self.mishaps[at];
        if matches!(mishap, Mishap::CountsAnew | Mishap::Deaf) {
            // This mishap happens once and alone: a host cannot tell a count that went back from
            // earlier lost lines.
            self.mishaps.clear();
        }
        Some(mishap)
    }

    fn take(&mut self, line: &[u8]) {
        self.lines += 1;
        let mut line = line.to_vec();
        let mishap = self.mishap(&line);
        let (mut soon, mut extra) = (self.now, vec![]);
        match mishap {
            Some(Mishap::Damage) => {
                let (at, byte) = (self.below(line.len() as u64) as usize, self.below(256) as u8);
                line[at] = byte;
            }
            Some(Mishap::LineLost) => return,
            Some(Mishap::CountsAnew) => {
                self.printer.last = self.below(50) as i64;
                let is_this = String::from_utf8_lossy(&line).starts_with(&format!("N{} ", self.printer.last));
                // A printer that answers repeats takes this line for one; no host can detect that.
                self.printer.last += i64::from(is_this && self.printer.answers_repeats);
            }
            Some(Mishap::Deaf) => self.is_deaf = true,
            Some(Mishap::AnswerLate) => soon += Patience::DEFAULT.repeat + Duration::from_secs(1),
            Some(Mishap::OkTwice) => extra.push("ok".to_owned()),
            Some(Mishap::AnswerLost | Mishap::AsksForAnother) | None => {}
        }
        if self.is_deaf {
            return;
        }
        for piece in line.split(|byte| matches!(byte, b'\n' | b'\r')) {
            let piece = piece.split(|&byte| byte == b';').next().unwrap();
            if piece.is_empty() {
                continue;
            }
            let mut said = self.printer.take(piece);
            match mishap {
                Some(Mishap::AnswerLost) => continue,
                Some(Mishap::AsksForAnother) => {
                    said = vec![format!("Resend: {}", self.random.bits() % 50), "ok".to_owned()];
                }
                _ => {}
            }
            self.said.extend(said.into_iter().map(|said| (soon, said)));
        }
        self.said.extend(extra.into_iter().map(|said| (soon, said)));
    }
}

impl Port for Line {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.lines > MOST_LINES {
            return Err(io::Error::other("sent for ever"));
        }
        for line in bytes.split(|&byte| byte == b'\n').filter(|line| !line.is_empty()) {
            self.take(line);
        }
        Ok(())
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<String>> {
        // Answers arrive in order: late ones delay those after them.
        match self.said.front() {
            Some(&(at, _)) if at <= until => {
                self.now = self.now.max(at);
                Ok(self.said.pop_front().map(|(_, said)| said))
            }
            _ => {
                self.now = until;
                Ok(None)
            }
        }
    }

    fn now(&mut self) -> Instant {
        self.now
    }
}

/// Generates a file's lines, as hosts, slicers and editors write them, and the commands in them.
fn file(random: &mut Random) -> (Vec<String>, Vec<String>) {
    let (mut lines, mut commands) = (Vec::new(), Vec::new());
    for number in 1..=5 + random.bits() % 30 {
        let command = format!("G1 X{number} Y{}", random.bits() % 200);
        lines.push(match random.bits() % 8 {
            0 => format!("N{} {command}", random.bits() % 60),
            1 => {
                let line = format!("N{} {command}", random.bits() % 60);
                let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
                format!("{line}*{sum}")
            }
            2 => format!("  {command} ; to there"),
            _ => command.clone(),
        });
        commands.push(command);
        match random.bits() % 10 {
            0 => lines.push(format!("M110 N{}", random.bits() % 50)),
            1 => lines.push("; LAYER_CHANGE".to_owned()),
            2 => lines.push(String::new()),
            _ => {}
        }
    }
    (lines, commands)
}

/// A job that ends as printed was executed: every line once and in order.
#[test]
fn every_line_is_executed_once_in_order_or_the_job_ends_with_an_error() {
    let (mut printed, mut ended) = (0, 0);
    for seed in share_of(100_000) {
        let mut random = Random::numbered(seed);
        let (lines, mut commands) = file(&mut random);
        commands.push("M400".to_owned());
        let mishaps = match random.bits() % 4 {
            0 => vec![Mishap::Damage],
            1 => vec![Mishap::Damage, Mishap::LineLost, Mishap::AnswerLost],
            2 => vec![
                Mishap::Damage,
                Mishap::AnswerLate,
                Mishap::LineLost,
                Mishap::AnswerLost,
                Mishap::OkTwice,
                Mishap::AsksForAnother,
            ],
            _ => vec![Mishap::CountsAnew, Mishap::Deaf],
        };
        let printer = Printer {
            last: 0,
            executed: Vec::new(),
            asks_without_number: random.bits().is_multiple_of(2),
            answers_repeats: random.bits().is_multiple_of(2),
            // Without the text at the end a host cannot recognise late answers.
            knows_m118: mishaps.contains(&Mishap::AnswerLate) || !random.bits().is_multiple_of(8),
        };
        let (one_in, now) = (2 + random.bits() % 20, Instant::now());
        // Occasional faults of a bad cable must not end a print.
        let is_usual = |mishap: &Mishap| matches!(mishap, Mishap::Damage | Mishap::LineLost | Mishap::AnswerLost);
        let must_end_well = one_in >= 10 && mishaps.iter().all(is_usual);
        let mut line = Line { printer, random, one_in, mishaps, is_deaf: false, lines: 0, said: VecDeque::new(), now };
        let mut next = lines.iter().map(|line| Ok(line.clone().into_bytes()));
        let outcome =
            send_lines(&mut line, Packing::Plain, || next.next(), Frame::PLAIN, Patience::DEFAULT, &mut |_: &str| {});
        match outcome {
            Ok(Outcome { stop: None, sent, .. }) => {
                printed += 1;
                assert_eq!(line.printer.executed, commands, "conversation {seed}");
                assert_eq!(sent as usize + 1, commands.len(), "conversation {seed}");
            }
            Err(error) if error.to_string().contains("for ever") => panic!("conversation {seed}: {error}"),
            outcome => {
                assert!(!must_end_well, "conversation {seed}: {outcome:?}");
                ended += 1;
            }
        }
    }
    // Both outcomes must occur.
    assert!(printed > 500 && ended > 500, "{printed} printed, {ended} ended");
}
