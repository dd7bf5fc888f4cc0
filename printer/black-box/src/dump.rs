//! The black box as lines of text, generated while they are sent: straight from the memories,
//! without a copy.
//!
//! A line is `blackbox:NUMBER:BASE64`, 45 bytes in 60 characters, numbered from 0; the last is
//! `blackbox:end:LINES`. Other lines may come in between. The bytes, little-endian:
//!
//! | | |
//! |---|---|
//! | 4 bytes | `FBX1` |
//! | u8 | bit 0: both edges step; 1: a stop or a reset has left the steps; 2: some slots were damaged and are left out; 3: no memory of records |
//! | 2 × u32 | ticks a second of the step timer, ticks of a pulse |
//! | u32 | time now, ms since the start |
//! | 2 × u16 | slots that follow, and how many of them were begun |
//! | u16 | events that the last one begun has left unplayed |
//! | u8 | directions after the last slot |
//! | 2 × 29 bytes | where the motors stood: u8 present; i32 slots from the first one to the place; i32 the same to the slot that came next; u32 time, ms; 4 × i32 steps |
//! | 3 texts | board, profile, version: u8 length, bytes |
//! | u16, bytes | the records |
//! | slots | u8 motors of the first event and, in the upper half, of the others; number of events times 2, plus 1 if a motor turns; difference of the reload value to the one before; then, if a motor turns, u8 which, and in the upper half which of them run backwards |
//! | u32 | CRC-32 (ISO-HDLC) of all before |

use core::fmt::Write;

use ferrostep_step_player::{Past, PastSlot, PositionMark};
use heapless::{String, Vec};

use crate::memory::RecordMemory;
use crate::varint;

/// Prefix of every line.
pub const PREFIX: &str = "blackbox:";

/// Mark of the last line, in place of a number.
pub const END: &str = "end";

/// Bytes in a line.
pub const LINE_BYTES: usize = 45;

/// Longest line, characters.
pub const LINE_CHARS: usize = 80;

/// First bytes.
pub(crate) const MAGIC: [u8; 4] = *b"FBX1";

/// Bits of the second field.
pub(crate) const BOTH_EDGES: u8 = 1;
pub(crate) const KEPT: u8 = 2;
pub(crate) const DAMAGED: u8 = 4;
pub(crate) const NO_MEMORY: u8 = 8;

/// Longest text of board, profile and version, bytes.
const MAX_NAME: usize = 40;

/// Bytes of the records that are taken at a time.
const CHUNK: usize = 32;

/// Bytes waiting for a line: less than a line, plus the longest part.
const PENDING: usize = LINE_BYTES + 2 * 29 + 32;

const BASE64: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// CRC-32 without a table: a line takes longer to send than to compute.
pub(crate) static CRC: crc::Crc<u32, crc::NoTable> = crc::Crc::<u32, crc::NoTable>::new(&crc::CRC_32_ISO_HDLC);

/// The step queue's past on the board.
pub trait StepPast {
    /// Range of the kept slots; see [`ferrostep_step_player::StepPlayer::past`].
    fn past(&self) -> Past;
    /// A kept slot; see [`ferrostep_step_player::StepPlayer::past_slot`].
    fn slot(&self, number: u32) -> Option<PastSlot>;
}

/// Facts about the board that the desk must know.
#[derive(Clone, Copy, Debug)]
pub struct Facts<'a> {
    /// Each edge of a step signal is a step.
    pub both_edges: bool,
    /// Ticks a second of the step timer.
    pub tick_hz: u32,
    /// Length of a pulse, ticks.
    pub pulse_ticks: u32,
    /// Time since the start, ms.
    pub now_ms: u32,
    /// Names of board, profile and version; cut after 40 bytes.
    pub names: [&'a str; 3],
}

/// Part that comes next.
#[derive(Clone, Copy, Debug)]
enum Part {
    Header,
    Name(usize),
    RecordBytes,
    Records(usize),
    Slots(u32),
    Checksum,
    Done,
}

/// The lines of a black box, one after the other. Nothing may move or be recorded meanwhile.
pub struct Dump<'a, S> {
    steps: S,
    memory: &'a RecordMemory,
    facts: Facts<'a>,
    past: Past,
    is_damaged: bool,
    part: Part,
    reload: u32,
    digest: crc::Digest<'static, u32, crc::NoTable>,
    pending: Vec<u8, PENDING>,
    line: u32,
    is_ended: bool,
}

impl<'a, S: StepPast> Dump<'a, S> {
    /// Dump of the present contents of these memories.
    #[inline(never)]
    pub fn new(steps: S, memory: &'a RecordMemory, facts: Facts<'a>) -> Self {
        let mut past = steps.past();
        // Goes back from the newest slot to the first that cannot be read.
        let mut sound = past.filled;
        while sound != past.oldest && steps.slot(sound.wrapping_sub(1)).is_some() {
            sound = sound.wrapping_sub(1);
        }
        let is_damaged = sound != past.oldest;
        past.oldest = sound;
        if past.filled.wrapping_sub(past.next) >= past.filled.wrapping_sub(past.oldest) {
            past.next = past.oldest;
            past.events_left = 0;
        }
        Self {
            steps,
            memory,
            facts,
            past,
            is_damaged,
            part: Part::Header,
            reload: 0,
            digest: CRC.digest(),
            pending: Vec::new(),
            line: 0,
            is_ended: false,
        }
    }

    /// Makes the next line, without its line end; `false` after the last.
    #[inline(never)]
    pub fn next_line(&mut self, text: &mut String<LINE_CHARS>) -> bool {
        text.clear();
        while self.pending.len() < LINE_BYTES && self.go_on() {}
        // The longest line fits.
        if self.pending.is_empty() {
            let is_last = !self.is_ended;
            self.is_ended = true;
            let _ = write!(text, "{PREFIX}{END}:{}", self.line);
            return is_last;
        }
        let _ = write!(text, "{PREFIX}{}:", self.line);
        self.line += 1;
        let length = self.pending.len().min(LINE_BYTES);
        if let Some(bytes) = self.pending.get(..length) {
            bytes.chunks(3).for_each(|three| encode(three, text));
        }
        let rest = self.pending.len() - length;
        self.pending.copy_within(length.., 0);
        self.pending.truncate(rest);
        true
    }

    // Not inlined, like the others: flash is short, and sending a line takes longer.
    #[inline(never)]
    fn put(&mut self, byte: u8) {
        // The longest part fits in the buffer.
        let _ = self.pending.push(byte);
        self.digest.update(&[byte]);
    }

    /// Writes the lowest bytes of a word, little-endian.
    #[inline(never)]
    fn word(&mut self, word: u32, bytes: usize) {
        word.to_le_bytes().iter().take(bytes).for_each(|byte| self.put(*byte));
    }

    /// Makes the next part; `false` if all parts are done.
    #[inline(never)]
    fn go_on(&mut self) -> bool {
        self.part = match self.part {
            Part::Header => {
                self.header();
                Part::Name(0)
            }
            Part::Name(place) => match self.facts.names.get(place) {
                Some(name) => {
                    let name = name.as_bytes();
                    let name = name.get(..MAX_NAME).unwrap_or(name);
                    self.put(name.len() as u8);
                    name.iter().for_each(|byte| self.put(*byte));
                    Part::Name(place + 1)
                }
                None => Part::RecordBytes,
            },
            Part::RecordBytes => {
                self.word(self.memory.len() as u32, 2);
                Part::Records(0)
            }
            Part::Records(place) => {
                let end = self.memory.len().min(place + CHUNK);
                for index in place..end {
                    self.put(self.memory.get(index));
                }
                if end == place { Part::Slots(self.past.oldest) } else { Part::Records(end) }
            }
            Part::Slots(number) if number == self.past.filled => Part::Checksum,
            Part::Slots(number) => {
                // This slot was read before.
                self.slot(&self.steps.slot(number).unwrap_or_default());
                Part::Slots(number.wrapping_add(1))
            }
            Part::Checksum => {
                let checksum = self.digest.clone().finalize();
                self.word(checksum, 4);
                Part::Done
            }
            Part::Done => return false,
        };
        true
    }

    fn header(&mut self) {
        let flag = |is_set, bit| if is_set { bit } else { 0 };
        let flags = flag(self.facts.both_edges, BOTH_EDGES)
            | flag(self.past.is_kept, KEPT)
            | flag(self.is_damaged, DAMAGED)
            | flag(!self.memory.is_there(), NO_MEMORY);
        let Facts { tick_hz, pulse_ticks, now_ms, .. } = self.facts;
        let Past { oldest, next, filled, events_left, directions, positions, .. } = self.past;
        self.word(u32::from_le_bytes(MAGIC), 4);
        self.put(flags);
        for word in [tick_hz, pulse_ticks, now_ms] {
            self.word(word, 4);
        }
        for count in [filled.wrapping_sub(oldest), next.wrapping_sub(oldest), events_left.into()] {
            self.word(count, 2);
        }
        self.put(directions);
        for position in positions {
            self.put(position.is_some().into());
            let PositionMark { filled, next, now_ms, motor_steps } = position.unwrap_or_default();
            for word in [filled.wrapping_sub(oldest), next.wrapping_sub(oldest), now_ms] {
                self.word(word, 4);
            }
            for steps in motor_steps {
                self.word(steps as u32, 4);
            }
        }
    }

    fn slot(&mut self, slot: &PastSlot) {
        let turns = slot.turned != 0;
        self.put(slot.first | slot.then << 4);
        let reload = varint::difference(self.reload, slot.reload);
        for number in [u32::from(slot.events) << 1 | u32::from(turns), reload] {
            varint::put(number, |byte| self.put(byte));
        }
        if turns {
            self.put(slot.turned | slot.backwards << 4);
        }
        self.reload = slot.reload;
    }
}

/// Adds up to three bytes to a text, as four characters.
fn encode(bytes: &[u8], text: &mut String<LINE_CHARS>) {
    let byte = |place| bytes.get(place).copied().map_or(0, u32::from);
    let word = byte(0) << 16 | byte(1) << 8 | byte(2);
    for place in 0..4 {
        let index = word >> (18 - 6 * place) & 63;
        let character =
            if place as usize > bytes.len() { b'=' } else { BASE64.get(index as usize).copied().unwrap_or(b'=') };
        // The longest line fits.
        let _ = text.push(character.into());
    }
}
