//! The chip's registers, for the adapters of hal-shim that reach them by address.

use ferrostep_stm32f4::registers::Registers;

/// Volatile loads and stores.
#[derive(Debug)]
pub struct Volatile(());

impl Volatile {
    /// # Safety
    /// It is used by an adapter of `ferrostep_stm32f4` only, whose registers no other code
    /// changes meanwhile.
    pub(crate) const unsafe fn new() -> Self {
        Self(())
    }
}

impl Registers for Volatile {
    #[inline]
    fn read(&mut self, address: u32) -> u32 {
        // SAFETY: a register of 32 bits, by the contract of `new`.
        unsafe { (address as *const u32).read_volatile() }
    }

    #[inline]
    fn write(&mut self, address: u32, value: u32) {
        // SAFETY: as above; tests on a PC read what the adapters store.
        unsafe { (address as *mut u32).write_volatile(value) };
    }
}
