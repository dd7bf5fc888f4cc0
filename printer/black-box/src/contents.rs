//! The bytes of a black box, as the desk reads them.

use core::fmt;

use ferrostep_step_player::{MAX_EVENTS, Past, PastSlot, PositionMark};

use crate::dump::{BOTH_EDGES, CRC, DAMAGED, Facts, KEPT, MAGIC, NO_MEMORY};
use crate::record::RecordReader;
use crate::varint;

/// Reason why bytes are not a black box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadError {
    /// The bytes do not begin as a black box does.
    Magic,
    /// The bytes end too early.
    Short,
    /// The stored checksum does not match the bytes.
    Checksum {
        /// Stored checksum.
        expected: u32,
        /// Computed checksum.
        computed: u32,
    },
    /// A slot that no step queue can hold, by its place.
    Slot(u16),
    /// The record counts more slots than exist, or more events than a slot has.
    Counts,
    /// A name is not text.
    Name,
    /// Bytes after the last slot.
    Long(usize),
}

impl fmt::Display for ReadError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Magic => out.write_str("not a black box: its first bytes are not those of one"),
            Self::Short => out.write_str("the black box is cut short: fetch it again"),
            Self::Checksum { expected, computed } => write!(
                out,
                "the black box is damaged: its checksum is {expected:08x}, that of its bytes {computed:08x}: fetch it again"
            ),
            Self::Slot(place) => {
                write!(out, "the black box is damaged: a step queue has no slot {place}: fetch it again")
            }
            Self::Counts => {
                out.write_str("the black box is damaged: it counts more steps than it holds: fetch it again")
            }
            Self::Name => out.write_str("the black box is damaged: a name in it is not text: fetch it again"),
            Self::Long(bytes) => write!(out, "{bytes} bytes follow the end of the black box: fetch it again"),
        }
    }
}

impl core::error::Error for ReadError {}

/// Origin of a black box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity<'a> {
    /// The board.
    pub board: &'a str,
    /// The profile.
    pub profile: &'a str,
    /// Version of the firmware that sent it.
    pub version: &'a str,
}

/// The contents of a black box.
#[derive(Clone, Debug)]
pub struct Contents<'a> {
    /// Origin.
    pub identity: Identity<'a>,
    /// Each edge of a step signal is a step.
    pub both_edges: bool,
    /// Ticks a second of the step timer.
    pub tick_hz: u32,
    /// Length of a pulse, ticks.
    pub pulse_ticks: u32,
    /// Board time of the dump, ms since the board's start.
    pub now_ms: u32,
    /// Some slots were damaged and are left out.
    pub is_damaged: bool,
    /// The board has a memory for records.
    pub has_memory: bool,
    /// Range of the slots, numbered from 0: `oldest` is 0.
    pub past: Past,
    /// The records, the oldest first.
    pub records: RecordReader<'a>,
    /// The slots, the oldest first.
    pub slots: Slots<'a>,
}

/// Slots of a black box, already checked.
#[derive(Clone, Debug)]
pub struct Slots<'a> {
    bytes: &'a [u8],
    left: u16,
    reload: u32,
}

impl Iterator for Slots<'_> {
    type Item = PastSlot;

    fn next(&mut self) -> Option<PastSlot> {
        self.left = self.left.checked_sub(1)?;
        let slot = slot(&mut self.bytes, self.reload)?;
        self.reload = slot.reload;
        Some(slot)
    }
}

/// Bytes, taken from the front.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn array<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        let (array, rest) = self.0.split_first_chunk().ok_or(ReadError::Short)?;
        self.0 = rest;
        Ok(*array)
    }

    fn byte(&mut self) -> Result<u8, ReadError> {
        self.array::<1>().map(|[byte]| byte)
    }

    fn u16(&mut self) -> Result<u16, ReadError> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, ReadError> {
        self.array().map(u32::from_le_bytes)
    }

    fn slice(&mut self, length: usize) -> Result<&'a [u8], ReadError> {
        let (slice, rest) = self.0.split_at_checked(length).ok_or(ReadError::Short)?;
        self.0 = rest;
        Ok(slice)
    }

    fn name(&mut self) -> Result<&'a str, ReadError> {
        let length = self.byte()?;
        let name = core::str::from_utf8(self.slice(length.into())?).map_err(|_| ReadError::Name)?;
        if name.chars().any(char::is_control) { Err(ReadError::Name) } else { Ok(name) }
    }

    fn position(&mut self) -> Result<Option<PositionMark>, ReadError> {
        let is_present = self.byte()? != 0;
        let [filled, next, now_ms] = [self.u32()?, self.u32()?, self.u32()?];
        let motor_steps = [self.u32()?, self.u32()?, self.u32()?, self.u32()?].map(|steps| steps as i32);
        Ok(is_present.then_some(PositionMark { filled, next, now_ms, motor_steps }))
    }
}

fn slot(bytes: &mut &[u8], reload: u32) -> Option<PastSlot> {
    let byte = |bytes: &mut &[u8]| {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        Some(byte)
    };
    let axes = byte(bytes)?;
    let events = varint::take(bytes)?;
    let reload = varint::moved(reload, varint::take(bytes)?);
    let turns = if events & 1 == 1 { byte(bytes)? } else { 0 };
    let (turned, backwards) = (turns & 15, turns >> 4);
    let events = u16::try_from(events >> 1).ok()?;
    let is_sound = (1..=MAX_EVENTS).contains(&events) && reload > 0 && backwards & !turned == 0;
    is_sound.then_some(PastSlot { first: axes & 15, then: axes >> 4, turned, backwards, reload, events })
}

impl<'a> Contents<'a> {
    /// Reads a black box and checks everything except the records, each of which has its own check.
    ///
    /// # Errors
    /// [`ReadError`]
    pub fn read(all: &'a [u8]) -> Result<Self, ReadError> {
        if all.get(..MAGIC.len()) != Some(&MAGIC) {
            return Err(ReadError::Magic);
        }
        let (contents, checksum) =
            all.split_last_chunk().filter(|(contents, _)| contents.len() >= MAGIC.len()).ok_or(ReadError::Short)?;
        let (expected, computed) = (u32::from_le_bytes(*checksum), CRC.checksum(contents));
        if expected != computed {
            return Err(ReadError::Checksum { expected, computed });
        }
        let mut bytes = Bytes(contents);
        let [..] = bytes.array::<4>()?;
        let flags = bytes.byte()?;
        let [tick_hz, pulse_ticks, now_ms] = [bytes.u32()?, bytes.u32()?, bytes.u32()?];
        let [filled, begun, events_left] = [bytes.u16()?, bytes.u16()?, bytes.u16()?];
        let directions = bytes.byte()? & 15;
        let positions = [bytes.position()?, bytes.position()?];
        let identity = Identity { board: bytes.name()?, profile: bytes.name()?, version: bytes.name()? };
        let length = bytes.u16()?;
        let records = RecordReader(bytes.slice(length.into())?);
        let slots = Slots { bytes: bytes.0, left: filled, reload: 0 };
        let (mut left, mut reload, mut events_before) = (bytes.0, 0, 0);
        for place in 0..filled {
            let slot = slot(&mut left, reload).ok_or(ReadError::Slot(place))?;
            reload = slot.reload;
            if place + 1 == begun {
                events_before = slot.events;
            }
        }
        if begun > filled || events_left > events_before {
            return Err(ReadError::Counts);
        }
        if !left.is_empty() {
            return Err(ReadError::Long(left.len()));
        }
        let past = Past {
            oldest: 0,
            next: begun.into(),
            filled: filled.into(),
            events_left,
            directions,
            is_kept: flags & KEPT != 0,
            positions,
        };
        Ok(Self {
            identity,
            both_edges: flags & BOTH_EDGES != 0,
            tick_hz,
            pulse_ticks,
            now_ms,
            is_damaged: flags & DAMAGED != 0,
            has_memory: flags & NO_MEMORY == 0,
            past,
            records,
            slots,
        })
    }

    /// Facts that the board sent.
    pub fn facts(&self) -> Facts<'a> {
        let Self { identity: Identity { board, profile, version }, both_edges, tick_hz, pulse_ticks, now_ms, .. } =
            *self;
        Facts { both_edges, tick_hz, pulse_ticks, now_ms, names: [board, profile, version] }
    }

    /// Number of events that were played, over all slots.
    pub fn events_played(&self) -> u64 {
        let begun = self.slots.clone().take(self.past.next as usize);
        begun.map(|slot| u64::from(slot.events)).sum::<u64>().saturating_sub(self.past.events_left.into())
    }
}
