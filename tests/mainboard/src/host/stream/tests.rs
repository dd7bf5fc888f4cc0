#![allow(clippy::unwrap_used, clippy::expect_used)]

use proptest::prelude::*;

use super::*;

fn numbered_options(window: usize) -> Options {
    Options { numbered: true, window, ..Options::default() }
}

fn sent(stream: &mut Stream, now_ns: u64) -> Option<String> {
    stream.to_send(now_ns).map(|bytes| String::from_utf8(bytes).unwrap())
}

#[test]
fn lines_are_sent_one_by_one_without_comments() {
    let mut stream = Stream::new(["G28 ; home", "", "; nothing", "  G1 X1"], Options::default());
    assert_eq!(stream.lines(), 2);
    assert_eq!(sent(&mut stream, 0).unwrap(), "G28\n");
    assert_eq!(sent(&mut stream, 0), None);
    stream.received(5, b"echo:busy: proc");
    stream.received(7, b"essing\r\nok");
    assert_eq!(sent(&mut stream, 7), None, "the line of the ok has not ended");
    stream.received(8, b"\r\n");
    assert_eq!(sent(&mut stream, 8).unwrap(), "G1 X1\n");
    assert!(!stream.finished());
    stream.received(9, b"ok T:21.3 /0.0\n");
    assert!(stream.finished() && stream.problems().is_empty());
    assert_eq!(stream.heard()[0], Heard { at_ns: 7, text: "echo:busy: processing".into(), kind: LineKind::Busy });
    assert_eq!(stream.acknowledged(), 2);
}

#[test]
fn lines_carry_the_numbers_and_checksums_of_the_protocol() {
    let mut stream = Stream::new(["T0", "x", "x", "G92 E0"], numbered_options(9));
    assert_eq!(sent(&mut stream, 0).unwrap(), "N0 M110 N0*125\n");
    sent(&mut stream, 0);
    sent(&mut stream, 0);
    sent(&mut stream, 0);
    assert_eq!(sent(&mut stream, 0).unwrap(), "N4 G92 E0*67\n");
    assert_eq!(numbered(3, "T0"), "N3 T0*57");
}

#[test]
fn a_resend_starts_after_its_ok() {
    for text in ["Resend: 1", "Resend:1", "rs 1", "rs N1"] {
        let mut stream = Stream::new(["G28", "G1 X1"], numbered_options(1));
        stream.to_send(0);
        stream.received(1, b"ok\n");
        let first = sent(&mut stream, 1).unwrap();
        stream.received(2, format!("Error:checksum mismatch, Last Line: 0\n{text}\n").as_bytes());
        assert_eq!(sent(&mut stream, 2), None, "{text}");
        stream.received(3, b"ok\n");
        assert_eq!(sent(&mut stream, 3).unwrap(), first, "{text}");
        stream.received(4, b"ok\n");
        assert!(sent(&mut stream, 4).unwrap().starts_with("N2 "));
        stream.received(5, b"ok\n");
        assert!(stream.finished() && stream.problems().is_empty());
        assert_eq!((stream.resends(), stream.errors().count()), (1, 1));
    }
}

#[test]
fn silence_without_ok_ends_a_resend() {
    let mut stream = Stream::new(["G28"], numbered_options(1));
    stream.to_send(0);
    stream.received(10, b"Resend: 0\n");
    assert_eq!(sent(&mut stream, 100_000_009), None);
    assert!(sent(&mut stream, 100_000_010).unwrap().starts_with("N0 "));
}

#[test]
fn an_impossible_resend_is_a_problem() {
    let mut stream = Stream::new(["G28", "G1"], numbered_options(1));
    stream.to_send(0);
    stream.received(1, b"ok\nResend: 7\n");
    assert!(stream.problems()[0].text.contains("line 7"));
    assert!(sent(&mut stream, 1).is_some());
    let mut stream = Stream::new(["G28"], Options::default());
    stream.to_send(0);
    stream.received(1, b"Resend: 1\n");
    assert!(stream.problems()[0].text.contains("without numbers"));
}

#[test]
fn a_reset_ends_sending_and_is_reported() {
    let options = Options { wait_for_start: true, ..Options::default() };
    let mut stream = Stream::new(["G28", "G1"], options);
    assert_eq!(sent(&mut stream, 0), None);
    stream.received(5, b"start\nMarlin\n");
    assert!(sent(&mut stream, 5).is_some() && !stream.was_reset());
    stream.received(6, b"start\nok\n");
    assert!(stream.was_reset() && sent(&mut stream, 6).is_none() && !stream.finished());
    assert_eq!(stream.problems()[0].at_ns, 6);
    assert!(stream.problems()[0].text.contains("1 lines unacknowledged"));
}

#[test]
fn an_idle_printer_and_an_extra_ok_are_problems() {
    let mut stream = Stream::new(["G28"], Options::default());
    stream.received(0, b"wait\n");
    stream.to_send(1);
    assert!(stream.problems().is_empty());
    stream.received(2, b"wait\nok\nok\n");
    assert_eq!(stream.problems().len(), 2);
    assert!(stream.problems()[1].text.contains("too many"));
}

#[test]
fn signs_of_life_end_silence() {
    let mut stream = Stream::new(["G28"], Options::default());
    stream.received(1, b"start\n");
    assert_eq!(stream.silent_ns(1_000), 0, "nothing is to be answered");
    stream.to_send(2_000);
    assert_eq!(stream.silent_ns(2_500), 500);
    stream.received(2_600, b"busy: processing\n");
    assert_eq!(stream.silent_ns(2_700), 100);
}

#[test]
fn an_urgent_line_overtakes_and_is_acknowledged_in_turn() {
    let mut stream = Stream::new(["M109 S200", "G1"], Options::default());
    stream.to_send(0);
    stream.push_urgent("M108");
    assert_eq!(sent(&mut stream, 1).unwrap(), "M108\n");
    stream.received(2, b"ok\n");
    assert_eq!(sent(&mut stream, 2), None);
    assert_eq!(stream.acknowledged(), 1);
    stream.received(3, b"ok\n");
    assert_eq!(sent(&mut stream, 3).unwrap(), "G1\n");
    stream.received(4, b"Error:Printer halted. kill() called!\n!! STOP\nok\n");
    assert!(stream.finished());
    assert_eq!(stream.errors().count(), 2);
}

/// A printer that checks numbers and checksums, and empties its line buffer on an error.
struct Printer {
    last: i64,
    done: Vec<String>,
    replies: Vec<u8>,
}

impl Printer {
    fn take(&mut self, line: &str) {
        let valid = line.rsplit_once('*').and_then(|(body, checksum)| {
            let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
            let (number, text) = body.strip_prefix('N')?.split_once(' ')?;
            (checksum.trim().parse() == Ok(sum)).then_some((number.parse::<i64>().ok()?, text.to_owned()))
        });
        match valid {
            Some((number, text)) if number == self.last + 1 => {
                self.last = number;
                self.done.push(text);
            }
            _ => self.replies.extend(format!("Error:no\nResend: {}\n", self.last + 1).bytes()),
        }
        self.replies.extend(b"ok\n");
    }
}

proptest! {
    #[test]
    fn garbled_lines_arrive_once_and_in_order(
        window in 1_usize..6,
        count in 1_usize..40,
        garbled in prop::collection::vec(0_u8..4, 0..60),
    ) {
        let lines: Vec<String> = (0..count).map(|line| format!("G1 X{line}")).collect();
        let mut stream = Stream::new(&lines, numbered_options(window));
        let mut printer = Printer { last: -1, done: Vec::new(), replies: Vec::new() };
        let mut garbled = garbled.into_iter();
        for round in 0..5_000_u64 {
            let now_ns = round * 20_000_000;
            while let Some(mut bytes) = stream.to_send(now_ns) {
                if garbled.next() == Some(0) {
                    bytes[1] = b'!';
                }
                printer.take(String::from_utf8(bytes).unwrap().trim_end());
            }
            // Answers arrive one by one: several resends of the same line may follow each other.
            let length = printer.replies.iter().position(|byte| *byte == b'\n').map_or(0, |end| end + 1);
            let reply: Vec<u8> = printer.replies.drain(..length).collect();
            stream.received(now_ns, &reply);
            if stream.finished() {
                break;
            }
        }
        prop_assert!(stream.finished() && stream.problems().is_empty(), "{:?}", stream.problems());
        prop_assert_eq!(&printer.done[..1], ["M110 N0"]);
        prop_assert_eq!(&printer.done[1..], &lines[..]);
    }
}
