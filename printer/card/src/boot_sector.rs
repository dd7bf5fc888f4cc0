//! A volume's first block, checked before embedded-sdmmc uses its numbers.

use ferrostep_hal_shim::card::Block;

use crate::guard::Tables;

/// Fewest clusters of FAT16 and of FAT32 (Microsoft's FAT specification).
const FAT16_CLUSTERS: u32 = 4085;
const FAT32_CLUSTERS: u32 = 65_525;
/// Clusters 0 and 1 do not exist.
pub const FIRST_CLUSTER: u32 = 2;
/// Higher numbers are marks, not clusters.
const MAX_CLUSTERS: u32 = 0x0FFF_FFF5;

/// Reason why a block is not the first of a FAT volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoVolume {
    /// The block does not look like the first of a volume.
    Foreign,
    /// The block is the first of an exFAT volume.
    ExFat,
    /// The block's numbers contradict each other or the card.
    Damaged,
}

/// A volume, as its first block describes it; blocks count from the volume's first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Length of the volume, blocks.
    pub blocks: u32,
    /// The first table of clusters.
    pub table_start: u32,
    /// Length of a table, blocks.
    pub table_blocks: u32,
    /// Number of tables: 1 or 2.
    pub tables: u32,
    /// Blocks in a cluster.
    pub cluster_blocks: u32,
    /// Clusters, numbered from 2.
    pub clusters: u32,
    /// FAT32, or FAT16.
    pub is_fat32: bool,
}

impl Layout {
    /// Reads a volume's first block; the card has `blocks` blocks from there on.
    ///
    /// # Errors
    /// The volume is not FAT16 or FAT32, or is damaged.
    pub fn read(block: &Block, blocks: u32) -> Result<Self, NoVolume> {
        let byte = |at: usize| u32::from(block.contents.get(at).copied().unwrap_or_default());
        let u16_at = |at: usize| byte(at) | byte(at + 1) << 8;
        let u32_at = |at: usize| u16_at(at) | u16_at(at + 2) << 16;
        if u16_at(510) != 0xAA55 {
            return Err(NoVolume::Foreign);
        }
        if block.contents.get(3..11) == Some(b"EXFAT   ") {
            return Err(NoVolume::ExFat);
        }
        let has_jump = byte(0) == 0xEB || byte(0) == 0xE9;
        let (cluster_blocks, table_start, tables) = (byte(13), u16_at(14), byte(16));
        if !has_jump || u16_at(11) != 512 || !cluster_blocks.is_power_of_two() || table_start == 0 {
            return Err(NoVolume::Foreign);
        }
        let either = |short: u32, long: u32| if short != 0 { short } else { long };
        let table_blocks = either(u16_at(22), u32_at(36));
        let total = either(u16_at(19), u32_at(32));
        let root_blocks = (u16_at(17) * 32).div_ceil(512);
        let data_start = tables
            .checked_mul(table_blocks)
            .and_then(|tables| tables.checked_add(table_start)?.checked_add(root_blocks))
            .ok_or(NoVolume::Damaged)?;
        let data = total.checked_sub(data_start).ok_or(NoVolume::Damaged)?;
        let clusters = data / cluster_blocks;
        let is_fat32 = clusters >= FAT32_CLUSTERS;
        let entry_bytes = if is_fat32 { 4 } else { 2 };
        let table_room = u64::from(table_blocks) * 512 / entry_bytes;
        let is_possible = (1..=2).contains(&tables)
            && total <= blocks
            && (FAT16_CLUSTERS..=MAX_CLUSTERS).contains(&clusters)
            && table_room >= u64::from(clusters) + u64::from(FIRST_CLUSTER);
        let layout = Self { blocks: total, table_start, table_blocks, tables, cluster_blocks, clusters, is_fat32 };
        let is_rooted = if is_fat32 { root_blocks == 0 && layout.has(u32_at(44)) } else { root_blocks != 0 };
        if is_possible && is_rooted { Ok(layout) } else { Err(NoVolume::Damaged) }
    }

    /// True if the volume has this cluster.
    pub fn has(&self, cluster: u32) -> bool {
        cluster.wrapping_sub(FIRST_CLUSTER) < self.clusters
    }

    /// Place of the volume's tables on a card where the volume begins at `start`.
    pub fn tables_at(&self, start: u32) -> Tables {
        Tables { start: start.saturating_add(self.table_start), blocks: self.tables * self.table_blocks }
    }

    /// Length of all clusters, bytes.
    pub fn data_bytes(&self) -> u64 {
        u64::from(self.clusters) * u64::from(self.cluster_blocks) * 512
    }
}

/// The first partition that may be a FAT volume: its index, and the block at which it begins.
pub fn first_partition(block: &Block) -> Option<(usize, u32)> {
    const TYPES: [u8; 5] = [0x04, 0x06, 0x0B, 0x0C, 0x0E];
    (0..4).find_map(|index| {
        let entry = block.contents.get(446 + 16 * index..)?;
        let start = u32::from_le_bytes(entry.get(8..12)?.try_into().ok()?);
        (TYPES.contains(entry.get(4)?) && start != 0).then_some((index, start))
    })
}

/// True if a partition is of the type of exFAT (and NTFS).
pub fn has_exfat_partition(block: &Block) -> bool {
    block.contents.get(446 + 4) == Some(&0x07)
}
