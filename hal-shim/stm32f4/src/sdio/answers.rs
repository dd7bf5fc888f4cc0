//! The answers of a card (SD Physical Layer Simplified Specification 4.10 and 5.3).

/// Error bits in the answer R1, without "ready for data" and the state.
pub const R1_ERRORS: u32 = 0xfdf9_a008;
/// The state in which blocks are read and written, and those in which one is sent or expected.
const TRANSFER_STATE: u32 = 4;
const SENDING_STATE: u32 = 5;
const RECEIVING_STATE: u32 = 6;

/// Capacity of a card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Blocks of 512 bytes.
    pub blocks: u32,
}

/// Reads the capacity from the upper 96 bits of the register CSD, the highest first; `None` for a
/// layout that does not exist yet.
pub fn capacity([high, middle, low]: [u32; 3]) -> Option<Capacity> {
    match high >> 30 {
        0 => {
            let block_bits = middle >> 16 & 0xf;
            let size = (middle & 0x3ff) << 2 | low >> 30;
            let multiplier_bits = low >> 15 & 7;
            // At most 2^12 * 2^9 blocks of 2^11 bytes.
            let bits = (multiplier_bits + 2 + block_bits).checked_sub(9)?;
            Some(Capacity { blocks: (size + 1).checked_mul(1 << bits)? })
        }
        1 => {
            let size = (middle & 0x3f) << 16 | low >> 16;
            // The last block of the largest possible card, 2 TiB, has no number.
            Some(Capacity { blocks: (size + 1).saturating_mul(1024) })
        }
        _ => None,
    }
}

/// Returns true if the card's state says that the next block may come.
pub fn is_ready_for_transfer(state: u32) -> bool {
    let is_ready = state >> 8 & 1 == 1;
    is_ready && state >> 9 & 0xf == TRANSFER_STATE
}

/// Returns true if the card sends a block or expects one.
pub fn is_in_transfer(state: u32) -> bool {
    matches!(state >> 9 & 0xf, SENDING_STATE | RECEIVING_STATE)
}
