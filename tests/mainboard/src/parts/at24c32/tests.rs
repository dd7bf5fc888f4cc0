#![allow(clippy::unwrap_used)]

use super::*;

/// The other end of the wires, at 100 kHz.
struct Wires {
    chip: At24c32,
    now_ns: u64,
    quarter_ns: u64,
}

impl Wires {
    fn new() -> Self {
        Self { chip: At24c32::new(0x50, 1), now_ns: 0, quarter_ns: 2_500 }
    }

    fn pass(&mut self, quarters: u64) {
        self.now_ns += quarters * self.quarter_ns;
    }

    fn start(&mut self) {
        self.chip.set_sda(self.now_ns, true);
        self.pass(2);
        self.chip.set_scl(self.now_ns, true);
        self.pass(2);
        self.chip.set_sda(self.now_ns, false);
        self.pass(2);
        self.chip.set_scl(self.now_ns, false);
    }

    fn stop(&mut self) {
        self.pass(1);
        self.chip.set_sda(self.now_ns, false);
        self.pass(1);
        self.chip.set_scl(self.now_ns, true);
        self.pass(2);
        self.chip.set_sda(self.now_ns, true);
        self.pass(2);
    }

    fn bit(&mut self, bit: bool) -> bool {
        self.pass(1);
        self.chip.set_sda(self.now_ns, bit);
        self.pass(1);
        self.chip.set_scl(self.now_ns, true);
        let level = bit && !self.chip.pulls_sda();
        self.pass(2);
        self.chip.set_scl(self.now_ns, false);
        level
    }

    /// Sends a byte; whether it is acknowledged.
    fn send(&mut self, byte: u8) -> bool {
        (0..8).rev().for_each(|place| {
            self.bit(byte >> place & 1 == 1);
        });
        !self.bit(true)
    }

    fn receive(&mut self, more: bool) -> u8 {
        let byte = (0..8).fold(0, |byte, _| byte << 1 | u8::from(self.bit(true)));
        self.bit(!more);
        byte
    }

    /// Writes; how many bytes were acknowledged.
    fn write(&mut self, bytes: &[u8]) -> usize {
        self.start();
        let count = bytes.iter().take_while(|byte| self.send(**byte)).count();
        self.stop();
        count
    }

    fn read(&mut self, address: u16, count: usize) -> Vec<u8> {
        self.start();
        let [high, low] = address.to_be_bytes();
        assert!([0xa0, high, low].into_iter().all(|byte| self.send(byte)));
        self.start();
        assert!(self.send(0xa1));
        let bytes = (1..=count).map(|at| self.receive(at < count)).collect();
        self.stop();
        bytes
    }

    fn wait(&mut self) {
        self.now_ns += 5_000_000;
    }
}

#[test]
fn a_page_rolls_over_and_takes_its_time() {
    let mut wires = Wires::new();
    assert_eq!(wires.write(&[0xa0, 0x01, 0x3e, 1, 2, 3]), 6);
    // While it writes it does not answer.
    assert_eq!(wires.write(&[0xa0, 0, 0, 9]), 0);
    wires.wait();
    assert_eq!(wires.read(0x013e, 2), [1, 2]);
    assert_eq!(wires.read(0x0120, 1), [3]);
    assert_eq!((wires.chip.pages_written(), wires.chip.violations()), (1, 0));
    // Sequential reads continue over pages and over the end.
    assert_eq!(wires.write(&[0xa0, 0x0f, 0xff, 7]), 4);
    wires.wait();
    assert_eq!(wires.write(&[0xa0, 0x00, 0x00, 8]), 4);
    wires.wait();
    assert_eq!(wires.read(0x0fff, 3), [7, 8, 0xff]);
    // The current address.
    wires.start();
    assert!(wires.send(0xa1));
    assert_eq!(wires.receive(false), 0xff);
    wires.stop();
    assert_eq!(wires.chip.violations(), 0);
}

#[test]
fn only_a_stop_behind_a_whole_byte_writes() {
    let mut wires = Wires::new();
    // A start instead of a stop.
    wires.start();
    assert!([0xa0, 0, 0, 1].into_iter().all(|byte| wires.send(byte)));
    wires.start();
    wires.stop();
    wires.wait();
    assert_eq!(wires.read(0, 1), [0xff]);
    // A stop within a byte.
    wires.start();
    assert!([0xa0, 0, 0, 1].into_iter().all(|byte| wires.send(byte)));
    (0..3).for_each(|_| {
        wires.bit(false);
    });
    wires.stop();
    wires.wait();
    assert_eq!((wires.read(0, 1), wires.chip.pages_written()), (vec![0xff], 0));
}

#[test]
fn other_addresses_protection_and_absence() {
    let mut wires = Wires::new();
    assert_eq!(wires.write(&[0xa2, 0, 0, 1]), 0);
    wires.chip.set_protected(true);
    assert_eq!(wires.write(&[0xa0, 0, 0, 1]), 4);
    assert_eq!(wires.read(0, 1), [0xff], "at once, and unchanged");
    wires.chip.set_protected(false);
    wires.chip.set_plugged(false);
    assert_eq!(wires.write(&[0xa0, 0, 0, 1]), 0);
    wires.chip.set_plugged(true);
    assert_eq!(wires.write(&[0xa0, 0, 0, 1]), 4);
    wires.wait();
    assert_eq!(wires.read(0, 1), [1]);
}

/// A reader that is reset within a byte leaves a chip that pulls SDA low; nine clocks end it.
#[test]
fn an_interrupted_read_holds_the_line() {
    for clocks in 0..8 {
        let mut wires = Wires::new();
        wires.chip.set_bytes(&[0; 64]);
        wires.start();
        assert!([0xa0, 0, 0].into_iter().all(|byte| wires.send(byte)));
        wires.start();
        assert!(wires.send(0xa1));
        (0..clocks).for_each(|_| {
            wires.bit(true);
        });
        wires.chip.set_scl(wires.now_ns + 5_000, true);
        wires.now_ns += 10_000;
        assert!(wires.chip.pulls_sda(), "{clocks}");
        wires.chip.set_scl(wires.now_ns, false);
        let freed = (0..9).position(|_| wires.bit(true));
        assert_eq!(freed, Some(7 - clocks), "the bit of the acknowledge");
        wires.stop();
        assert_eq!(wires.read(0, 2), [0, 0], "{clocks}");
    }
}

#[test]
fn a_bus_that_is_too_fast_is_counted() {
    let mut wires = Wires { quarter_ns: 700, ..Wires::new() };
    wires.read(0, 4);
    assert!(wires.chip.violations() > 100, "{}", wires.chip.violations());
}

/// Nothing but the page that was being written changes.
#[test]
fn a_cut_spares_the_other_pages() {
    let mut kinds = [0; 3];
    for seed in 0..50 {
        let mut wires = Wires::new();
        wires.chip = At24c32::new(0x50, seed);
        let page: Vec<u8> = (0..32).collect();
        assert_eq!(wires.write(&[&[0xa0, 0x00, 0x40][..], &page].concat()), 35);
        wires.now_ns += 1_000_000;
        wires.chip.set_power(wires.now_ns, false);
        wires.chip.set_power(wires.now_ns + 1_000_000, true);
        let (before, rest) = wires.chip.bytes().split_at(0x40);
        assert!(before.iter().chain(&rest[32..]).all(|byte| *byte == 0xff));
        for (place, byte) in rest[..32].iter().enumerate() {
            let kind = if *byte == 0xff {
                0
            } else if usize::from(*byte) == place {
                1
            } else {
                2
            };
            kinds[kind] += 1;
        }
    }
    assert!(kinds.iter().all(|count| *count > 100), "{kinds:?}");
}
