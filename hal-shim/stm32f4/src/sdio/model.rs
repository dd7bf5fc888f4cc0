//! A model of SDIO, DMA stream and card, register by register.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::atomic::Ordering;

use super::*;

/// Faults of a card or of its transfers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// No card is in the slot.
    pub missing: bool,
    /// The card does not answer.
    pub silent: bool,
    /// The card never ends its start.
    pub never_starts: bool,
    /// The card stays busy after a write.
    pub stays_busy: bool,
    /// A block's checksum is wrong.
    pub bad_block: bool,
    /// The stream moves no data.
    pub no_stream: bool,
    /// A transfer never ends.
    pub no_end: bool,
}

pub struct Model {
    values: BTreeMap<u32, u32>,
    pub image: Vec<u8>,
    pub faults: Rc<Cell<Faults>>,
    memory: &'static BlockMemory,
    is_version_2: bool,
    /// True after CMD55.
    application: bool,
    polls: u32,
    selected: bool,
    idle: bool,
    place: u32,
    /// The card's state while it is not busy.
    state: u32,
    busy: u32,
    pub written: u32,
}

impl Model {
    pub fn new(image: Vec<u8>, is_version_2: bool, memory: &'static BlockMemory) -> Self {
        Self {
            values: BTreeMap::new(),
            image,
            faults: Rc::default(),
            memory,
            is_version_2,
            application: false,
            polls: 0,
            selected: false,
            idle: false,
            place: 0,
            state: READY,
            busy: 0,
            written: 0,
        }
    }

    fn value(&self, address: u32) -> u32 {
        self.values.get(&address).copied().unwrap_or_default()
    }

    fn flag(&mut self, bits: u32) {
        *self.values.entry(STA).or_default() |= bits;
    }

    fn answer(&mut self, value: u32) {
        self.values.insert(RESP1, value);
        self.flag(ANSWERED);
    }

    fn state(&self) -> u32 {
        let state = if self.busy > 0 { 7 } else { self.state };
        u32::from(self.busy == 0) << 8 | state << 9
    }

    fn command(&mut self, word: u32) {
        let faults = self.faults.get();
        let (index, argument) = (word & 0x3f, self.value(ARG));
        let is_powered = self.value(POWER) == POWER_ON && self.value(CLKCR) & CLOCK_ON != 0;
        if word >> 6 & 0b11 == 0 {
            self.selected = false;
            self.idle = true;
            self.polls = 0;
            return self.flag(SENT);
        }
        if faults.missing || faults.silent || !is_powered || !self.idle || index == 8 && !self.is_version_2 {
            return self.flag(COMMAND_TIMEOUT);
        }
        let application = std::mem::take(&mut self.application);
        match (application, index) {
            (_, 8) => self.answer(argument),
            (_, 55) => {
                self.application = true;
                self.answer(1 << 5);
            }
            (true, 41) => {
                self.polls += 1;
                let is_ready = self.polls > 3 && !faults.never_starts;
                // The answer has no checksum, which the SDIO takes for a wrong one.
                self.values.insert(RESP1, u32::from(is_ready) << 31 | u32::from(self.is_version_2) << 30 | 0x00ff_8000);
                self.flag(COMMAND_CRC);
            }
            (_, 2) => self.answer(0x0353_4453),
            (_, 3) => self.answer(0xb368_0500),
            (_, 9) => {
                let blocks = self.image.len() as u32 / 512;
                let [high, middle, low] = if self.is_version_2 {
                    let size = blocks / 1024 - 1;
                    [1 << 30, 9 << 16 | size >> 16, size << 16]
                } else {
                    // Times 2^(7 + 2) blocks of 512 bytes.
                    let size = blocks / 512 - 1;
                    [0, 9 << 16 | size >> 2, size << 30 | 7 << 15]
                };
                self.values.insert(RESP2, middle);
                self.values.insert(RESP3, low);
                self.answer(high);
            }
            (_, 7) if argument == 0xb368_0000 => {
                (self.selected, self.state) = (true, READY);
                self.answer(0x700);
            }
            _ if !self.selected => self.flag(COMMAND_TIMEOUT),
            (true, 6) | (_, 16) => self.answer(self.state()),
            // SD specification 4.8: otherwise it is forbidden, and not answered.
            (_, 12) if self.busy == 0 && self.state != READY => {
                self.answer(self.state());
                self.state = READY;
            }
            (_, 13) => {
                if self.busy > 0 && !faults.stays_busy {
                    self.busy -= 1;
                }
                self.answer(self.state());
            }
            (_, 17) => {
                self.place = argument;
                self.answer(self.state());
                self.state = SENDS;
                self.transfer();
            }
            (_, 24) => {
                self.place = argument;
                self.answer(self.state());
                self.state = EXPECTS;
            }
            _ => self.flag(COMMAND_TIMEOUT),
        }
    }

    /// The SDIO and the stream are both ready: the block goes over.
    fn transfer(&mut self) {
        let faults = self.faults.get();
        let (control, stream) = (self.value(DCTRL), self.value(S3CR));
        if faults.no_end || control & TRANSFER == 0 {
            return;
        }
        let wants = STREAM_SETTINGS | STREAM_ENABLE;
        assert_eq!((stream & wants, self.value(S3PAR), self.value(DLEN)), (wants, FIFO, 512));
        assert_eq!(self.value(CLKCR), FAST | FOUR_LINES | CLOCK_ON);
        self.state = READY;
        if faults.bad_block {
            return self.flag(DATA_CRC);
        }
        if faults.no_stream {
            return self.flag(OVERRUN);
        }
        let start = if self.is_version_2 { self.place as usize * 512 } else { self.place as usize };
        let bytes = &mut self.image[start..start + 512];
        for (bytes, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(&self.memory.0) {
            if control & FROM_CARD != 0 {
                word.store(u32::from_le_bytes(*bytes), Ordering::Relaxed);
            } else {
                *bytes = word.load(Ordering::Relaxed).to_le_bytes();
            }
        }
        if control & FROM_CARD == 0 {
            self.busy = 5;
            self.written += 1;
        }
        self.values.insert(LISR, STREAM_COMPLETE);
        self.flag(DATA_END | BLOCK_END);
    }
}

impl Registers for Model {
    fn read(&mut self, address: u32) -> u32 {
        if address == gpio::port(2) + IDR {
            return u32::from(self.faults.get().missing) << 14;
        }
        self.value(address)
    }

    fn write(&mut self, address: u32, value: u32) {
        match address {
            ICR => *self.values.entry(STA).or_default() &= !value,
            LIFCR => *self.values.entry(LISR).or_default() &= !value,
            CMD => self.command(value),
            POWER if value == 0 => {
                self.idle = false;
                self.values.insert(POWER, 0);
            }
            _ => {
                self.values.insert(address, value);
                if address == DCTRL && value & (TRANSFER | FROM_CARD) == TRANSFER {
                    self.transfer();
                }
            }
        }
    }
}

// States of the card: ready for a block, sends one, expects one.
const READY: u32 = 4;
const SENDS: u32 = 5;
const EXPECTS: u32 = 6;
