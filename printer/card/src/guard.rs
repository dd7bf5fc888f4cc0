//! Guards embedded-sdmmc from a damaged card, on which it would panic or read without end.
//!
//! embedded-sdmmc 0.10 trusts a card: a folder whose chain of clusters is a ring is read endlessly,
//! half of a surrogate pair in a long name or a cluster number of more than 28 bits panics. The
//! guard passes every block through, within a budget of blocks for each task. It refuses blocks
//! that the card does not have, and repairs the entries of folders.

use core::cell::Cell;

use ferrostep_hal_shim::card::{Block, BlockCount, BlockDevice, BlockIdx, CardError, CardSlot};

/// Bytes of an entry in a folder.
pub const SLOT_BYTES: usize = 32;
/// Attributes of an entry that holds a part of a long name.
const LONG_NAME: u8 = 0x0F;
/// Offset of an entry's attributes.
const ATTRIBUTES: usize = 11;
/// Bits 24 to 31 of a file's first cluster. The upper four do not belong to it.
const FIRST_CLUSTER_TOP: usize = 21;
/// The first character of a part of a long name, upper byte.
const FIRST_CHARACTER_TOP: usize = 2;

/// Purpose of reading blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A file's contents.
    Data,
    /// Folders, which may be written back.
    Folders,
    /// Folders with their long names, which are not written back.
    Names,
}

/// The area of a card that holds the volume's tables of clusters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tables {
    /// First block.
    pub start: u32,
    /// Length, blocks.
    pub blocks: u32,
}

/// Guard of a slot. For a card without a partition table, as some are formatted, it makes one up:
/// block 0 is that table, and the card's own blocks follow.
pub struct Guard<S> {
    slot: S,
    budget: Cell<u32>,
    purpose: Cell<Purpose>,
    tables: Cell<Tables>,
    /// The block after the volume's last one; without a mounted volume, the card's
    /// number of blocks.
    end: Cell<u32>,
    /// A block after the end was requested.
    passed_end: Cell<bool>,
    is_whole: Cell<bool>,
    /// Reason why a block could not be read or written.
    failed: Cell<Option<CardError>>,
    /// The block of a file's contents that was last read or requested.
    last_data: Cell<u32>,
}

impl<S: CardSlot> Guard<S> {
    /// Guard of a slot, without any budget yet.
    pub const fn new(slot: S) -> Self {
        Self {
            slot,
            budget: Cell::new(0),
            purpose: Cell::new(Purpose::Data),
            tables: Cell::new(Tables { start: 0, blocks: 0 }),
            end: Cell::new(u32::MAX),
            passed_end: Cell::new(false),
            is_whole: Cell::new(false),
            failed: Cell::new(None),
            last_data: Cell::new(0),
        }
    }

    /// The slot.
    pub fn slot(&self) -> &S {
        &self.slot
    }

    /// Notes that the volume begins at the card's first block.
    pub fn set_whole(&self) {
        self.is_whole.set(true);
    }

    /// Allows all blocks, for the search for a volume.
    pub fn open_all(&self) {
        self.end.set(u32::MAX);
        self.is_whole.set(false);
    }

    /// Sets the place of the volume's tables, which are not folders, and the block
    /// after its last one.
    pub fn set_volume(&self, tables: Tables, end: u32) {
        self.tables.set(tables);
        self.end.set(end);
    }

    /// Returns true if a block after the volume's end was asked for since the last call:
    /// embedded-sdmmc 0.10 takes a free place at the end of the table of clusters for a cluster.
    pub fn take_passed_end(&self) -> bool {
        self.passed_end.take()
    }

    /// Returns why a block could not be read or written since the last call: embedded-sdmmc 0.10
    /// takes a chain of clusters whose next number cannot be read for one that ends there.
    pub fn take_failed(&self) -> Option<CardError> {
        self.failed.take()
    }

    /// The block of a file's contents that was last read or requested.
    pub fn last_data(&self) -> BlockIdx {
        BlockIdx(self.last_data.get())
    }

    fn noted(&self, outcome: Result<(), CardError>) -> Result<(), CardError> {
        outcome.inspect_err(|&error| self.failed.set(Some(error)))
    }

    /// Begins a task that may read and write this many blocks.
    pub fn begin(&self, purpose: Purpose, budget: u32) {
        self.purpose.set(purpose);
        self.budget.set(budget);
    }

    /// Blocks that the task may still read and write.
    pub fn budget(&self) -> u32 {
        self.budget.get()
    }

    /// Sets what the next blocks are read for.
    pub fn set_purpose(&self, purpose: Purpose) {
        self.purpose.set(purpose);
    }

    /// The block of the card; `None` for the table that is made up.
    fn place(&self, block: BlockIdx) -> Result<Option<BlockIdx>, CardError> {
        if block.0 >= self.end.get() {
            self.passed_end.set(true);
            return Err(CardError::Damaged);
        }
        let left = self.budget.get().checked_sub(1).ok_or(CardError::Damaged)?;
        let place = if self.is_whole.get() { block.0.checked_sub(1) } else { Some(block.0) };
        let Some(place) = place else { return Ok(None) };
        if place >= self.slot.num_blocks()?.0 {
            return Err(CardError::Damaged);
        }
        self.budget.set(left);
        Ok(Some(BlockIdx(place)))
    }

    fn is_in_tables(&self, block: BlockIdx) -> bool {
        let Tables { start, blocks } = self.tables.get();
        block.0.wrapping_sub(start) < blocks
    }
}

/// Makes a table of partitions with one, of all blocks from the second on.
fn made_up_partitions(block: &mut Block, card_blocks: u32) {
    const FAT32: u8 = 0x0C;
    block.contents.fill(0);
    let entry = [0, 0, 0, 0, FAT32, 0, 0, 0, 1, 0, 0, 0];
    for (place, value) in block.contents.iter_mut().skip(446).zip(entry.into_iter().chain(card_blocks.to_le_bytes())) {
        *place = value;
    }
    for (place, value) in block.contents.iter_mut().skip(510).zip([0x55, 0xAA]) {
        *place = value;
    }
}

/// Repairs a folder's entries: cluster numbers keep 28 bits, and no part of a long name begins with
/// half a surrogate pair.
fn mend_folder(block: &mut Block, names_too: bool) {
    for slot in block.contents.as_chunks_mut::<SLOT_BYTES>().0 {
        let is_name = slot.get(ATTRIBUTES).is_some_and(|attributes| attributes & 0x3F == LONG_NAME);
        if is_name {
            if names_too
                && let Some(top) = slot.get_mut(FIRST_CHARACTER_TOP)
                && (0xD8..=0xDF).contains(top)
            {
                // Replaced by a Chinese character.
                *top = 0x4E;
            }
        } else if let Some(top) = slot.get_mut(FIRST_CLUSTER_TOP) {
            *top &= 0x0F;
        }
    }
}

impl<S: CardSlot> BlockDevice for Guard<S> {
    type Error = CardError;

    fn read(&self, blocks: &mut [Block], first: BlockIdx) -> Result<(), CardError> {
        for (index, block) in (first.0..=u32::MAX).zip(blocks) {
            let index = BlockIdx(index);
            let Some(place) = self.place(index)? else {
                made_up_partitions(block, self.slot.num_blocks()?.0);
                continue;
            };
            let purpose = self.purpose.get();
            let is_table = self.is_in_tables(index);
            if purpose == Purpose::Data && !is_table {
                self.last_data.set(index.0);
            }
            self.noted(self.slot.read(core::slice::from_mut(block), place))?;
            if purpose != Purpose::Data && !is_table {
                mend_folder(block, purpose == Purpose::Names);
            }
        }
        Ok(())
    }

    fn write(&self, blocks: &[Block], first: BlockIdx) -> Result<(), CardError> {
        for (index, block) in (first.0..=u32::MAX).zip(blocks) {
            // Blocks read for their names are repaired: written back, they would change the card.
            if self.purpose.get() == Purpose::Names {
                return Err(CardError::Damaged);
            }
            match self.place(BlockIdx(index))? {
                Some(place) => self.noted(self.slot.write(core::slice::from_ref(block), place))?,
                None => return Err(CardError::Damaged),
            }
        }
        Ok(())
    }

    fn num_blocks(&self) -> Result<BlockCount, CardError> {
        Ok(BlockCount(self.slot.num_blocks()?.0.saturating_add(u32::from(self.is_whole.get()))))
    }
}
