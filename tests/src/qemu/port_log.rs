//! All stores to the ports' registers, from the emulator's log of devices that it does not have.
//!
//! A line is `GPIOC: unimplemented device write (size 4, offset 0x018, value 0x00000020)`, in the program's order.

use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

/// Offset of the register that makes pins inputs or outputs, two bits each.
pub const MODER: u32 = 0x00;

/// Offset of the output data register.
pub const ODR: u32 = 0x14;

/// Offset of the register that sets pins by its lower and resets pins by its upper half.
pub const BSRR: u32 = 0x18;

/// A pin: its port's letter and its number.
pub type Pin = (char, u8);

/// A store to a port's register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortWrite {
    /// The port's letter.
    pub port: char,
    /// The register.
    pub offset: u32,
    /// What was stored.
    pub value: u32,
}

impl PortWrite {
    /// The store that a line of the log tells; lines about anything else, or still being written, tell none.
    pub fn of_line(line: &[u8]) -> Option<Self> {
        let rest = line.strip_prefix(b"GPIO")?;
        let (&port, rest) = rest.split_first()?;
        let rest = rest.strip_prefix(b": unimplemented device write (size 4, offset 0x")?;
        let (offset, value) = offset_and_value(rest)?;
        port.is_ascii_uppercase().then_some(Self { port: port.into(), offset, value })
    }

    /// All stores of a log.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(path: &Path) -> io::Result<Vec<Self>> {
        let mut file = BufReader::with_capacity(1 << 20, std::fs::File::open(path)?);
        let (mut writes, mut line) = (Vec::new(), Vec::new());
        while file.read_until(b'\n', &mut line)? > 0 {
            writes.extend(Self::of_line(&line));
            line.clear();
        }
        Ok(writes)
    }

    /// The level that this store gives a pin, if it is about its level.
    pub fn level(&self, (port, number): Pin) -> Option<bool> {
        if self.port != port {
            return None;
        }
        let bit = |place: u8| self.value >> place & 1 == 1;
        match self.offset {
            // Setting wins where both are asked for.
            BSRR if bit(number) => Some(true),
            BSRR if bit(number + 16) => Some(false),
            ODR => Some(bit(number)),
            _ => None,
        }
    }

    /// Whether this store makes a pin an output.
    pub fn makes_output(&self, (port, number): Pin) -> bool {
        self.mode((port, number)) == Some(0b01)
    }

    /// The mode that this store gives a pin, if it may be about that.
    fn mode(&self, (port, number): Pin) -> Option<u32> {
        (self.port == port && self.offset == MODER).then_some(self.value >> (2 * number) & 0b11)
    }
}

/// The pins as a log leaves them. An output, or a peripheral's pin, stays one until it becomes the other: the emulator's
/// ports read as 0, so that a store to some pins' fields would seem to take back the others'.
#[derive(Clone, Debug, Default)]
pub struct PortState {
    levels: BTreeMap<char, u16>,
    outputs: BTreeMap<char, u16>,
    alternates: BTreeMap<char, u16>,
}

impl PortState {
    /// All pins low and inputs, as after reset.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a store.
    pub fn apply(&mut self, write: PortWrite) {
        let (level, output) = (self.levels.entry(write.port).or_default(), self.outputs.entry(write.port).or_default());
        let alternate = self.alternates.entry(write.port).or_default();
        for number in 0..16 {
            let pin = (write.port, number);
            match write.level(pin) {
                Some(true) => *level |= 1 << number,
                Some(false) => *level &= !(1 << number),
                None => {}
            }
            let bit = 1 << number;
            match write.mode(pin) {
                Some(0b01) => (*output, *alternate) = (*output | bit, *alternate & !bit),
                Some(0b10) => (*output, *alternate) = (*output & !bit, *alternate | bit),
                _ => {}
            }
        }
    }

    /// Whether a pin's level is high, driven or not.
    pub fn is_high(&self, (port, number): Pin) -> bool {
        self.levels.get(&port).is_some_and(|level| level >> number & 1 == 1)
    }

    /// Whether a pin is driven to its level.
    pub fn is_output(&self, (port, number): Pin) -> bool {
        self.outputs.get(&port).is_some_and(|output| output >> number & 1 == 1)
    }

    /// Whether a pin is a peripheral's.
    pub fn is_alternate(&self, (port, number): Pin) -> bool {
        self.alternates.get(&port).is_some_and(|alternate| alternate >> number & 1 == 1)
    }
}

/// The numbers of `018, value 0x00000020)`. A line that is still being written has no closing bracket.
pub(super) fn offset_and_value(access: &[u8]) -> Option<(u32, u32)> {
    let access = std::str::from_utf8(access).ok()?;
    let (offset, value) = access.split_once(", value 0x")?;
    let (value, _) = value.split_once(')')?;
    Some((u32::from_str_radix(offset, 16).ok()?, u32::from_str_radix(value, 16).ok()?))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn write(port: char, offset: u32, value: u32) -> PortWrite {
        PortWrite { port, offset, value }
    }

    #[test]
    fn stores_to_ports_are_told_from_all_else() {
        let line = b"GPIOF: unimplemented device write (size 4, offset 0x018, value 0x20000001)\n";
        assert_eq!(PortWrite::of_line(line), Some(write('F', 0x18, 0x2000_0001)));
        for line in [
            "GPIOF: unimplemented device read  (size 4, offset 0x018)\n",
            "GPIOF: unimplemented device write (size 2, offset 0x018, value 0x0001)\n",
            "GPIOF: unimplemented device write (size 4, offset 0x018, value 0x0001",
            "GPIO: unimplemented device write (size 4, offset 0x018, value 0x00000001)\n",
            "RCC: unimplemented device write (size 4, offset 0x018, value 0x00000001)\n",
            "",
        ] {
            assert_eq!(PortWrite::of_line(line.as_bytes()), None, "{line}");
        }
    }

    #[test]
    fn levels_and_outputs_are_kept() {
        let mut state = PortState::new();
        let (heater, other) = (('B', 1), ('B', 2));
        state.apply(write('B', BSRR, 1 << 1 | 1 << 2));
        assert!(state.is_high(heater) && state.is_high(other) && !state.is_output(heater));
        state.apply(write('C', BSRR, 1 << 17));
        assert!(state.is_high(heater));
        state.apply(write('B', BSRR, 1 << 17));
        state.apply(write('B', MODER, 0b01 << 2));
        // An alternate function is no output, and takes no other's place.
        state.apply(write('B', MODER, 0b10 << 4));
        assert!(!state.is_high(heater) && state.is_output(heater) && !state.is_output(other));
        state.apply(write('B', ODR, 1 << 1));
        assert!(state.is_high(heater) && !state.is_high(other));
        // Setting wins.
        state.apply(write('B', BSRR, 1 << 2 | 1 << 18));
        assert!(state.is_high(other));
    }

    #[test]
    fn a_file_is_read_to_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pins.log");
        let line = "GPIOB: unimplemented device write (size 4, offset 0x018, value 0x00000002)\n";
        std::fs::write(&path, format!("{line}RCC: unimplemented device read  (size 4, offset 0x000)\n{}", &line[..40]))
            .unwrap();
        assert_eq!(PortWrite::read(&path).unwrap(), [write('B', BSRR, 2)]);
        assert!(PortWrite::read(&folder.path().join("none")).is_err());
    }
}
