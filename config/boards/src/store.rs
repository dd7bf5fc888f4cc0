//! A store to a register, as the firmware makes it from a table.

/// A register becomes `old & !clear | set`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Store {
    /// The register.
    pub address: u32,
    /// Bits that become 0, unless they are set.
    pub clear: u32,
    /// Bits that become 1.
    pub set: u32,
}

impl Store {
    /// A store that needs no read.
    pub(crate) fn word(address: u32, word: u32) -> Self {
        Self { address, clear: u32::MAX, set: word }
    }
}
