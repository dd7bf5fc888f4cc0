//! A memory card at the SDIO: commands, and blocks by DMA.
//!
//! stm32f4xx-hal's driver moves blocks by the processor and waits without bounds: step interrupts
//! would make it lose bytes, and a card that stays busy would block it endlessly. Here DMA2's
//! stream 3 moves them, and every wait ends.
//!
//! Registers: RM0090 31.9 and RM0390 29.8. Commands and answers: SD Physical Layer Simplified
//! Specification 4.7 and 4.9.

mod answers;
#[cfg(test)]
mod model;
#[cfg(test)]
mod tests;

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering, fence};

use ferrostep_hal_shim::card::{Block, BlockCount, BlockDevice, BlockIdx, CardError, CardSlot};
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_register_address::register;

use crate::gpio::{self, IDR};
use crate::rcc::{RCC_AHB1ENR, RCC_APB2ENR};
use crate::registers::Registers;
use answers::{Capacity, R1_ERRORS, capacity, is_in_transfer, is_ready_for_transfer};

const POWER: u32 = register!(SDIO.power);
const CLKCR: u32 = register!(SDIO.clkcr);
const ARG: u32 = register!(SDIO.arg);
const CMD: u32 = register!(SDIO.cmd);
const RESP1: u32 = register!(SDIO.resp1);
const RESP2: u32 = register!(SDIO.resp2);
const RESP3: u32 = register!(SDIO.resp3);
const DTIMER: u32 = register!(SDIO.dtimer);
const DLEN: u32 = register!(SDIO.dlen);
const DCTRL: u32 = register!(SDIO.dctrl);
const STA: u32 = register!(SDIO.sta);
const ICR: u32 = register!(SDIO.icr);
const FIFO: u32 = register!(SDIO.fifo);

/// POWER: on.
const POWER_ON: u32 = 0b11;
/// CLKCR: the clock runs; four lines; dividers of 48 MHz for 400 kHz at the start and 12 MHz then.
/// 25 MHz are allowed; at half of that a block of 43 us takes 86, without work for the processor.
const CLOCK_ON: u32 = 1 << 8;
const FOUR_LINES: u32 = 0b01 << 11;
const SLOW: u32 = 118;
const FAST: u32 = 2;
/// CMD: a short answer, a long one; send.
const SHORT: u32 = 0b01 << 6;
const LONG: u32 = 0b11 << 6;
const SEND: u32 = 1 << 10;
/// STA and ICR.
const COMMAND_CRC: u32 = 1 << 0;
const DATA_CRC: u32 = 1 << 1;
const COMMAND_TIMEOUT: u32 = 1 << 2;
const DATA_TIMEOUT: u32 = 1 << 3;
const UNDERRUN: u32 = 1 << 4;
const OVERRUN: u32 = 1 << 5;
const ANSWERED: u32 = 1 << 6;
const SENT: u32 = 1 << 7;
const DATA_END: u32 = 1 << 8;
const BLOCK_END: u32 = 1 << 10;
const DATA_ERRORS: u32 = DATA_CRC | DATA_TIMEOUT | UNDERRUN | OVERRUN;
/// All flags that can be cleared on every chip of the family.
const ALL_FLAGS: u32 = 0x0040_05ff;
/// DCTRL: transfer, from the card, by DMA, blocks of 2^9 bytes.
const TRANSFER: u32 = 1 << 0;
const FROM_CARD: u32 = 1 << 1;
const BY_DMA: u32 = 1 << 3;
const BLOCKS_OF_512: u32 = 9 << 4;
/// Clocks in a millisecond, at 12 MHz.
const CLOCKS_PER_MS: u32 = 12_000;

// RM0090, 10.5: DMA2, stream 3, whose channel 4 is the SDIO's (table 43).
const LISR: u32 = register!(DMA2.lisr);
const LIFCR: u32 = register!(DMA2.lifcr);
const S3CR: u32 = register!(DMA2.st[3].cr);
const S3NDTR: u32 = register!(DMA2.st[3].ndtr);
const S3PAR: u32 = register!(DMA2.st[3].par);
const S3M0AR: u32 = register!(DMA2.st[3].m0ar);
const S3FCR: u32 = register!(DMA2.st[3].fcr);
const STREAM_ENABLE: u32 = 1 << 0;
/// Channel 4, bursts of four words on both sides, low priority (the thermistors' stream has the
/// medium one), words, memory increments, and the SDIO says when it ends.
const STREAM_SETTINGS: u32 = 4 << 25 | 0b01 << 23 | 0b01 << 21 | 0b10 << 13 | 0b10 << 11 | 1 << 10 | 1 << 5;
const TO_PERIPHERAL: u32 = 0b01 << 6;
/// The stream's own buffer, filled before each burst.
const STREAM_BUFFER: u32 = 1 << 2 | 0b11;
/// Flags of stream 3, and that of a complete transfer.
const STREAM_FLAGS: u32 = 0x3d << 22;
const STREAM_COMPLETE: u32 = 1 << 27;

/// Switches of their clocks.
const SDIO_CLOCK: u32 = 1 << 11;
const DMA2_CLOCK: u32 = 1 << 22;

const MS: u32 = TICKS_PER_SECOND / 1000;
/// A command and its answer take 100 bits and up to 64 of waiting, 0.4 ms at 400 kHz.
const COMMAND_MS: u32 = 5;
/// A card may take 100 ms for a block's first bit.
const READ_MS: u32 = 250;
/// Longest write, ms: a card writes for up to 250; the specification's own advice is 500. The
/// SDIO's timer also counts while the card is busy (RM0090 31.3.1).
const WRITE_MS: u32 = 500;
/// The block itself, with all interruptions.
const BLOCK_MS: u32 = 50;
/// A card starts within 1 s.
const START_MS: u32 = 1000;
/// Supply and clock are there before the first command.
const POWER_MS: u32 = 3;

/// Words of a block.
pub const BLOCK_WORDS: usize = Block::LEN / 4;

/// Memory for a block, where DMA reaches it: bursts of four words must not cross 1 KiB.
#[derive(Debug)]
#[repr(align(512))]
pub struct BlockMemory(pub [AtomicU32; BLOCK_WORDS]);

impl BlockMemory {
    /// Zeros.
    pub const fn new() -> Self {
        Self([const { AtomicU32::new(0) }; BLOCK_WORDS])
    }
}

impl Default for BlockMemory {
    fn default() -> Self {
        Self::new()
    }
}

/// A card that was started.
#[derive(Clone, Copy, Debug)]
struct Started {
    address: u16,
    /// Commands address blocks by number, not by byte.
    by_block: bool,
    blocks: u32,
}

#[derive(Debug)]
struct Inner<R, T> {
    registers: R,
    /// The motion clock, ticks.
    now: T,
    memory: &'static BlockMemory,
    memory_address: u32,
    /// Port and number of the pin that is low while a card is in the slot.
    detect: Option<(u8, u8)>,
    started: Option<Started>,
}

/// The slot. Its waits are the processor's: it belongs in the task of the lowest priority.
#[derive(Debug)]
pub struct SdioSlot<R, T>(RefCell<Inner<R, T>>);

impl<R: Registers, T: Fn() -> u32> SdioSlot<R, T> {
    /// Switches the SDIO on, with the card still off. DMA finds `memory` at `memory_address`;
    /// `detect` is the port (0 for A) and number of a pin that a card pulls low, `None`
    /// without such a pin.
    pub fn new(
        mut registers: R,
        now: T,
        memory: &'static BlockMemory,
        memory_address: u32,
        detect: Option<(u8, u8)>,
    ) -> Self {
        registers.switch_clocks_on(RCC_APB2ENR, SDIO_CLOCK);
        registers.switch_clocks_on(RCC_AHB1ENR, DMA2_CLOCK);
        registers.write(POWER, 0);
        Self(RefCell::new(Inner { registers, now, memory, memory_address, detect, started: None }))
    }
}

impl<R: Registers, T: Fn() -> u32> Inner<R, T> {
    fn is_inserted(&mut self) -> bool {
        let Some((port, number)) = self.detect else { return true };
        let is_there = self.registers.read(gpio::port(port) + IDR) >> number & 1 == 0;
        if !is_there {
            self.started = None;
        }
        is_there
    }

    /// Waits until any of the bits of a register is set; returns the register's last value.
    fn wait_for(&mut self, address: u32, bits: u32, longest_ms: u32) -> Result<u32, CardError> {
        let since = (self.now)();
        loop {
            // The clock first: after a long interruption the register is read once more.
            let is_late = (self.now)().wrapping_sub(since) > longest_ms * MS;
            let value = self.registers.read(address);
            if value & bits != 0 {
                return Ok(value);
            }
            if is_late {
                return Err(CardError::Silent);
            }
        }
    }

    fn wait_ms(&mut self, milliseconds: u32) {
        let since = (self.now)();
        while (self.now)().wrapping_sub(since) <= milliseconds * MS {}
    }

    /// Sends a command; `answer` is one of [`SHORT`], [`LONG`] or 0. `has_crc`: the
    /// answer has a checksum.
    fn command(&mut self, index: u32, argument: u32, answer: u32, has_crc: bool) -> Result<(), CardError> {
        self.registers.write(ICR, ALL_FLAGS);
        self.registers.write(ARG, argument);
        self.registers.write(CMD, index | answer | SEND);
        let flags = if answer == 0 { SENT } else { ANSWERED | COMMAND_TIMEOUT | COMMAND_CRC };
        let state = self.wait_for(STA, flags, COMMAND_MS)?;
        if state & COMMAND_TIMEOUT != 0 {
            return Err(CardError::Silent);
        }
        if state & COMMAND_CRC != 0 && has_crc {
            return Err(CardError::Garbled);
        }
        Ok(())
    }

    /// A command whose answer is the card's state.
    fn command_r1(&mut self, index: u32, argument: u32) -> Result<u32, CardError> {
        self.command(index, argument, SHORT, true)?;
        let state = self.registers.read(RESP1);
        if state & R1_ERRORS != 0 { Err(CardError::Garbled) } else { Ok(state) }
    }

    fn start(&mut self) -> Result<(), CardError> {
        self.started = None;
        if !self.is_inserted() {
            return Err(CardError::Missing);
        }
        self.registers.write(DCTRL, 0);
        self.registers.write(CLKCR, SLOW);
        self.registers.write(POWER, POWER_ON);
        self.wait_ms(POWER_MS);
        self.registers.write(CLKCR, SLOW | CLOCK_ON);
        self.wait_ms(POWER_MS);
        self.command(0, 0, 0, false)?;
        // 2.7 to 3.6 V, and a pattern that comes back; cards of before 2006 do not know this.
        let knows_voltage = self.command(8, 0x1aa, SHORT, true).is_ok();
        if knows_voltage && self.registers.read(RESP1) & 0xfff != 0x1aa {
            return Err(CardError::Unsupported);
        }
        let ocr = self.wait_until_powered(knows_voltage)?;
        self.command(2, 0, LONG, true)?;
        self.command(3, 0, SHORT, true)?;
        let address = (self.registers.read(RESP1) >> 16) as u16;
        let selector = u32::from(address) << 16;
        self.command(9, selector, LONG, true)?;
        let csd = [RESP1, RESP2, RESP3].map(|register| self.registers.read(register));
        let Capacity { blocks } = capacity(csd).ok_or(CardError::Unsupported)?;
        self.command_r1(7, selector)?;
        // Four lines, which every memory card has.
        self.command_r1(55, selector)?;
        self.command_r1(6, 0b10)?;
        self.command_r1(16, Block::LEN_U32)?;
        self.registers.write(CLKCR, FAST | FOUR_LINES | CLOCK_ON);
        self.started = Some(Started { address, by_block: ocr >> 30 & 1 == 1, blocks });
        Ok(())
    }

    /// Tells the card its voltage until it has started.
    fn wait_until_powered(&mut self, knows_voltage: bool) -> Result<u32, CardError> {
        let argument = 0x0010_0000 | u32::from(knows_voltage) << 30;
        let since = (self.now)();
        while (self.now)().wrapping_sub(since) <= START_MS * MS {
            self.command(55, 0, SHORT, true)?;
            self.command(41, argument, SHORT, false)?;
            let ocr = self.registers.read(RESP1);
            if ocr >> 31 == 1 {
                return Ok(ocr);
            }
        }
        Err(CardError::Silent)
    }

    /// The started card, if it is still in the slot, and the address of a block.
    fn place(&mut self, block: u32) -> Result<(Started, u32), CardError> {
        if !self.is_inserted() {
            return Err(CardError::Missing);
        }
        let started = self.started.ok_or(CardError::Missing)?;
        if block >= started.blocks {
            return Err(CardError::Damaged);
        }
        Ok((started, if started.by_block { block } else { block.wrapping_mul(Block::LEN_U32) }))
    }

    /// Waits until the card takes the next block.
    fn wait_until_ready(&mut self, started: Started) -> Result<(), CardError> {
        let since = (self.now)();
        loop {
            let is_late = (self.now)().wrapping_sub(since) > WRITE_MS * MS;
            let state = self.command_r1(13, u32::from(started.address) << 16)?;
            if is_ready_for_transfer(state) {
                return Ok(());
            }
            if is_late {
                return Err(CardError::Silent);
            }
        }
    }

    /// Prepares a transfer, for which the card may let the SDIO wait.
    fn start_stream(&mut self, settings: u32, longest_ms: u32) -> Result<(), CardError> {
        self.stop_stream()?;
        self.registers.write(LIFCR, STREAM_FLAGS);
        self.registers.write(S3PAR, FIFO);
        self.registers.write(S3M0AR, self.memory_address);
        // The SDIO counts.
        self.registers.write(S3NDTR, BLOCK_WORDS as u32);
        self.registers.write(S3FCR, STREAM_BUFFER);
        fence(Ordering::SeqCst);
        self.registers.write(S3CR, STREAM_SETTINGS | settings | STREAM_ENABLE);
        self.registers.write(DTIMER, longest_ms * CLOCKS_PER_MS);
        self.registers.write(DLEN, Block::LEN_U32);
        Ok(())
    }

    /// Switches the stream off; its last burst may take a moment.
    fn stop_stream(&mut self) -> Result<(), CardError> {
        const LOOKS: u32 = 1000;
        self.registers.modify(S3CR, STREAM_ENABLE, 0);
        if self.registers.comes_to(S3CR, STREAM_ENABLE, false, LOOKS) { Ok(()) } else { Err(CardError::Silent) }
    }

    /// Waits for the end of a block's transfer.
    fn finish_transfer(&mut self, longest_ms: u32) -> Result<(), CardError> {
        let state = self.wait_for(STA, DATA_ERRORS | BLOCK_END | DATA_END, longest_ms + BLOCK_MS)?;
        if state & DATA_TIMEOUT != 0 {
            return Err(CardError::Silent);
        }
        if state & DATA_ERRORS != 0 {
            return Err(CardError::Garbled);
        }
        Ok(())
    }

    /// Ends a failed transfer. A card that cannot continue, or is gone, must be started anew.
    fn give_up(&mut self) {
        self.registers.write(DCTRL, 0);
        let _ = self.stop_stream();
        let Some(started) = self.started else { return };
        if self.end_transfer(started).is_err() {
            self.started = None;
        }
    }

    /// Asks the card whether it still sends or expects a block: only then does it answer a stop (SD
    /// specification 4.8).
    fn end_transfer(&mut self, started: Started) -> Result<(), CardError> {
        // Errors in this answer are those of the failed transfer.
        self.command(13, u32::from(started.address) << 16, SHORT, true)?;
        let state = self.registers.read(RESP1);
        if is_in_transfer(state) {
            self.command(12, 0, SHORT, true)
        } else if is_ready_for_transfer(state) {
            Ok(())
        } else {
            Err(CardError::Silent)
        }
    }

    fn read(&mut self, block: &mut Block, index: u32) -> Result<(), CardError> {
        let (_, place) = self.place(index)?;
        let outcome = self.read_into_memory(place);
        if outcome.is_err() {
            self.give_up();
        }
        outcome?;
        fence(Ordering::SeqCst);
        for (bytes, word) in block.contents.as_chunks_mut::<4>().0.iter_mut().zip(&self.memory.0) {
            *bytes = word.load(Ordering::Relaxed).to_le_bytes();
        }
        Ok(())
    }

    fn read_into_memory(&mut self, place: u32) -> Result<(), CardError> {
        self.start_stream(0, READ_MS)?;
        self.registers.write(DCTRL, TRANSFER | FROM_CARD | BY_DMA | BLOCKS_OF_512);
        self.command_r1(17, place)?;
        self.finish_transfer(READ_MS)?;
        self.wait_for(LISR, STREAM_COMPLETE, COMMAND_MS).map(|_| ())
    }

    fn write(&mut self, block: &Block, index: u32) -> Result<(), CardError> {
        let (started, place) = self.place(index)?;
        for (bytes, word) in block.contents.as_chunks::<4>().0.iter().zip(&self.memory.0) {
            word.store(u32::from_le_bytes(*bytes), Ordering::Relaxed);
        }
        let outcome = self.write_from_memory(place);
        if outcome.is_err() {
            self.give_up();
        }
        outcome?;
        self.wait_until_ready(started).inspect_err(|_| self.started = None)
    }

    fn write_from_memory(&mut self, place: u32) -> Result<(), CardError> {
        self.command_r1(24, place)?;
        self.start_stream(TO_PERIPHERAL, WRITE_MS)?;
        self.registers.write(DCTRL, TRANSFER | BY_DMA | BLOCKS_OF_512);
        self.finish_transfer(WRITE_MS)
    }
}

impl<R: Registers, T: Fn() -> u32> BlockDevice for SdioSlot<R, T> {
    type Error = CardError;

    fn read(&self, blocks: &mut [Block], first: BlockIdx) -> Result<(), CardError> {
        let mut inner = self.0.borrow_mut();
        blocks.iter_mut().zip(first.0..=u32::MAX).try_for_each(|(block, index)| inner.read(block, index))
    }

    fn write(&self, blocks: &[Block], first: BlockIdx) -> Result<(), CardError> {
        let mut inner = self.0.borrow_mut();
        blocks.iter().zip(first.0..=u32::MAX).try_for_each(|(block, index)| inner.write(block, index))
    }

    fn num_blocks(&self) -> Result<BlockCount, CardError> {
        let started = self.0.borrow().started;
        started.map(|started| BlockCount(started.blocks)).ok_or(CardError::Missing)
    }
}

impl<R: Registers, T: Fn() -> u32> CardSlot for SdioSlot<R, T> {
    fn is_inserted(&self) -> bool {
        self.0.borrow_mut().is_inserted()
    }

    fn start(&self) -> Result<(), CardError> {
        self.0.borrow_mut().start()
    }

    fn is_still_started(&self) -> bool {
        let mut inner = self.0.borrow_mut();
        inner.is_inserted() && inner.started.is_some()
    }
}
