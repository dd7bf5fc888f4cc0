//! A trait for a chip's registers, so that tests can record and read the stores of a
//! peripheral's set-up.

/// A chip's registers of 32 bits, by address.
pub trait Registers {
    /// Loads a register.
    fn read(&mut self, address: u32) -> u32;

    /// Stores to a register.
    fn write(&mut self, address: u32, value: u32);

    /// A register becomes `old & !clear | set`.
    fn modify(&mut self, address: u32, clear: u32, set: u32) {
        let old = self.read(address);
        self.write(address, old & !clear | set);
    }

    /// Switches clocks on in a register of the RCC and reads it back: the part may lose stores
    /// in the first cycles after this one (erratum "delay after an RCC peripheral clock
    /// enabling": ES0182 for the STM32F405 and F407, ES0298 for the STM32F446), and the load
    /// takes longer than that.
    fn switch_clocks_on(&mut self, address: u32, clocks: u32) {
        self.modify(address, 0, clocks);
        let _switched_on = self.read(address);
    }

    /// Returns true if some bits of a register all become `level` within `max_looks` looks.
    #[inline(never)]
    fn comes_to(&mut self, address: u32, bits: u32, level: bool, max_looks: u32) -> bool {
        let wanted = if level { bits } else { 0 };
        (0..max_looks).any(|_| self.read(address) & bits == wanted)
    }
}

impl<R: Registers> Registers for &mut R {
    fn read(&mut self, address: u32) -> u32 {
        R::read(self, address)
    }

    fn write(&mut self, address: u32, value: u32) {
        R::write(self, address, value);
    }

    fn modify(&mut self, address: u32, clear: u32, set: u32) {
        R::modify(self, address, clear, set);
    }

    fn switch_clocks_on(&mut self, address: u32, clocks: u32) {
        R::switch_clocks_on(self, address, clocks);
    }
}

#[cfg(test)]
pub mod recorder;
