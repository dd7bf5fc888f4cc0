//! Jobs over a line that loses and changes bytes.
#![allow(clippy::unwrap_used)]

use ferrostep_gcode::EmergencyScanner;
use ferrostep_gpre::transfer::{ESCAPE, Event, FLAG, Kind, Receiver, Report, Sender, Word, to_wire};
use proptest::prelude::*;

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }

    fn one_in(&mut self, count: u64) -> bool {
        self.next().is_multiple_of(count)
    }
}

/// Faults of a line: one transfer in `changes` has a bit changed, and one in `loses` is lost.
#[derive(Clone, Copy, Debug)]
struct Treatment {
    changes: u64,
    loses: u64,
}

fn pass(dice: &mut Dice, treatment: Treatment, mut bytes: Vec<u8>) -> Vec<u8> {
    if dice.one_in(treatment.loses) {
        return Vec::new();
    }
    if dice.one_in(treatment.changes) {
        let (at, bit) = (dice.next() as usize % bytes.len(), dice.next() % 8);
        bytes[at] ^= 1 << bit;
    }
    bytes
}

/// Sends a job through a bad line into a buffer of `room` bytes that is emptied now and then;
/// returns the received bytes and the number of frames that they took.
fn transfer(job: &[u8], room: usize, treatment: Treatment, seed: u64) -> (Vec<u8>, usize) {
    let mut dice = Dice(seed);
    let mut sender = Sender::new(job.to_vec());
    let mut receiver = Receiver::new(job.len() as u32);
    let (mut buffer, mut filled) = (vec![0; room], 0);
    let (mut come, mut frames) = (Vec::new(), 0);
    let mut told = 0;
    let mut lines = vec![receiver.report(room).to_string()];
    for _ in 0..1_000_000 {
        if come.len() + filled == job.len() && sender.arrived() == job.len() {
            come.extend_from_slice(&buffer[..filled]);
            return (come, frames);
        }
        for line in lines.drain(..) {
            let line = pass(&mut dice, treatment, line.into_bytes());
            sender.hear(&String::from_utf8_lossy(&line));
        }
        let mut sent = Vec::new();
        while let Some(frame) = sender.next_frame() {
            sent.push(frame);
        }
        if sent.is_empty() {
            sent.push(sender.question());
        }
        frames += sent.len();
        for frame in sent {
            for byte in pass(&mut dice, treatment, frame) {
                match receiver.take(byte, &mut buffer[filled..]) {
                    Event::Bytes(length) => {
                        filled += length;
                        told = receiver.report(room - filled).numbers[1];
                        lines.push(receiver.report(room - filled).to_string());
                    }
                    Event::Answer => lines.push(receiver.report(room - filled).to_string()),
                    Event::Nothing | Event::Other => {}
                    Event::Aborted => panic!("the host has not given up"),
                }
            }
        }
        if dice.one_in(3) {
            let taken = dice.next() as usize % (filled + 1);
            come.extend(buffer.drain(..taken));
            buffer.resize(room, 0);
            filled -= taken;
            if receiver.has_opened(told, room - filled) {
                lines.push(receiver.report(room - filled).to_string());
            }
        }
    }
    panic!("{} of {} bytes have come", come.len() + filled, job.len());
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(64))]
    #[test]
    fn every_job_comes_whole(
        job in proptest::collection::vec(any::<u8>(), 1..20_000),
        room in 256usize..4000,
        seed: u64,
        changes in 3u64..200,
        loses in 3u64..200,
    ) {
        let (come, _) = transfer(&job, room, Treatment { changes, loses }, seed);
        prop_assert!(come == job);
    }

    #[test]
    fn no_frame_is_a_command_that_acts_as_it_comes(
        data in proptest::collection::vec(prop_oneof![any::<u8>(), proptest::sample::select(&b"M112\nM108\r*"[..])], 0..256),
        place: u32,
        cut in any::<proptest::sample::Index>(),
        changed in any::<proptest::sample::Index>(),
        bit in 0u32..8,
        damage in 0u8..3,
    ) {
        let mut frame = to_wire(Kind::Data, place, &data);
        prop_assert_eq!(frame[0], FLAG);
        prop_assert_eq!(frame.iter().position(|byte| b"\n\r\x11\x13Mm\xff".contains(byte)), Some(frame.len() - 1));
        prop_assert!(!frame[1..].contains(&FLAG) && frame[frame.len() - 2] != ESCAPE);
        // Nor is the rest of a frame that has lost its beginning or has a changed bit.
        match damage {
            0 => {}
            1 => drop(frame.drain(..cut.index(frame.len()))),
            _ => {
                let at = changed.index(frame.len());
                frame[at] ^= 1 << bit;
            }
        }
        let mut scanner = EmergencyScanner::new();
        prop_assert!(!frame.iter().any(|&byte| scanner.feed(byte).is_some()));
        // Such a command between two frames is noticed.
        let heard = |text: &[u8]| {
            let mut scanner = EmergencyScanner::new();
            let mut bytes = to_wire(Kind::Data, place, &data);
            bytes.extend_from_slice(text);
            bytes.iter().any(|&byte| scanner.feed(byte).is_some())
        };
        prop_assert!(heard(b"M112\n"));
    }

    #[test]
    fn any_bytes_are_taken(bytes in proptest::collection::vec(any::<u8>(), 0..2000), size: u32, room in 0usize..300) {
        let mut receiver = Receiver::new(size);
        let mut buffer = vec![0; room];
        for byte in bytes {
            if let Event::Bytes(length) = receiver.take(byte, &mut buffer) {
                prop_assert!(length <= room);
            }
            let [next, limit] = receiver.report(room).numbers;
            prop_assert!(next <= limit && limit <= size);
        }
    }

    #[test]
    fn reports_come_back(first: u32, second: u32, at in any::<proptest::sample::Index>(), bit in 0u32..7) {
        for word in [Word::Have, Word::Again, Word::Done, Word::Refused, Word::Stopped, Word::None] {
            let report = Report { word, numbers: [first, second] };
            let mut line = report.to_string();
            prop_assert_eq!(Report::parse(&line), Some(report));
            let at = at.index(line.len());
            let changed = char::from(line.as_bytes()[at] ^ 1 << bit);
            line.replace_range(at..=at, &changed.to_string());
            // A checksum in capital letters is the same checksum.
            prop_assert!(Report::parse(&line).is_none_or(|read| read == report));
        }
    }
}

#[test]
fn one_frame_in_a_hundred_changed_and_one_lost_cost_little() {
    let job: Vec<u8> = (0..100_000u32).map(|index| (index.wrapping_mul(index) >> 7) as u8).collect();
    let (come, frames) = transfer(&job, 3072, Treatment { changes: 100, loses: 100 }, 7);
    assert_eq!(come, job);
    let needed = job.len().div_ceil(128);
    assert!(frames < needed * 4 / 3, "{frames} frames for {needed}");
}

#[test]
fn a_board_asks_once_for_what_is_missing() {
    let mut receiver = Receiver::new(1000);
    let mut room = [0; 1000];
    let mut answers = |frame: Vec<u8>| {
        frame.into_iter().map(|byte| receiver.take(byte, &mut room)).filter(|event| *event != Event::Nothing).collect()
    };
    let data = |place| to_wire(Kind::Data, place, &[7; 100]);
    let seen: Vec<Vec<Event>> = [0, 200, 300, 100, 100, 300].map(|place| answers(data(place))).into();
    let (bytes, answer) = (vec![Event::Bytes(100)], vec![Event::Answer]);
    assert_eq!(seen, [bytes.clone(), answer.clone(), vec![], bytes, answer.clone(), answer]);
    assert_eq!(receiver.report(500), Report { word: Word::Again, numbers: [200, 700] });
}

#[test]
fn a_host_that_gives_up_is_heard() {
    let mut receiver = Receiver::new(1000);
    let sender = Sender::new(vec![0; 1000]);
    let last = sender.abort().into_iter().map(|byte| receiver.take(byte, &mut [])).last();
    assert_eq!(last, Some(Event::Aborted));
}
