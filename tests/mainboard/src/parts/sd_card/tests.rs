#![allow(clippy::unwrap_used)]

use super::*;

const MS: u64 = 1_000_000;

struct Bench {
    card: SdCard,
    now_ns: u64,
    hz: u64,
    clocks: u64,
}

fn pattern(index: u32) -> Vec<u8> {
    (0..BLOCK_BYTES).map(|place| (place as u32 * 7 + index * 13) as u8).collect()
}

impl Bench {
    fn new(kind: Kind) -> Self {
        let image: Vec<u8> = (0..8).flat_map(pattern).collect();
        let mut card = SdCard::new(Config { kind, ..Config::high(2048) }, &image);
        card.set_power(0, true);
        Self { card, now_ns: MS, hz: 400_000, clocks: 100 }
    }

    /// Identified and selected.
    fn selected(kind: Kind) -> Self {
        let mut bench = Self::new(kind);
        bench.start(kind != Kind::Version1);
        let address = bench.address();
        bench.hz = 25_000_000;
        assert_eq!(bench.short(7, address) >> 9 & 0xF, State::StandBy as u32);
        assert_eq!(bench.state(), State::Transfer);
        bench
    }

    fn say(&mut self, index: u8, argument: u32) -> Option<Answer> {
        self.now_ns += MS;
        self.card.command(Bus { at_ns: self.now_ns, hz: self.hz, clocks: self.clocks }, index, argument)
    }

    fn short(&mut self, index: u8, argument: u32) -> u32 {
        match self.say(index, argument) {
            Some(Answer::Short(word)) => word,
            other => panic!("CMD{index}: {other:?}"),
        }
    }

    fn state(&mut self) -> State {
        self.card.state(self.now_ns)
    }

    /// ACMD41 until the card has started, 100 times at most; its OCR.
    fn start(&mut self, knows_voltage: bool) -> Option<u32> {
        assert_eq!(self.say(0, 0), None);
        if knows_voltage {
            assert_eq!(self.short(8, 0x1AA), 0x1AA);
        }
        (0..100).find_map(|_| {
            self.short(55, 0);
            match self.say(41, 0x0010_0000 | u32::from(knows_voltage) << 30) {
                Some(Answer::WithoutCrc(ocr)) => (ocr >> 31 == 1).then_some(ocr),
                other => panic!("{other:?}"),
            }
        })
    }

    /// An address, after the start; CMD7's argument.
    fn address(&mut self) -> u32 {
        assert!(matches!(self.say(2, 0), Some(Answer::Long(_))));
        self.short(3, 0) & 0xFFFF_0000
    }

    fn read(&mut self, argument: u32) -> Sent {
        self.short(17, argument);
        let starts_ns = self.card.block_starts_ns().unwrap();
        assert!(starts_ns > self.now_ns);
        self.card.send_block(starts_ns + 1000).unwrap()
    }

    fn write(&mut self, argument: u32, bytes: &[u8]) -> Status {
        self.short(24, argument);
        self.now_ns += MS;
        self.card.take_block(self.now_ns, bytes, true)
    }
}

#[test]
fn a_card_is_identified() {
    for kind in [Kind::Version1, Kind::Standard, Kind::High] {
        let mut bench = Bench::new(kind);
        let ocr = bench.start(kind != Kind::Version1).unwrap();
        assert_eq!(ocr >> 30 & 1 == 1, kind == Kind::High);
        assert_eq!(bench.state(), State::Ready);
        let address = bench.address();
        assert_ne!(address, 0);
        bench.hz = 25_000_000;
        assert_eq!(bench.say(9, address ^ 1 << 16), None, "another card's");
        let Some(Answer::Long([high, middle, low, _])) = bench.say(9, address) else { panic!("no CSD") };
        // 5.3.3: (C_SIZE + 1) * 512 KiB; 5.3.2: (C_SIZE + 1) * 2^(C_SIZE_MULT + 2) blocks.
        let blocks = if kind == Kind::High {
            assert_eq!(high >> 30, 1);
            ((middle & 0x3F) << 16 | low >> 16) * 1024 + 1024
        } else {
            assert_eq!((high >> 30, middle >> 16 & 0xF, low >> 15 & 7), (0, 9, 7));
            ((middle & 0x3FF) << 2 | low >> 30) * 512 + 512
        };
        assert_eq!(blocks, 2048);
    }
}

#[test]
fn a_host_that_does_not_know_high_capacity_waits_for_ever() {
    assert_eq!(Bench::new(Kind::High).start(false), None);
    assert!(Bench::new(Kind::Standard).start(false).is_some());
    // 4.3.13: a voltage that the card does not have; CMD8 was not there before version 2.
    let mut bench = Bench::new(Kind::High);
    assert_eq!(bench.say(8, 0x2AA), None);
    assert_eq!(Bench::new(Kind::Version1).say(8, 0x1AA), None);
}

#[test]
fn a_forbidden_command_is_not_answered() {
    let mut bench = Bench::selected(Kind::High);
    let address = u32::from(bench.card.address) << 16;
    for index in [2, 3, 8, 12, 18, 25, 41] {
        assert_eq!(bench.say(index, 0), None, "CMD{index}");
        assert_eq!(bench.short(13, address), ILLEGAL | 0x900, "CMD{index}");
        assert_eq!(bench.short(13, address), 0x900, "reported once");
    }
    // A data transfer is ended by CMD12.
    bench.short(17, 3);
    assert_eq!(bench.state(), State::SendingData);
    bench.short(12, 0);
    assert_eq!(bench.state(), State::Transfer);
    bench.short(24, 3);
    bench.short(12, 0);
    assert_eq!(bench.state(), State::Transfer);
    assert_eq!(bench.say(7, 0), None, "deselected");
    assert_eq!(bench.state(), State::StandBy);
    assert_eq!(bench.say(17, 3), None);
    bench.short(7, address);
    assert_eq!(bench.say(0, 0), None);
    assert_eq!(bench.state(), State::Idle);
}

const ILLEGAL: u32 = 1 << 22;

#[test]
fn blocks_are_written_and_read() {
    for kind in [Kind::Version1, Kind::Standard, Kind::High] {
        let mut bench = Bench::selected(kind);
        let unit = if kind == Kind::High { 1 } else { 512 };
        assert_eq!(bench.short(16, 512), 0x900);
        for index in [0, 5, 2047] {
            let expected = if index < 8 { pattern(index) } else { vec![0; BLOCK_BYTES] };
            assert_eq!(bench.read(index * unit), Sent { bytes: expected, is_sound: true });
        }
        assert!(matches!(bench.write(77 * unit, &pattern(99)), Status::Taken(_)));
        assert_eq!(bench.read(77 * unit).bytes, pattern(99));
        assert_eq!(bench.short(17, 2048 * unit) & 1 << 31, 1 << 31, "out of range");
        assert_eq!(bench.state(), State::Transfer);
        if kind != Kind::High {
            assert_eq!(bench.short(17, 100) & 1 << 30, 1 << 30, "not the start of a block");
        }
        let image = bench.card.image();
        assert_eq!((image.len(), &image[77 * 512..78 * 512]), (2048 * 512, &pattern(99)[..]));
    }
}

#[test]
fn a_card_is_busy_while_it_programs() {
    let mut bench = Bench::selected(Kind::High);
    let address = u32::from(bench.card.address) << 16;
    bench.card.set_program_ns(10 * MS);
    let status = bench.write(3, &pattern(50));
    assert_eq!(status, Status::Taken(bench.now_ns + 10 * MS));
    assert_eq!(bench.short(13, address), 7 << 9, "programming, and not ready");
    assert_eq!(bench.say(17, 3), None);
    assert_eq!(bench.say(7, 0), None);
    assert_eq!(bench.state(), State::Disconnect);
    bench.short(7, address);
    assert_eq!(bench.state(), State::Programming);
    bench.now_ns += 10 * MS;
    assert_eq!(bench.short(13, address), 4 << 9 | 1 << 8);
}

#[test]
fn faults_are_seen() {
    let mut bench = Bench::selected(Kind::High);
    let address = u32::from(bench.card.address) << 16;
    bench.card.faults.garbled_reads = 1;
    assert!(!bench.read(3).is_sound && bench.read(3).is_sound);
    bench.card.faults.unreadable = Some(4..6);
    bench.short(17, 5);
    assert_eq!((bench.card.block_starts_ns(), bench.state()), (None, State::SendingData));
    bench.short(12, 0);
    bench.card.faults.refused_writes = 1;
    assert_eq!((bench.write(3, &pattern(50)), bench.state()), (Status::Refused, State::Transfer));
    // 4.3.4: so is one whose CRC is wrong.
    bench.short(24, 3);
    assert_eq!(bench.card.take_block(bench.now_ns, &pattern(50), false), Status::Refused);
    assert_eq!(bench.card.block(3), pattern(3));
    bench.card.faults.failing_writes = 1;
    assert!(matches!(bench.write(3, &pattern(50)), Status::Taken(_)));
    assert_eq!(bench.short(13, address) & ERROR, ERROR);
    assert_eq!(bench.card.block(3), pattern(3));
    assert_eq!(bench.card.take_block(bench.now_ns, &pattern(50), true), Status::None, "nothing was to be written");
    bench.card.faults.is_silent = true;
    assert_eq!(bench.say(13, address), None);
}

#[test]
fn a_bus_that_is_too_fast_is_not_understood() {
    let mut bench = Bench::new(Kind::High);
    bench.hz = 400_001;
    assert_eq!(bench.say(8, 0x1AA), None);
    let mut bench = Bench::selected(Kind::High);
    bench.hz = 25_000_001;
    let address = u32::from(bench.card.address) << 16;
    assert_eq!(bench.say(13, address), None);
}

#[test]
fn a_card_wants_its_clocks_first() {
    let mut bench = Bench::new(Kind::High);
    bench.clocks = 73;
    assert_eq!(bench.say(8, 0x1AA), None);
    bench.clocks = 74;
    assert_eq!(bench.short(8, 0x1AA), 0x1AA);
    bench.card.set_power(bench.now_ns, false);
    assert_eq!(bench.say(8, 0x1AA), None);
}

#[test]
fn a_cut_spoils_the_block_that_is_programmed() {
    let mut spoilt = 0;
    for seed in 0..50 {
        let mut bench = Bench::selected(Kind::High);
        bench.card.random = Random::new(seed);
        bench.write(3, &pattern(50));
        bench.card.set_power(bench.now_ns, false);
        let after = bench.card.block(3);
        let kept = after.iter().zip(pattern(50)).take_while(|(byte, new)| *byte == new).count();
        spoilt += usize::from(kept < BLOCK_BYTES);
        assert_eq!((bench.card.block(2), bench.card.block(4)), (pattern(2), pattern(4)));
    }
    assert!(spoilt > 40, "{spoilt}");
    // Later it is safe, and the card starts again as after its purchase.
    let mut bench = Bench::selected(Kind::High);
    bench.write(3, &pattern(50));
    bench.now_ns += MS;
    bench.card.set_power(bench.now_ns, false);
    bench.card.set_power(bench.now_ns, true);
    assert_eq!((bench.card.block(3), bench.state()), (pattern(50), State::Idle));
}
