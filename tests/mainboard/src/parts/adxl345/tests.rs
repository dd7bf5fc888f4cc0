//! The chip against figures and tables of its data sheet.

use super::*;

/// A host's end of the wires.
struct Wires {
    chip: Adxl345,
    now_ns: u64,
    half_ns: u64,
}

impl Wires {
    fn new(config: Config) -> Self {
        Self { chip: Adxl345::new(config), now_ns: 1_000_000, half_ns: 325 }
    }

    fn frame(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.chip.set_select(self.now_ns, false);
        let mut answer = Vec::new();
        for byte in bytes {
            let mut received = 0;
            for place in (0..8).rev() {
                self.now_ns += self.half_ns;
                self.chip.set_clock(self.now_ns, false);
                self.chip.set_data(byte >> place & 1 == 1);
                self.now_ns += self.half_ns;
                self.chip.set_clock(self.now_ns, true);
                received = received << 1 | u8::from(self.chip.output().unwrap_or(true));
            }
            answer.push(received);
        }
        self.now_ns += self.half_ns;
        self.chip.set_select(self.now_ns, true);
        self.now_ns += self.half_ns;
        answer
    }

    fn read(&mut self, register: u8) -> u8 {
        self.frame(&[0x80 | register, 0])[1]
    }

    fn write(&mut self, register: u8, value: u8) {
        self.frame(&[register, value]);
    }

    fn data(&mut self) -> [i16; 3] {
        let bytes = self.frame(&[0x80 | 0x40 | 0x32, 0, 0, 0, 0, 0, 0]);
        [1, 3, 5].map(|at| i16::from_le_bytes([bytes[at], bytes[at + 1]]))
    }

    /// Advances time, while the chip feels this acceleration.
    fn pass(&mut self, ns: u64, acceleration_g: [f64; 3]) -> usize {
        self.now_ns += ns;
        let mut samples = 0;
        while self.chip.next_sample_ns().is_some_and(|at_ns| at_ns <= self.now_ns) {
            self.chip.sample(acceleration_g);
            samples += 1;
        }
        samples
    }
}

const SILENT: Config = Config { identity: 0xe5, fast: 0.0, noise_g: 0.0, seed: 1 };

#[test]
fn registers_are_read_and_written_in_frames() {
    let mut wires = Wires::new(SILENT);
    assert_eq!((wires.read(0x00), wires.read(0x2c), wires.read(0x2d)), (0xe5, 0x0a, 0));
    wires.write(0x00, 0x12);
    wires.write(0x39, 0x12);
    assert_eq!((wires.read(0x00), wires.read(0x39)), (0xe5, 0), "read-only");
    // Several in a frame.
    wires.frame(&[0x40 | 0x2c, 0x0d, 0x00]);
    assert_eq!(wires.frame(&[0xc0 | 0x2c, 0, 0])[1..], [0x0d, 0x00]);
    assert_eq!(wires.chip.output(), None, "deselected it floats");
    assert_eq!(wires.chip.violations(), Violations::default());
    wires.chip.set_plugged(false);
    assert_eq!(wires.read(0x00), 0xff, "the line is undriven");
}

#[test]
fn rates_resolutions_and_ranges() {
    for (code, rate_hz) in [(0x08, 25.0), (0x0d, 800.0), (0x0f, 3200.0)] {
        let mut wires = Wires::new(Config { fast: 0.02, ..SILENT });
        wires.write(0x38, 0x80);
        wires.write(0x2c, code);
        wires.write(0x2d, 8);
        let samples = wires.pass(10_000_000_000, [0.0; 3]);
        // Its oscillator is 2 % fast, and it wakes up first.
        assert!((samples as f64 - 10.0 * rate_hz * 1.02).abs() <= 1.0 + 0.002 * rate_hz, "{samples} at {rate_hz} Hz");
    }
    for (format, units) in
        [(0x0b, [256, -4096, 4095]), (0x03, [32, -512, 511]), (0x00, [256, -512, 511]), (0x01, [128, -512, 511])]
    {
        let mut wires = Wires::new(SILENT);
        wires.write(0x31, format);
        wires.write(0x2d, 8);
        wires.pass(20_000_000, [1.0, -20.0, 20.0]);
        assert_eq!(wires.data(), units, "{format:#x}");
    }
    let mut wires = Wires::new(SILENT);
    wires.frame(&[0x40 | 0x2c, 0x0f, 0x08]);
    wires.write(0x31, 0x0b);
    wires.pass(2_000_000, [7.0 / 256.0; 3]);
    assert_eq!(wires.data(), [6; 3], "the lowest bit is 0 at 3200 Hz");
}

#[test]
fn the_memory_keeps_the_newest_and_tells_when_it_was_full() {
    let mut wires = Wires::new(SILENT);
    wires.write(0x31, 0x0b);
    wires.write(0x38, 0x80);
    wires.frame(&[0x40 | 0x2c, 0x0a, 0x08]);
    wires.pass(1_100_000, [0.0; 3]);
    for number in 1..=31 {
        assert_eq!(wires.pass(10_000_000, [f64::from(number) / 256.0, 0.0, 1.0]), 1);
    }
    assert_eq!((wires.read(0x39), wires.read(0x30) & 1), (31, 0));
    for number in 32..=40 {
        wires.pass(10_000_000, [f64::from(number) / 256.0, 0.0, 1.0]);
    }
    assert_eq!((wires.read(0x39), wires.read(0x30) & 0x81), (33, 0x81));
    assert_eq!(wires.data(), [8, 0, 256], "the oldest seven are lost");
    assert_eq!((wires.read(0x39), wires.read(0x30) & 1), (32, 0));
    for number in 9..=40 {
        assert_eq!(wires.data()[0], number);
    }
    assert_eq!((wires.read(0x39), wires.read(0x30) & 0x80), (0, 0));
    assert_eq!(wires.data()[0], 40, "the newest again");
    // Bypass empties it, FIFO mode stops at its end.
    wires.write(0x38, 0x00);
    wires.write(0x38, 0x40);
    wires.pass(500_000_000, [0.5, 0.0, 0.0]);
    assert_eq!((wires.read(0x39), wires.data()[0]), (33, 128));
    assert_eq!(wires.chip.violations(), Violations::default());
}

#[test]
fn what_comes_too_soon_is_counted() {
    let mut wires = Wires::new(SILENT);
    wires.half_ns = 50;
    wires.read(0x00);
    assert!(wires.chip.violations().clock > 0);
    wires.read(0x00);
    assert!(wires.chip.violations().frame > 0);
    // A sample's address takes 2.4 us at 3.3 MHz.
    let mut wires = Wires::new(SILENT);
    wires.half_ns = 150;
    wires.data();
    wires.data();
    assert_eq!(wires.chip.violations(), Violations { sample: 1, ..Violations::default() });
}
