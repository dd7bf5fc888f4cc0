//! Register stores listed in a table: how the board file becomes pins.

/// A change of a register to `old & !clear | set`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Store {
    /// Address of the register.
    pub address: u32,
    /// Bits that become 0, unless they are set.
    pub clear: u32,
    /// Bits that become 1.
    pub set: u32,
}

/// Makes the stores, in order.
///
/// # Safety
/// Each address is a 32-bit register that may be read and may take this value at this time, and no
/// other code changes it meanwhile.
pub(crate) unsafe fn apply(stores: &[Store]) {
    for &Store { address, clear, set } in stores {
        let register = address as *mut u32;
        // SAFETY: as promised.
        unsafe { register.write_volatile(register.read_volatile() & !clear | set) };
    }
}
