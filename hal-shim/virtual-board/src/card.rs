//! A memory card in its slot: an image in memory, with faults.

use core::cell::RefCell;
use core::ops::Range;

use ferrostep_hal_shim::card::{Block, BlockCount, BlockDevice, BlockIdx, CardError, CardSlot};

/// A fault of a card.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CardFault {
    /// The card is pulled out after this number of further accesses.
    PulledAfter(u32),
    /// These blocks cannot be read.
    Unreadable(Range<u32>),
    /// These blocks are read with a changed bit, unnoticed.
    Corrupted(Range<u32>),
    /// Number of reads that fail, as on a bad contact.
    FailingReads(u32),
    /// The card cannot be written.
    Unwritable,
}

#[derive(Debug)]
struct State<M> {
    image: M,
    inserted: bool,
    started: bool,
    fault: Option<CardFault>,
    accesses: u64,
}

impl<M> State<M> {
    /// An access to a block, unless the card is gone.
    fn access(&mut self) -> Result<(), CardError> {
        self.accesses += 1;
        match &mut self.fault {
            Some(CardFault::PulledAfter(0)) => {
                (self.inserted, self.started, self.fault) = (false, false, None);
            }
            Some(CardFault::PulledAfter(left)) => *left -= 1,
            _ => {}
        }
        if !self.inserted {
            return Err(CardError::Missing);
        }
        if self.started { Ok(()) } else { Err(CardError::Silent) }
    }
}

/// A slot with a card, whose blocks are the bytes of an image.
#[derive(Debug)]
pub struct VirtualCard<M>(RefCell<State<M>>);

impl<M: AsRef<[u8]> + AsMut<[u8]>> VirtualCard<M> {
    /// Slot with a card in it. Bytes of the image after its last whole block are out of reach.
    pub const fn new(image: M) -> Self {
        Self(RefCell::new(State { image, inserted: true, started: false, fault: None, accesses: 0 }))
    }

    /// Pulls the card out.
    pub fn pull(&self) {
        let mut state = self.0.borrow_mut();
        (state.inserted, state.started) = (false, false);
    }

    /// Puts the card in again.
    pub fn insert(&self) {
        self.0.borrow_mut().inserted = true;
    }

    /// Puts another card in.
    pub fn insert_other(&self, image: M) {
        let mut state = self.0.borrow_mut();
        (state.image, state.inserted, state.started) = (image, true, false);
    }

    /// Sets its fault.
    pub fn set_fault(&self, fault: Option<CardFault>) {
        self.0.borrow_mut().fault = fault;
    }

    /// Blocks that were read and written so far, and attempts.
    pub fn accesses(&self) -> u64 {
        self.0.borrow().accesses
    }

    /// Calls `act` with the card's bytes.
    pub fn with_image<T>(&self, act: impl FnOnce(&mut M) -> T) -> T {
        act(&mut self.0.borrow_mut().image)
    }
}

/// Range of a block's bytes in the image.
fn range(block: BlockIdx, index: usize) -> Result<Range<usize>, CardError> {
    let start = usize::try_from(block.into_bytes()).ok().and_then(|start| start.checked_add(index * Block::LEN));
    let start = start.ok_or(CardError::Damaged)?;
    Ok(start..start.checked_add(Block::LEN).ok_or(CardError::Damaged)?)
}

impl<M: AsRef<[u8]> + AsMut<[u8]>> BlockDevice for VirtualCard<M> {
    type Error = CardError;

    fn read(&self, blocks: &mut [Block], first: BlockIdx) -> Result<(), CardError> {
        let mut state = self.0.borrow_mut();
        for (index, block) in blocks.iter_mut().enumerate() {
            state.access()?;
            let number = u32::try_from(index).map_or(u32::MAX, |index| first.0.saturating_add(index));
            let source = state.image.as_ref().get(range(first, index)?).ok_or(CardError::Damaged)?;
            block.contents.iter_mut().zip(source).for_each(|(out, byte)| *out = *byte);
            match &mut state.fault {
                Some(CardFault::Unreadable(blocks)) if blocks.contains(&number) => return Err(CardError::Garbled),
                Some(CardFault::FailingReads(left)) if *left > 0 => {
                    *left -= 1;
                    return Err(CardError::Garbled);
                }
                Some(CardFault::Corrupted(blocks)) if blocks.contains(&number) => {
                    let place = number as usize % Block::LEN;
                    if let Some(byte) = block.contents.get_mut(place) {
                        *byte ^= 1 << (number % 8);
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn write(&self, blocks: &[Block], first: BlockIdx) -> Result<(), CardError> {
        let mut state = self.0.borrow_mut();
        for (index, block) in blocks.iter().enumerate() {
            state.access()?;
            if state.fault == Some(CardFault::Unwritable) {
                return Err(CardError::Silent);
            }
            let place = state.image.as_mut().get_mut(range(first, index)?).ok_or(CardError::Damaged)?;
            place.iter_mut().zip(block.contents).for_each(|(place, byte)| *place = byte);
        }
        Ok(())
    }

    fn num_blocks(&self) -> Result<BlockCount, CardError> {
        let state = self.0.borrow();
        if !state.inserted {
            return Err(CardError::Missing);
        }
        Ok(BlockCount(u32::try_from(state.image.as_ref().len() / Block::LEN).unwrap_or(u32::MAX)))
    }
}

impl<M: AsRef<[u8]> + AsMut<[u8]>> CardSlot for VirtualCard<M> {
    fn is_inserted(&self) -> bool {
        self.0.borrow().inserted
    }

    fn start(&self) -> Result<(), CardError> {
        let mut state = self.0.borrow_mut();
        state.started = state.inserted;
        if state.inserted { Ok(()) } else { Err(CardError::Missing) }
    }

    fn is_still_started(&self) -> bool {
        self.0.borrow().started
    }
}
