//! All stores to the ports' registers.

use std::collections::BTreeMap;

use ferrostep_mainboard::machine::Store;
use ferrostep_testkit::boards::Pin;

/// Offset of the register that makes pins inputs or outputs, two bits each.
pub const MODER: u32 = 0x00;

/// Offset of the output data register.
pub const ODR: u32 = 0x14;

/// Offset of the register that sets pins by its lower and resets pins by its upper half.
pub const BSRR: u32 = 0x18;

/// The address of the ports' registers.
const PORTS: u32 = 0x4002_0000;

/// A store to a port's register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortWrite {
    /// The port's letter.
    pub port: char,
    /// The register.
    pub offset: u32,
    /// The stored value.
    pub value: u32,
}

impl PortWrite {
    /// The store as one to a port; `None` for other addresses (RM0090, 2.3: 1 KiB a port).
    pub fn of(store: &Store) -> Option<Self> {
        let place = store.address.checked_sub(PORTS)?;
        let port = u8::try_from(place / 0x400).ok().filter(|port| *port < 9)?;
        Some(Self { port: char::from(b'A' + port), offset: place % 0x400, value: store.value })
    }

    /// The level to which this store sets a pin; `None` if it leaves the level unchanged.
    pub fn level(&self, (port, number): Pin) -> Option<bool> {
        if self.port != port {
            return None;
        }
        let bit = |place: u8| self.value >> place & 1 == 1;
        match self.offset {
            // Setting wins over resetting.
            BSRR if bit(number) => Some(true),
            BSRR if bit(number + 16) => Some(false),
            ODR => Some(bit(number)),
            _ => None,
        }
    }

    /// The mode to which this store sets a pin; `None` if it leaves the mode unchanged.
    fn mode(&self, (port, number): Pin) -> Option<u32> {
        (self.port == port && self.offset == MODER).then_some(self.value >> (2 * number) & 0b11)
    }
}

/// The state of the pins after some stores.
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

    /// Applies a store.
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
                Some(_) => (*output, *alternate) = (*output & !bit, *alternate & !bit),
                None => {}
            }
        }
    }

    /// True if a pin's level is high, driven or not.
    pub fn is_high(&self, (port, number): Pin) -> bool {
        self.levels.get(&port).is_some_and(|level| level >> number & 1 == 1)
    }

    /// True if a pin is driven to its level.
    pub fn is_output(&self, (port, number): Pin) -> bool {
        self.outputs.get(&port).is_some_and(|output| output >> number & 1 == 1)
    }

    /// True if a peripheral drives the pin.
    pub fn is_alternate(&self, (port, number): Pin) -> bool {
        self.alternates.get(&port).is_some_and(|alternate| alternate >> number & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(port: char, offset: u32, value: u32) -> PortWrite {
        PortWrite { port, offset, value }
    }

    #[test]
    fn stores_to_ports_are_recognised() {
        let store = |address| Store { at_ns: 0, until_ns: 0, times: 1, address, value: 0x2000_0001 };
        assert_eq!(PortWrite::of(&store(0x4002_1418)), Some(write('F', BSRR, 0x2000_0001)));
        assert_eq!(PortWrite::of(&store(0x4002_2000)), Some(write('I', MODER, 0x2000_0001)));
        for address in [0x4001_fc18, 0x4002_2400, 0x4002_3874, 0x2000_0000] {
            assert_eq!(PortWrite::of(&store(address)), None, "{address:#x}");
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
        state.apply(write('B', MODER, 0b01 << 2 | 0b10 << 4));
        assert!(!state.is_high(heater) && state.is_output(heater));
        assert!(!state.is_output(other) && state.is_alternate(other));
        state.apply(write('B', MODER, 0b10 << 2));
        assert!(!state.is_output(heater) && state.is_alternate(heater) && !state.is_alternate(other));
        state.apply(write('B', ODR, 1 << 1));
        assert!(state.is_high(heater) && !state.is_high(other));
        // Setting wins.
        state.apply(write('B', BSRR, 1 << 2 | 1 << 18));
        assert!(state.is_high(other));
    }
}
