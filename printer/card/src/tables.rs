//! Frees the clusters of a deleted file, which embedded-sdmmc leaves marked as used.

use ferrostep_hal_shim::card::{Block, BlockDevice, BlockIdx, CardSlot};

use crate::failure::CardFailure;
use crate::guard::{Guard, SLOT_BYTES};
use crate::volume::Mounted;

/// First cluster in a folder's entry on the card.
///
/// # Errors
/// The card cannot be read.
pub fn first_cluster<S: CardSlot>(
    guard: &Guard<S>,
    mounted: &Mounted,
    block: BlockIdx,
    offset: u32,
) -> Result<u32, CardFailure> {
    let mut blocks = [Block::new()];
    guard.read(&mut blocks, block)?;
    let [block] = &blocks;
    let slot = block.contents.get(offset as usize..).and_then(|rest| rest.get(..SLOT_BYTES)).unwrap_or_default();
    let byte = |at: usize| u32::from(slot.get(at).copied().unwrap_or_default());
    let low = byte(26) | byte(27) << 8;
    Ok(if mounted.layout.is_fat32 { low | byte(20) << 16 | (byte(21) & 0x0F) << 24 } else { low })
}

/// Frees the chain of clusters from this one on, in all tables. A chain that leaves the volume,
/// comes to a free cluster or is longer than the volume ends there.
///
/// # Errors
/// The card cannot be read or written.
pub fn free_chain<S: CardSlot>(guard: &Guard<S>, mounted: &Mounted, first: u32) -> Result<(), CardFailure> {
    let layout = &mounted.layout;
    let entry_bytes: u32 = if layout.is_fat32 { 4 } else { 2 };
    let mut blocks = [Block::new()];
    let mut loaded = None;
    let mut cluster = first;
    while layout.has(cluster) {
        let index = cluster * entry_bytes / Block::LEN_U32;
        if loaded != Some(index) {
            if let Some(changed) = loaded {
                write_tables(guard, mounted, changed, &blocks)?;
            }
            guard.read(&mut blocks, table_block(mounted, 0, index))?;
            loaded = Some(index);
        }
        let [block] = &mut blocks;
        let at = (cluster * entry_bytes % Block::LEN_U32) as usize;
        let Some(entry) = block.contents.get_mut(at..at + entry_bytes as usize) else { break };
        let value = entry.iter().rev().fold(0_u32, |value, &byte| value << 8 | u32::from(byte));
        // The upper four bits are not part of the number and stay.
        entry.iter_mut().enumerate().for_each(|(place, byte)| *byte &= if place == 3 { 0xF0 } else { 0 });
        cluster = if layout.is_fat32 { value & 0x0FFF_FFFF } else { value };
    }
    match loaded {
        Some(changed) => write_tables(guard, mounted, changed, &blocks),
        None => Ok(()),
    }
}

fn table_block(mounted: &Mounted, table: u32, index: u32) -> BlockIdx {
    let layout = &mounted.layout;
    BlockIdx(mounted.start + layout.table_start + table * layout.table_blocks + index)
}

fn write_tables<S: CardSlot>(
    guard: &Guard<S>,
    mounted: &Mounted,
    index: u32,
    block: &[Block; 1],
) -> Result<(), CardFailure> {
    for table in 0..mounted.layout.tables {
        guard.write(block, table_block(mounted, table, index))?;
    }
    Ok(())
}
