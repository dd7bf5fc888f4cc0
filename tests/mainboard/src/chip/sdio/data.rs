//! The data path, 31.3.1: `Wait_R` and `Receive`, `Wait_S`, `Send` and `Busy`.

use rigless::device::RegisterFile;
use rigless::soc::stm32f427::generated::sdio::{Register, dctrl, sta};

use super::{FIFO_WORDS, HALF, Sdio, clocks_ns, flag};
use crate::parts::sd_card::Status;

/// Bits of a word, and of what ends a block: its CRC and a stop bit.
const WORD_BITS: u64 = 32;
const CRC_CLOCKS: u64 = 17;
/// Clocks from the FIFO's first word to the start bit, and from a block's end to the end of its CRC
/// status (SD specification 4.3.4, 4.12.4).
const START_CLOCKS: u64 = 2;
const STATUS_CLOCKS: u64 = 8;
const WORD_BYTES: u64 = 4;

/// Phase of the data path.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
enum Phase {
    /// Waits for a start bit since this instant.
    WaitToReceive { since_ns: u64 },
    /// A block from the card, whose start bit came at this instant.
    Receive { began_ns: u64, words: Vec<u32>, moved: usize, is_sound: bool },
    /// Waits for the FIFO.
    WaitToSend,
    /// A block to the card.
    Send { began_ns: u64, bytes: Vec<u8>, moved: usize },
    /// The card has the block. `until_ns`: when it stops being busy, if it does.
    Busy { since_ns: u64, until_ns: Option<u64> },
}

/// The bus's clock and lines.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Rate {
    hz: u64,
    lines: u8,
}

impl Rate {
    /// End of a block's `count`-th word, ns.
    fn word_ns(self, began_ns: u64, count: usize) -> u64 {
        began_ns + clocks_ns(count as u64 * WORD_BITS / u64::from(self.lines), self.hz)
    }

    /// End of a block with its CRC, ns.
    fn block_ns(self, began_ns: u64, words: usize) -> u64 {
        began_ns + clocks_ns(words as u64 * WORD_BITS / u64::from(self.lines) + CRC_CLOCKS, self.hz)
    }
}

/// A transfer.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct Data {
    rate: Rate,
    timeout_ns: u64,
    block_bytes: u64,
    remaining: u64,
    is_from_card: bool,
    is_spoilt: bool,
    phase: Phase,
}

/// Result of a step of the path.
enum Step {
    /// Another step may be due.
    Again(Phase),
    /// Earliest instant of the next change, ns.
    Wait(Option<u64>),
    /// The block is over.
    BlockEnd(u64),
    /// The transfer is over, with a fault.
    Failed(&'static rigless::soc::FieldSpec),
}

impl Data {
    pub(super) const fn is_from_card(&self) -> bool {
        self.is_from_card
    }

    /// Bytes that are not over yet: `DCOUNT`.
    pub(super) fn remaining(&self) -> u64 {
        match &self.phase {
            Phase::Receive { moved, .. } | Phase::Send { moved, .. } => {
                self.remaining.saturating_sub(*moved as u64 * WORD_BYTES)
            }
            Phase::Busy { .. } => self.remaining.saturating_sub(self.block_bytes),
            Phase::WaitToReceive { .. } | Phase::WaitToSend => self.remaining,
        }
    }

    /// Bytes that have not been taken from the FIFO.
    pub(super) fn to_fill(&self) -> u64 {
        self.remaining()
    }

    /// The card is gone.
    pub(super) fn spoil(&mut self) {
        self.is_spoilt = true;
        if let Phase::Busy { until_ns, .. } = &mut self.phase {
            // D0 is pulled high.
            *until_ns = Some(0);
        }
    }

    fn words_of_block(&self) -> usize {
        (self.block_bytes.min(self.remaining) / WORD_BYTES) as usize
    }
}

impl Sdio {
    /// Switches the data path on or off, 31.9.9.
    pub(super) fn control_data(&mut self, written: u64, registers: &mut RegisterFile, now_ns: u64) {
        flag(registers, sta::RXACT, false);
        flag(registers, sta::TXACT, false);
        self.data = None;
        let hz = self.bus_hz(registers);
        let remaining = registers.get(Register::Dlen);
        if !dctrl::DTEN.is_set(written) || hz == 0 || remaining == 0 {
            return;
        }
        let is_from_card = dctrl::DTDIR.is_set(written);
        self.fifo.clear();
        self.received = is_from_card;
        self.data = Some(Data {
            rate: Rate { hz, lines: Self::host_lines(registers) },
            timeout_ns: clocks_ns(registers.get(Register::Dtimer), hz),
            block_bytes: 1 << dctrl::DBLOCKSIZE.get(written),
            remaining,
            is_from_card,
            is_spoilt: false,
            phase: if is_from_card { Phase::WaitToReceive { since_ns: now_ns } } else { Phase::WaitToSend },
        });
        flag(registers, if is_from_card { sta::RXACT } else { sta::TXACT }, true);
    }

    /// Moves the bus on; returns the instant of its next event, ns.
    pub(super) fn advance_data(&mut self, registers: &mut RegisterFile, now_ns: u64) -> Option<u64> {
        loop {
            let mut data = self.data.take()?;
            match self.step(&mut data, now_ns) {
                Step::Again(phase) => self.data = Some(Data { phase, ..data }),
                Step::Wait(next_ns) => {
                    self.data = Some(data);
                    return next_ns;
                }
                Step::BlockEnd(at_ns) => {
                    flag(registers, sta::DBCKEND, true);
                    data.remaining = data.remaining.saturating_sub(data.block_bytes);
                    if data.remaining == 0 {
                        flag(registers, sta::DATAEND, true);
                        return self.end_data(registers);
                    }
                    data.phase =
                        if data.is_from_card { Phase::WaitToReceive { since_ns: at_ns } } else { Phase::WaitToSend };
                    self.data = Some(data);
                }
                Step::Failed(fault) => {
                    flag(registers, fault, true);
                    return self.end_data(registers);
                }
            }
        }
    }

    fn end_data(&mut self, registers: &mut RegisterFile) -> Option<u64> {
        flag(registers, sta::RXACT, false);
        flag(registers, sta::TXACT, false);
        None
    }

    fn step(&mut self, data: &mut Data, now_ns: u64) -> Step {
        match &mut data.phase {
            Phase::WaitToReceive { since_ns } => {
                let since_ns = *since_ns;
                self.wait_for_block(data, since_ns, now_ns)
            }
            Phase::Receive { .. } => self.receive(data, now_ns),
            Phase::WaitToSend => {
                if self.fifo.is_empty() {
                    return Step::Wait(None);
                }
                let began_ns = now_ns + clocks_ns(START_CLOCKS, data.rate.hz);
                Step::Again(Phase::Send { began_ns, bytes: Vec::new(), moved: 0 })
            }
            Phase::Send { .. } => self.send_words(data, now_ns),
            Phase::Busy { since_ns, until_ns } => {
                let late_ns = since_ns.saturating_add(data.timeout_ns);
                match *until_ns {
                    Some(until_ns) if until_ns <= late_ns && until_ns <= now_ns => Step::BlockEnd(until_ns),
                    _ if late_ns <= now_ns => Step::Failed(sta::DTIMEOUT),
                    until_ns => Step::Wait(Some(until_ns.map_or(late_ns, |until_ns| until_ns.min(late_ns)))),
                }
            }
        }
    }

    fn wait_for_block(&mut self, data: &mut Data, since_ns: u64, now_ns: u64) -> Step {
        let late_ns = since_ns.saturating_add(data.timeout_ns);
        let (rate, words, wired_lines) = (data.rate, data.words_of_block(), self.lines);
        let card = self.reached();
        let starts_ns = card.as_ref().and_then(|card| card.block_starts_ns()).filter(|at_ns| *at_ns < late_ns);
        match (card, starts_ns) {
            (Some(card), Some(at_ns)) if at_ns <= now_ns => {
                let is_wide = card.is_wide();
                let Some(sent) = card.send_block(rate.block_ns(at_ns, words)) else { return Step::Wait(Some(late_ns)) };
                // Its start bit has passed.
                if at_ns < since_ns {
                    return Step::Again(Phase::WaitToReceive { since_ns });
                }
                let agrees = rate.lines <= wired_lines && (rate.lines == 4) == is_wide;
                let words = sent.bytes.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
                Step::Again(Phase::Receive { began_ns: at_ns, words, moved: 0, is_sound: sent.is_sound && agrees })
            }
            _ if late_ns <= now_ns => Step::Failed(sta::DTIMEOUT),
            (_, starts_ns) => Step::Wait(Some(starts_ns.unwrap_or(late_ns))),
        }
    }

    fn receive(&mut self, data: &mut Data, now_ns: u64) -> Step {
        let (rate, count, is_spoilt) = (data.rate, data.words_of_block(), data.is_spoilt);
        let Phase::Receive { began_ns, words, moved, is_sound } = &mut data.phase else { return Step::Wait(None) };
        while *moved < count {
            if rate.word_ns(*began_ns, *moved + 1) > now_ns {
                // A stream looks when the FIFO is half full.
                let next = (*moved + 1).next_multiple_of(HALF).min(count);
                return Step::Wait(Some(rate.word_ns(*began_ns, next)));
            }
            if self.fifo.len() == FIFO_WORDS {
                return Step::Failed(sta::RXOVERR);
            }
            self.fifo.push_back(words.get(*moved).copied().unwrap_or_default());
            *moved += 1;
        }
        let ends_ns = rate.block_ns(*began_ns, count);
        match ends_ns {
            _ if ends_ns > now_ns => Step::Wait(Some(ends_ns)),
            _ if *is_sound && !is_spoilt => Step::BlockEnd(ends_ns),
            _ => Step::Failed(sta::DCRCFAIL),
        }
    }

    fn send_words(&mut self, data: &mut Data, now_ns: u64) -> Step {
        let (rate, count, is_spoilt) = (data.rate, data.words_of_block(), data.is_spoilt);
        let Phase::Send { began_ns, bytes, moved } = &mut data.phase else { return Step::Wait(None) };
        while *moved < count {
            if rate.word_ns(*began_ns, *moved + 1) > now_ns {
                let next = (*moved + 1).next_multiple_of(HALF).min(count);
                return Step::Wait(Some(rate.word_ns(*began_ns, next)));
            }
            let Some(word) = self.fifo.pop_front() else { return Step::Failed(sta::TXUNDERR) };
            bytes.extend(word.to_le_bytes());
            *moved += 1;
        }
        let at_ns = rate.block_ns(*began_ns, count) + clocks_ns(STATUS_CLOCKS, rate.hz);
        if at_ns > now_ns {
            return Step::Wait(Some(at_ns));
        }
        let wired_lines = self.lines;
        let ends_before_busy = self.ends_before_busy;
        let status = self.reached().map_or(Status::None, |card| {
            let agrees = rate.lines <= wired_lines && (rate.lines == 4) == card.is_wide();
            card.take_block(at_ns, bytes, agrees && !is_spoilt)
        });
        match status {
            Status::Refused => Step::Failed(sta::DCRCFAIL),
            Status::Taken(_) if ends_before_busy => Step::BlockEnd(at_ns),
            Status::Taken(until_ns) => Step::Again(Phase::Busy { since_ns: at_ns, until_ns: Some(until_ns) }),
            Status::None => Step::Again(Phase::Busy { since_ns: at_ns, until_ns: None }),
        }
    }
}
