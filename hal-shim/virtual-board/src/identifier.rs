//! The virtual board's own number.

/// Replaces a chip's unique identifier: `VIRTUALBOARD` in ASCII, the same on every desk.
pub const IDENTIFIER: [u32; 3] =
    [u32::from_be_bytes(*b"VIRT"), u32::from_be_bytes(*b"UALB"), u32::from_be_bytes(*b"OARD")];
