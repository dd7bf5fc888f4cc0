//! Registers of a chip behind a trait, so that what a peripheral's set-up writes can be recorded and read in a test.

/// A chip's registers of 32 bits, by address.
pub trait Registers {
    /// What a register reads.
    fn read(&mut self, address: u32) -> u32;

    /// Stores to a register.
    fn write(&mut self, address: u32, value: u32);

    /// A register becomes `old & !clear | set`.
    fn modify(&mut self, address: u32, clear: u32, set: u32) {
        let old = self.read(address);
        self.write(address, old & !clear | set);
    }

    /// Whether some bits of a register all become `level` within so many looks.
    fn comes_to(&mut self, address: u32, bits: u32, level: bool, most_looks: u32) -> bool {
        let wanted = if level { bits } else { 0 };
        (0..most_looks).any(|_| self.read(address) & bits == wanted)
    }
}

#[cfg(test)]
pub mod recorder {
    //! Registers that exist in memory only and remember every store.

    use std::collections::BTreeMap;

    use super::Registers;

    /// Memory in the place of a chip: what was stored is read back, unless a value was fixed.
    #[derive(Clone, Debug, Default)]
    pub struct Recorder {
        values: BTreeMap<u32, u32>,
        fixed: BTreeMap<u32, u32>,
        /// Every store, in order: address and value.
        pub stores: Vec<(u32, u32)>,
    }

    impl Recorder {
        /// A register's value after reset, if it is not 0.
        pub fn with(mut self, address: u32, value: u32) -> Self {
            self.values.insert(address, value);
            self
        }

        /// A register that reads this whatever is stored to it: the hardware's own.
        pub fn fix(&mut self, address: u32, value: u32) {
            self.fixed.insert(address, value);
        }

        /// The last value of a register.
        pub fn value(&self, address: u32) -> u32 {
            self.values.get(&address).copied().unwrap_or_default()
        }

        /// Values stored to a register, in order.
        pub fn stored(&self, address: u32) -> Vec<u32> {
            self.stores.iter().filter(|(to, _)| *to == address).map(|(_, value)| *value).collect()
        }

        /// Where the first store to a register stands that has these bits.
        pub fn position(&self, address: u32, bits: u32) -> Option<usize> {
            self.stores.iter().position(|(to, value)| *to == address && value & bits == bits)
        }
    }

    impl Registers for Recorder {
        fn read(&mut self, address: u32) -> u32 {
            self.fixed.get(&address).copied().unwrap_or_else(|| self.value(address))
        }

        fn write(&mut self, address: u32, value: u32) {
            self.values.insert(address, value);
            self.stores.push((address, value));
        }
    }
}
