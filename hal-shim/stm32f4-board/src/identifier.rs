//! The chip's unique identifier.

/// Address of the identifier, three words (RM0090 39.1, RM0390 34.1).
const IDENTIFIER: *const [u32; 3] = 0x1fff_7a10 as *const [u32; 3];

/// The chip's unique identifier, 96 bits.
pub fn identifier() -> [u32; 3] {
    // SAFETY: three aligned words of the chip's system memory, which cannot be written.
    unsafe { core::ptr::read_volatile(IDENTIFIER) }
}
