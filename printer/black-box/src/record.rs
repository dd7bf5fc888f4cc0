//! A record: an event, encoded as bytes.
//!
//! | byte | |
//! |---|---|
//! | 0 | number of bytes of the contents |
//! | 1 | kind |
//! | 2 to 5 | time since the start, ms, little-endian |
//! | 6 .. | contents |
//! | last | check: all bytes before it and this one have the exclusive or 0xa5 |

/// Longest command text that is kept, bytes; the rest is cut.
pub const MAX_COMMAND_BYTES: usize = 48;

/// Longest other text, bytes; the rest is cut.
pub const MAX_TEXT_BYTES: usize = 120;

/// Bytes of a record besides its contents.
pub(crate) const OVERHEAD: usize = 7;

/// Longest record, bytes.
pub(crate) const MAX_BYTES: usize = OVERHEAD + MAX_TEXT_BYTES;

/// The exclusive or of all bytes of a record.
const CHECK: u8 = 0xa5;

const COMMAND: u8 = 1;
const TEMPERATURES: u8 = 2;
const DRIVER: u8 = 3;
const HALT: u8 = 4;
const RESET: u8 = 5;
const LAST_WORDS: u8 = 6;
const CHAMBER: u8 = 7;
const NOZZLE1: u8 = 8;

/// State of a heater at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeaterSample {
    /// Tenths of a degree Celsius.
    pub decicelsius: i16,
    /// Target, tenths of a degree Celsius; 0 = off.
    pub target_decicelsius: i16,
    /// Power, 0 to 255.
    pub power: u8,
}

impl HeaterSample {
    /// Converts degrees and a share of full power; values outside the types' ranges become
    /// the nearest end.
    pub fn new(celsius: f32, target_celsius: f32, power: f32) -> Self {
        // Casts from float saturate.
        let tenths = |celsius: f32| (celsius * 10.0) as i16;
        Self { decicelsius: tenths(celsius), target_decicelsius: tenths(target_celsius), power: (power * 255.0) as u8 }
    }

    fn to_bytes(self) -> [u8; 5] {
        let [a, b] = self.decicelsius.to_le_bytes();
        let [c, d] = self.target_decicelsius.to_le_bytes();
        [a, b, c, d, self.power]
    }

    fn from_bytes([a, b, c, d, power]: [u8; 5]) -> Self {
        let tenths = |bytes| i16::from_le_bytes(bytes);
        Self { decicelsius: tenths([a, b]), target_decicelsius: tenths([c, d]), power }
    }
}

/// Event. Texts are usually ASCII, and are cut if they are too long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Record<'a> {
    /// A command began.
    Command {
        /// Line in the file or from the host, counted from 1.
        line: u32,
        /// Text without comment and line number.
        text: &'a [u8],
    },
    /// Nozzle and bed.
    Temperatures([HeaterSample; 2]),
    /// The chamber, on a machine that measures its temperature.
    Chamber(HeaterSample),
    /// The nozzle of a second tool, on a machine that has one.
    Nozzle1(HeaterSample),
    /// A motor's driver has reported something.
    Driver(&'a [u8]),
    /// The machine was halted for this reason.
    Halt(&'a [u8]),
    /// The chip restarted for this reason. The record's time is that of the previous program, as
    /// far as it is known.
    Reset(&'a [u8]),
    /// Last message of a program that a panic or a fault ended.
    LastWords(&'a [u8]),
}

/// The bytes of a record except the last.
pub(crate) struct Parts<'a> {
    /// All bytes before the text: the first `length` of these.
    head: [u8; 16],
    length: usize,
    text: &'a [u8],
}

impl Parts<'_> {
    /// Length of the record, bytes.
    pub fn bytes(&self) -> usize {
        self.length + self.text.len() + 1
    }

    /// Hands them over.
    pub fn put(&self, mut put: impl FnMut(u8)) {
        let mut check = CHECK;
        for byte in self.head.iter().take(self.length).chain(self.text) {
            check ^= byte;
            put(*byte);
        }
        put(check);
    }
}

impl Record<'_> {
    /// Bytes of the record.
    pub(crate) fn parts(&self, now_ms: u32) -> Parts<'_> {
        let mut head = [0; 16];
        let (kind, fixed, most, text) = match *self {
            Self::Command { line, text } => {
                head[6..10].copy_from_slice(&line.to_le_bytes());
                (COMMAND, 4, MAX_COMMAND_BYTES, text)
            }
            Self::Temperatures(heaters) => {
                for (place, heater) in head[6..].as_chunks_mut::<5>().0.iter_mut().zip(heaters) {
                    *place = heater.to_bytes();
                }
                (TEMPERATURES, 10, 0, &[][..])
            }
            Self::Chamber(heater) => {
                head[6..11].copy_from_slice(&heater.to_bytes());
                (CHAMBER, 5, 0, &[][..])
            }
            Self::Nozzle1(heater) => {
                head[6..11].copy_from_slice(&heater.to_bytes());
                (NOZZLE1, 5, 0, &[][..])
            }
            Self::Driver(text) => (DRIVER, 0, MAX_TEXT_BYTES, text),
            Self::Halt(text) => (HALT, 0, MAX_TEXT_BYTES, text),
            Self::Reset(text) => (RESET, 0, MAX_TEXT_BYTES, text),
            Self::LastWords(text) => (LAST_WORDS, 0, MAX_TEXT_BYTES, text),
        };
        let text = text.get(..most).unwrap_or(text);
        let [a, b, c, d] = now_ms.to_le_bytes();
        head[..6].copy_from_slice(&[(fixed + text.len()) as u8, kind, a, b, c, d]);
        Parts { head, length: 6 + fixed, text }
    }
}

/// A record with its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamped<'a> {
    /// Time since the start of the program that wrote it, ms.
    pub now_ms: u32,
    /// The event.
    pub record: Record<'a>,
}

/// Reads records one after the other. `None` in place of a record means that it is damaged, or of a
/// kind that this program does not know.
#[derive(Clone, Debug)]
pub struct RecordReader<'a>(pub &'a [u8]);

impl<'a> Iterator for RecordReader<'a> {
    type Item = Option<Stamped<'a>>;

    fn next(&mut self) -> Option<Self::Item> {
        let length = usize::from(*self.0.first()?) + OVERHEAD;
        let Some((record, rest)) = self.0.split_at_checked(length) else {
            self.0 = &[];
            return Some(None);
        };
        self.0 = rest;
        Some(decode(record))
    }
}

fn decode(record: &[u8]) -> Option<Stamped<'_>> {
    if record.iter().fold(CHECK, |check, byte| check ^ byte) != 0 {
        return None;
    }
    let [_, kind, a, b, c, d, contents @ .., _] = record else { return None };
    let record = match *kind {
        COMMAND => {
            let (line, text) = contents.split_first_chunk()?;
            Record::Command { line: u32::from_le_bytes(*line), text }
        }
        TEMPERATURES => {
            let (&[nozzle, bed], []) = contents.as_chunks() else { return None };
            Record::Temperatures([nozzle, bed].map(HeaterSample::from_bytes))
        }
        CHAMBER => Record::Chamber(HeaterSample::from_bytes(contents.try_into().ok()?)),
        NOZZLE1 => Record::Nozzle1(HeaterSample::from_bytes(contents.try_into().ok()?)),
        DRIVER => Record::Driver(contents),
        HALT => Record::Halt(contents),
        RESET => Record::Reset(contents),
        LAST_WORDS => Record::LastWords(contents),
        _ => return None,
    };
    Some(Stamped { now_ms: u32::from_le_bytes([*a, *b, *c, *d]), record })
}
