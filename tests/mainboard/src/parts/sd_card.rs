//! A memory card at its SD bus: identification, single blocks, and what goes wrong with cards.
//!
//! From the SD Association's "SD Specifications Part 1, Physical Layer Simplified Specification",
//! version 6.00. A controller ([`crate::chip::sdio`]) passes whole commands and whole blocks, each
//! with its instant.
//!
//! | Section | Behaviour | Test |
//! |---|---|---|
//! | 4.2.3, 4.8 | idle, ready, identification, stand-by, transfer: CMD0, 8, 55, ACMD41, 2, 3, 9, 10, 7 | `a_card_is_identified` |
//! | 4.2.3.1 | ACMD41: busy until the card has started; a card of high capacity does not start for a host that does not know them | `a_host_that_does_not_know_high_capacity_waits_for_ever` |
//! | 4.6.1, 4.8 | a command that the state forbids has no answer, and is reported with the next one | `a_forbidden_command_is_not_answered` |
//! | 4.9.1, 4.10.1 | the card's status: the state in which a command came, and errors since the last answer | `a_forbidden_command_is_not_answered` |
//! | 4.3.3, 4.3.14 | CMD17: a block, after the access time; addresses in blocks or bytes | `blocks_are_written_and_read` |
//! | 4.3.4 | CMD24: a block, then busy while it is programmed; CMD13 meanwhile | `a_card_is_busy_while_it_programs` |
//! | 4.3.4, 4.12.5 | a block with a wrong CRC is refused with a CRC status | `faults_are_seen` |
//! | 5.3.2, 5.3.3 | capacity in CSD versions 1 and 2 | `a_card_is_identified` |
//! | 4.2.1, 4.3 | at most 400 kHz during identification, 25 MHz afterwards: faster commands are not understood | `a_bus_that_is_too_fast_is_not_understood` |
//! | 6.4.1 | 74 clocks after power-on before the first command | `a_card_wants_its_clocks_first` |
//! | | without power it forgets its state; a block that was being programmed is spoilt from any byte on | `a_cut_spoils_the_block_that_is_programmed` |
//!
//! **Left out**
//!
//! | What | Why |
//! |---|---|
//! | CMD18, CMD25, erasure, ACMD13, ACMD51, CMD6 (speed), UHS, CMD15, CMD42 | the firmware does not use them: they are
//! answered as forbidden |
//! | write protection, by a switch or the CSD | a slot for microSD has no switch |
//! | SPI mode | the boards' slots are at the SDIO |
//! | the CRC of a command | the bus between chip and slot loses no command; [`Faults::is_silent`] stands for one that does |

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::random::Random;
use commands::ERROR;

mod commands;
#[cfg(test)]
mod tests;

/// Bytes of a block.
pub const BLOCK_BYTES: usize = 512;

/// The capacity that a card declares, which decides how it is addressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// Version of the specification before 2.00: CMD8 is forbidden, addresses are bytes.
    Version1,
    /// Version 2.00, standard capacity: addresses are bytes.
    Standard,
    /// High capacity: addresses are blocks.
    High,
}

/// A new card.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Config {
    /// Kind of the card, which decides its addresses.
    pub kind: Kind,
    /// Blocks; a multiple of 1024, of 512 for standard capacity.
    pub blocks: u32,
    /// Time from the first ACMD41 to the end of its start, ns; at most 1 s (4.2.3).
    pub start_ns: u64,
    /// Time from a read command to the block, ns; at most 100 ms (4.6.2.1).
    pub access_ns: u64,
    /// Time for which it is busy with a block, ns; at most 250 ms, of a card for video
    /// 500 ms (4.6.2.2).
    pub program_ns: u64,
    /// Seed of what a cut leaves.
    pub seed: u64,
}

impl Config {
    /// A usual card of high capacity.
    #[must_use]
    pub const fn high(blocks: u32) -> Self {
        Self { kind: Kind::High, blocks, start_ns: 20_000_000, access_ns: 200_000, program_ns: 800_000, seed: 1 }
    }
}

/// Faults of the card.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Faults {
    /// True if the card does not answer.
    pub is_silent: bool,
    /// Number of the next blocks that arrive with a wrong CRC.
    pub garbled_reads: u32,
    /// Blocks that never come.
    pub unreadable: Option<Range<u32>>,
    /// Number of the next written blocks that are refused by their CRC status.
    pub refused_writes: u32,
    /// Number of the next written blocks that are taken, but not programmed: the
    /// card's status says so.
    pub failing_writes: u32,
}

/// The states of 4.1, table 4-1, by their numbers in the card's status.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the specification's names")]
pub enum State {
    Idle = 0,
    Ready = 1,
    Identification = 2,
    StandBy = 3,
    Transfer = 4,
    SendingData = 5,
    ReceiveData = 6,
    Programming = 7,
    Disconnect = 8,
}

/// State of the bus when a command came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bus {
    /// The end of the command, ns.
    pub at_ns: u64,
    /// The bus's clock, Hz.
    pub hz: u64,
    /// Clocks before the command since the clock was switched on.
    pub clocks: u64,
}

/// An answer, 4.9.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Answer {
    /// R1, R6 and R7: 32 bits, with a CRC.
    Short(u32),
    /// R2: a register of 128 bits, the highest first.
    Long([u32; 4]),
    /// R3: the OCR, without a CRC.
    WithoutCrc(u32),
}

/// A block from the card.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sent {
    /// Bytes of the block.
    pub bytes: Vec<u8>,
    /// The CRC fits.
    pub is_sound: bool,
}

/// Answer of the card to a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Nothing.
    None,
    /// A negative CRC status.
    Refused,
    /// A positive one, then busy until this instant, ns.
    Taken(u64),
}

/// A block that is to be sent.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Reading {
    block: u32,
    /// Start bit of the block, ns; `None`: never.
    starts_ns: Option<u64>,
    /// End of the block, once it has begun, ns.
    ends_ns: Option<u64>,
}

/// A block that is being programmed.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Programming {
    block: u32,
    before: Vec<u8>,
    until_ns: u64,
}

/// A card.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SdCard {
    config: Config,
    /// Faults from now on.
    pub faults: Faults,
    /// Blocks that are not all zeros.
    blocks: BTreeMap<u32, Vec<u8>>,
    is_powered: bool,
    /// True once the card has had its first clocks.
    is_awake: bool,
    state: State,
    /// CMD8 has come since CMD0.
    knows_voltage: bool,
    /// The end of its start, ns.
    started_ns: Option<u64>,
    address: u16,
    is_wide: bool,
    is_application: bool,
    /// Errors for the next status.
    errors: u32,
    reading: Option<Reading>,
    writing: Option<u32>,
    programming: Option<Programming>,
    random: Random,
    /// Number of blocks programmed.
    pub written: u64,
}

impl SdCard {
    /// A card with these bytes from its first block on.
    #[must_use]
    pub fn new(config: Config, image: &[u8]) -> Self {
        let blocks = image
            .chunks(BLOCK_BYTES)
            .zip(0..)
            .filter(|(block, _)| block.iter().any(|byte| *byte != 0))
            .map(|(block, index)| {
                let mut bytes = block.to_vec();
                bytes.resize(BLOCK_BYTES, 0);
                (index, bytes)
            })
            .collect();
        Self {
            config,
            faults: Faults::default(),
            blocks,
            is_powered: false,
            is_awake: false,
            state: State::Idle,
            knows_voltage: false,
            started_ns: None,
            address: 0,
            is_wide: false,
            is_application: false,
            errors: 0,
            reading: None,
            writing: None,
            programming: None,
            random: Random::new(config.seed),
            written: 0,
        }
    }

    /// All its bytes.
    #[must_use]
    pub fn image(&self) -> Vec<u8> {
        (0..self.config.blocks).flat_map(|index| self.block(index)).collect()
    }

    /// A block.
    #[must_use]
    pub fn block(&self, index: u32) -> Vec<u8> {
        self.blocks.get(&index).cloned().unwrap_or_else(|| vec![0; BLOCK_BYTES])
    }

    /// Sets how long it is busy with each block from now on, ns.
    pub fn set_program_ns(&mut self, program_ns: u64) {
        self.config.program_ns = program_ns;
    }

    /// The state at this instant.
    pub fn state(&mut self, now_ns: u64) -> State {
        self.follow(now_ns);
        self.state
    }

    /// True if it programs a block at this instant.
    pub fn is_programming(&mut self, now_ns: u64) -> bool {
        self.follow(now_ns);
        self.programming.is_some()
    }

    /// True if it moves blocks over four lines (ACMD6).
    #[must_use]
    pub const fn is_wide(&self) -> bool {
        self.is_wide
    }

    /// Switches its supply.
    pub fn set_power(&mut self, now_ns: u64, on: bool) {
        self.follow(now_ns);
        if on == self.is_powered {
            return;
        }
        if let Some(Programming { block, before, .. }) = self.programming.take() {
            let mut bytes = self.block(block);
            let kept = self.random.between(0, BLOCK_BYTES as u64) as usize;
            let is_noise = self.random.chance(0.5);
            for (byte, old) in bytes.iter_mut().zip(before).skip(kept) {
                *byte = if is_noise { self.random.bits() as u8 } else { old };
            }
            self.blocks.insert(block, bytes);
        }
        self.go_idle();
        (self.is_powered, self.is_awake) = (on, false);
    }

    fn go_idle(&mut self) {
        self.state = State::Idle;
        (self.knows_voltage, self.started_ns, self.address) = (false, None, 0);
        (self.is_wide, self.is_application, self.errors) = (false, false, 0);
        (self.reading, self.writing) = (None, None);
    }

    /// Ends what has ended by now.
    fn follow(&mut self, now_ns: u64) {
        if self.programming.as_ref().is_some_and(|programming| programming.until_ns <= now_ns) {
            self.programming = None;
            self.state = match self.state {
                State::Programming => State::Transfer,
                State::Disconnect => State::StandBy,
                other => other,
            };
        }
        if self.reading.and_then(|reading| reading.ends_ns).is_some_and(|ends_ns| ends_ns <= now_ns) {
            self.reading = None;
            if self.state == State::SendingData {
                self.state = State::Transfer;
            }
        }
    }

    /// Instant of the start bit of the block that was asked for, ns.
    #[must_use]
    pub fn block_starts_ns(&self) -> Option<u64> {
        self.reading.filter(|reading| reading.ends_ns.is_none())?.starts_ns
    }

    /// Sends the block that was asked for, until this instant, ns.
    pub fn send_block(&mut self, ends_ns: u64) -> Option<Sent> {
        let reading = self.reading.as_mut()?;
        reading.ends_ns = Some(ends_ns);
        let block = reading.block;
        let is_sound = self.faults.garbled_reads == 0;
        self.faults.garbled_reads = self.faults.garbled_reads.saturating_sub(1);
        Some(Sent { bytes: self.block(block), is_sound })
    }

    /// Takes a block whose end came at this instant, ns. `is_sound`: the CRC fits.
    pub fn take_block(&mut self, at_ns: u64, bytes: &[u8], is_sound: bool) -> Status {
        self.follow(at_ns);
        let (State::ReceiveData, Some(block)) = (self.state, self.writing.take()) else { return Status::None };
        self.state = State::Transfer;
        let refuses = self.faults.refused_writes > 0;
        self.faults.refused_writes = self.faults.refused_writes.saturating_sub(1);
        if refuses || !is_sound || bytes.len() != BLOCK_BYTES {
            return Status::Refused;
        }
        let before = self.block(block);
        if self.faults.failing_writes > 0 {
            self.faults.failing_writes -= 1;
            self.errors |= ERROR;
        } else {
            self.blocks.insert(block, bytes.to_vec());
            self.written += 1;
        }
        let until_ns = at_ns.saturating_add(self.config.program_ns);
        self.programming = Some(Programming { block, before, until_ns });
        self.state = State::Programming;
        Status::Taken(until_ns)
    }
}
