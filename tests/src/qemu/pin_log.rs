//! What the image did to the pins of its motors on one port, from the emulator's log of devices that it does not have.

use std::io::{self, BufRead, BufReader};
use std::path::Path;

use super::port_log::{BSRR, ODR, offset_and_value};
use crate::trace_check::Fnv1a64;

/// Which pins of one port do what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pins {
    /// The port's letter.
    pub port: char,
    /// Pin that steps each motor: X (A), Y (B), Z, E. A rising edge is a step.
    pub step: [u8; 4],
    /// Pin that gives each motor's direction; high = backwards.
    pub direction: [u8; 4],
    /// Pin that switches all motors off while it is high.
    pub disable: u8,
}

impl Pins {
    /// The bench board: Olimex H405.
    pub const BENCH: Self = Self { port: 'C', step: [0, 1, 2, 3], direction: [4, 5, 6, 7], disable: 8 };
}

/// Motors that stepped at the same moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEvent {
    /// Bit i = motor i steps.
    pub axes: u8,
    /// Bit i = motor i steps backwards.
    pub directions: u8,
}

/// The edges of a log.
#[derive(Clone, Debug)]
pub struct PinLog {
    pins: Pins,
    prefix: Vec<u8>,
    level: u16,
    events: Vec<PinEvent>,
}

impl PinLog {
    /// An empty log: all pins low, as after reset.
    pub fn new(pins: Pins) -> Self {
        let prefix = format!("GPIO{}: unimplemented device write (size 4, offset 0x", pins.port).into_bytes();
        Self { pins, prefix, level: 0, events: Vec::new() }
    }

    /// Decodes a log file.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(path: &Path, pins: Pins) -> io::Result<Self> {
        let mut log = Self::new(pins);
        let mut file = BufReader::with_capacity(1 << 20, std::fs::File::open(path)?);
        let mut line = Vec::new();
        while file.read_until(b'\n', &mut line)? > 0 {
            log.add_line(&line);
            line.clear();
        }
        Ok(log)
    }

    /// Takes a line of the log; those about anything else change nothing.
    pub fn add_line(&mut self, line: &[u8]) {
        let Some(access) = line.strip_prefix(self.prefix.as_slice()) else { return };
        let Some((offset, value)) = offset_and_value(access) else { return };
        let level = match offset {
            // Setting wins where both are asked for.
            BSRR => self.level & !((value >> 16) as u16) | value as u16,
            ODR => value as u16,
            _ => return,
        };
        let rising = level & !self.level;
        self.level = level;
        let axes = motors(rising, self.pins.step);
        if axes != 0 {
            self.events.push(PinEvent { axes, directions: axes & motors(level, self.pins.direction) });
        }
    }

    /// All steps, in order.
    pub fn events(&self) -> &[PinEvent] {
        &self.events
    }

    /// Whether the motors are switched off at the end of the log.
    pub fn motors_disabled(&self) -> bool {
        self.level >> self.pins.disable & 1 == 1
    }

    /// FNV-1a-64 over the (axes, directions) bytes of all events.
    pub fn order_digest(&self) -> u64 {
        let mut digest = Fnv1a64::default();
        for event in &self.events {
            digest.write(&[event.axes, event.directions]);
        }
        digest.0
    }

    /// Steps of each motor, both directions added.
    pub fn issued(&self) -> [u64; 4] {
        let mut issued = [0; 4];
        for event in &self.events {
            for (motor, steps) in issued.iter_mut().enumerate() {
                *steps += u64::from(event.axes >> motor & 1);
            }
        }
        issued
    }

    /// Where each motor has come to from where it stood at reset, in steps.
    pub fn displacement(&self) -> [i64; 4] {
        let mut displacement = [0; 4];
        for event in &self.events {
            for (motor, steps) in displacement.iter_mut().enumerate() {
                *steps += i64::from(event.axes >> motor & 1) - 2 * i64::from(event.directions >> motor & 1);
            }
        }
        displacement
    }
}

/// Mask of the motors whose pin is in `level`.
fn motors(level: u16, pins: [u8; 4]) -> u8 {
    pins.iter().enumerate().fold(0, |mask, (motor, pin)| mask | (u8::from(level >> pin & 1 == 1)) << motor)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn log_of(stores: &[(char, u32, u32)]) -> PinLog {
        let mut log = PinLog::new(Pins::BENCH);
        for (port, offset, value) in stores {
            let line = format!(
                "GPIO{port}: unimplemented device write (size 4, offset 0x{offset:03x}, value 0x{value:08x})\n"
            );
            log.add_line(line.as_bytes());
        }
        log
    }

    fn events(log: &PinLog) -> Vec<(u8, u8)> {
        log.events().iter().map(|event| (event.axes, event.directions)).collect()
    }

    #[test]
    fn steps_are_rising_edges_with_the_direction_of_the_moment() {
        let log = log_of(&[
            ('C', 0x18, 0x0000_0001),
            ('C', 0x18, 0x0001_0000),
            // X backwards.
            ('C', 0x18, 0x0000_0010),
            ('C', 0x18, 0x0000_0003),
            ('C', 0x18, 0x0003_0000),
            // Forwards again, Z and E backwards; only E steps.
            ('C', 0x18, 0x0010_00c0),
            ('C', 0x18, 0x0000_0008),
        ]);
        assert_eq!(events(&log), [(0b1, 0), (0b11, 0b1), (0b1000, 0b1000)]);
        assert_eq!(log.issued(), [2, 1, 0, 1]);
        assert_eq!(log.displacement(), [0, 1, 0, -1]);
    }

    #[test]
    fn a_pin_that_is_high_already_does_not_step() {
        let log = log_of(&[('C', 0x18, 1), ('C', 0x18, 1), ('C', 0x18, 0x0001_0001), ('C', 0x14, 1), ('C', 0x14, 5)]);
        assert_eq!(events(&log), [(0b1, 0), (0b100, 0)]);
    }

    #[test]
    fn other_registers_ports_and_reads_are_not_steps() {
        let mut log = log_of(&[('A', 0x18, 1), ('C', 0x00, 1), ('C', 0x20, 1), ('B', 0x14, 0xf)]);
        for line in [
            "GPIOC: unimplemented device read  (size 4, offset 0x018)\n",
            "GPIOC: unimplemented device write (size 4, offset 0x018, value 0x000000",
            "GPIOC: unimplemented device write (size 2, offset 0x018, value 0x0001)\n",
            "GPIOC: unimplemented device write (size 4, offset 0x018, value 0xzz)\n",
            "RCC: unimplemented device write (size 4, offset 0x018, value 0x00000001)\n",
            "",
        ] {
            log.add_line(line.as_bytes());
        }
        log.add_line(b"GPIOC: unimplemented device write (size 4, offset 0x\xff\n");
        assert_eq!(events(&log), []);
    }

    #[test]
    fn the_digest_is_that_of_the_bytes() {
        assert_eq!(log_of(&[]).order_digest(), 0xcbf2_9ce4_8422_2325);
        // FNV-1a-64 of the two bytes 01 01.
        let log = log_of(&[('C', 0x18, 0x10), ('C', 0x18, 0x1)]);
        let by_hand = [1_u8, 1].iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        assert_eq!(log.order_digest(), by_hand);
    }

    #[test]
    fn the_motors_are_off_while_the_pin_is_high() {
        assert!(!log_of(&[]).motors_disabled());
        assert!(log_of(&[('C', 0x18, 0x100)]).motors_disabled());
        assert!(!log_of(&[('C', 0x18, 0x100), ('C', 0x18, 0x0100_0000)]).motors_disabled());
    }

    #[test]
    fn a_file_is_read_to_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pins.log");
        let line = "GPIOC: unimplemented device write (size 4, offset 0x018, value 0x00000002)\n";
        std::fs::write(&path, format!("RCC: unimplemented device read  (size 4, offset 0x000)\n{line}{}", &line[..40]))
            .unwrap();
        assert_eq!(events(&PinLog::read(&path, Pins::BENCH).unwrap()), [(0b10, 0)]);
        assert!(PinLog::read(&folder.path().join("none"), Pins::BENCH).is_err());
    }
}
