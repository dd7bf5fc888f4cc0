//! Reader of step traces: a line of JSON, then records of 12 bytes, streamed.

use crate::reference::Kinematics;
use serde::Deserialize;
use serde_json::Value;
use std::fmt;
use std::io::{self, BufRead, BufReader, Read};

/// Length of a record without the positions that may follow it, bytes.
pub const RECORD_BYTES: usize = 12;

/// Longest header accepted, bytes: enough for any, and bounded for a file that is not a trace.
const HEADER_BYTES_MAX: u64 = 65_536;

/// The first line of a trace.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceHeader {
    /// Ticks a second.
    pub tick_hz: u64,
    /// Names of the motors, in the order of the bits; at most eight.
    pub axes: Vec<String>,
    /// Steps/mm of each motor, in the same order.
    pub steps_per_mm: Vec<f64>,
    /// Way in which the motors move the tool.
    pub kinematics: Kinematics,
}

/// A step event: the axes in the mask step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepEvent {
    /// Time, in ticks of the motion clock.
    pub tick: u64,
    /// Motors that step; bit i is motor i of [`TraceHeader::axes`].
    pub axes: u8,
    /// Directions; a set bit i means negative.
    pub directions: u8,
}

/// One record of a trace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Record {
    /// Kind 0.
    Step(StepEvent),
    /// Kind 1: homing gave the motors new positions.
    PositionsRedefined {
        /// Time, in ticks.
        tick: u64,
        /// Position of each motor of [`TraceHeader::axes`], in steps.
        positions: Vec<i32>,
    },
    /// Kind 2: a move has ended.
    MoveEnd {
        /// Time, in ticks.
        tick: u64,
        /// Source line, from 1.
        line: u32,
    },
}

/// A trace could not be read.
#[derive(Debug)]
pub enum TraceError {
    /// The reader failed.
    Io(io::Error),
    /// No line end within the first 64 KiB.
    NoHeader,
    /// The first line is not a JSON object.
    HeaderJson(serde_json::Error),
    /// A value of the header is missing, of another type, or not supported; the key's name.
    Header(&'static str),
    /// The trace ends inside a record, or inside the positions after one.
    Truncated {
        /// Start of the record, counted in bytes from the end of the header line.
        offset: u64,
    },
    /// A record of a kind that does not exist.
    UnknownKind {
        /// The kind.
        kind: u8,
        /// Start of the record.
        offset: u64,
    },
    /// The record's last byte is not zero.
    Reserved {
        /// Start of the record.
        offset: u64,
    },
    /// A step event of no motor, or of one the header does not name.
    BadAxes {
        /// The mask.
        axes: u8,
        /// Start of the record.
        offset: u64,
    },
}

impl fmt::Display for TraceError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(formatter, "trace: {error}"),
            Self::NoHeader => write!(formatter, "trace: no header line"),
            Self::HeaderJson(error) => write!(formatter, "trace header: {error}"),
            Self::Header(key) => write!(formatter, "trace header: {key} is missing or not supported"),
            Self::Truncated { offset } => write!(formatter, "trace ends inside the record at byte {offset}"),
            Self::UnknownKind { kind, offset } => write!(formatter, "record of unknown kind {kind} at byte {offset}"),
            Self::Reserved { offset } => write!(formatter, "reserved byte is not zero in the record at byte {offset}"),
            Self::BadAxes { axes, offset } => write!(formatter, "axes {axes:#04x} in the record at byte {offset}"),
        }
    }
}

impl std::error::Error for TraceError {}

/// The header of the file. Lists may also be tables by axis name.
#[derive(Deserialize)]
struct HeaderText {
    #[serde(default)]
    format: Value,
    #[serde(default)]
    version: Value,
    #[serde(default)]
    tick_hz: Value,
    #[serde(default)]
    axes: Value,
    #[serde(default)]
    steps_per_mm: Value,
    #[serde(default)]
    kinematics: Value,
}

impl TraceHeader {
    /// Reads the header's line.
    ///
    /// # Errors
    /// [`TraceError::HeaderJson`] or [`TraceError::Header`].
    fn from_json(line: &[u8]) -> Result<Self, TraceError> {
        let text: HeaderText = serde_json::from_slice(line).map_err(TraceError::HeaderJson)?;
        if text.format != "ferrostep-trace" {
            return Err(TraceError::Header("format"));
        }
        if text.version != 1 {
            return Err(TraceError::Header("version"));
        }
        let tick_hz = text.tick_hz.as_u64().filter(|hz| *hz > 0).ok_or(TraceError::Header("tick_hz"))?;
        let axes = names(&text.axes).ok_or(TraceError::Header("axes"))?;
        let kinematics =
            text.kinematics.as_str().and_then(Kinematics::from_name).ok_or(TraceError::Header("kinematics"))?;
        let steps_per_mm = numbers(&text.steps_per_mm, &axes).ok_or(TraceError::Header("steps_per_mm"))?;
        Ok(Self { tick_hz, axes, steps_per_mm, kinematics })
    }
}

fn names(value: &Value) -> Option<Vec<String>> {
    let names: Vec<String> = match value {
        Value::String(letters) => letters.chars().map(String::from).collect(),
        Value::Array(items) => items.iter().map(|item| item.as_str().map(String::from)).collect::<Option<_>>()?,
        _ => return None,
    };
    (1..=8).contains(&names.len()).then_some(names)
}

fn numbers(value: &Value, axes: &[String]) -> Option<Vec<f64>> {
    match value {
        Value::Array(items) if items.len() == axes.len() => items.iter().map(Value::as_f64).collect(),
        Value::Object(table) => axes.iter().map(|axis| table.get(axis)?.as_f64()).collect(),
        _ => None,
    }
}

/// Streams the records of a trace. After an error the iteration ends.
#[derive(Debug)]
pub struct TraceReader<R> {
    input: BufReader<R>,
    header: TraceHeader,
    offset: u64,
    ended: bool,
}

impl<R: Read> TraceReader<R> {
    /// Reads the header and stops before the first record.
    ///
    /// # Errors
    /// [`TraceError`] if the header is missing or not one of this format and version.
    pub fn new(input: R) -> Result<Self, TraceError> {
        let mut input = BufReader::with_capacity(1 << 16, input);
        let mut line = Vec::new();
        input.by_ref().take(HEADER_BYTES_MAX).read_until(b'\n', &mut line).map_err(TraceError::Io)?;
        if line.pop() != Some(b'\n') {
            return Err(TraceError::NoHeader);
        }
        Ok(Self { input, header: TraceHeader::from_json(&line)?, offset: 0, ended: false })
    }

    /// The header.
    pub fn header(&self) -> &TraceHeader {
        &self.header
    }

    fn read_record(&mut self) -> Result<Option<Record>, TraceError> {
        if self.input.fill_buf().map_err(TraceError::Io)?.is_empty() {
            return Ok(None);
        }
        let offset = self.offset;
        let [t0, t1, t2, t3, t4, t5, t6, t7, kind, axes, directions, reserved] = self.bytes::<RECORD_BYTES>(offset)?;
        let tick = u64::from_le_bytes([t0, t1, t2, t3, t4, t5, t6, t7]);
        if reserved != 0 {
            return Err(TraceError::Reserved { offset });
        }
        match kind {
            0 => {
                // The header names at most eight axes, so that the shift stays inside
                // the mask's type.
                let known = u8::MAX >> 8usize.saturating_sub(self.header.axes.len());
                if axes == 0 || axes & !known != 0 {
                    return Err(TraceError::BadAxes { axes, offset });
                }
                Ok(Some(Record::Step(StepEvent { tick, axes, directions })))
            }
            1 => {
                let mut positions = Vec::with_capacity(self.header.axes.len());
                for _ in 0..self.header.axes.len() {
                    positions.push(i32::from_le_bytes(self.bytes(offset)?));
                }
                Ok(Some(Record::PositionsRedefined { tick, positions }))
            }
            2 => Ok(Some(Record::MoveEnd { tick, line: u32::from_le_bytes(self.bytes(offset)?) })),
            kind => Err(TraceError::UnknownKind { kind, offset }),
        }
    }

    fn bytes<const N: usize>(&mut self, record_offset: u64) -> Result<[u8; N], TraceError> {
        let mut bytes = [0; N];
        self.input.read_exact(&mut bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => TraceError::Truncated { offset: record_offset },
            _ => TraceError::Io(error),
        })?;
        self.offset += N as u64;
        Ok(bytes)
    }
}

impl<R: Read> Iterator for TraceReader<R> {
    type Item = Result<Record, TraceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let record = self.read_record().transpose();
        self.ended = !matches!(record, Some(Ok(_)));
        record
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const HEADER: &str = concat!(
        r#"{"format":"ferrostep-trace","version":1,"tick_hz":84000000,"axes":["x","y","z","e"],"#,
        r#""steps_per_mm":[80,80,400,95.5],"kinematics":"cartesian"}"#,
        "\n"
    );

    fn trace(records: &[u8]) -> Result<Vec<Record>, TraceError> {
        TraceReader::new([HEADER.as_bytes(), records].concat().as_slice())?.collect()
    }

    fn record(tick: u64, rest: [u8; 4]) -> Vec<u8> {
        [tick.to_le_bytes().as_slice(), &rest].concat()
    }

    #[test]
    fn all_kinds_are_read() {
        let mut bytes = record(0x0102_0304_0506, [0, 0b1001, 0b1000, 0]);
        bytes.extend(record(7, [1, 0, 0, 0]));
        for position in [0i32, -1, i32::MIN, 24_000] {
            bytes.extend(position.to_le_bytes());
        }
        bytes.extend(record(9, [2, 0, 0, 0]));
        bytes.extend(70_000u32.to_le_bytes());
        let step = StepEvent { tick: 0x0102_0304_0506, axes: 0b1001, directions: 0b1000 };
        assert_eq!(
            trace(&bytes).unwrap(),
            [
                Record::Step(step),
                Record::PositionsRedefined { tick: 7, positions: vec![0, -1, i32::MIN, 24_000] },
                Record::MoveEnd { tick: 9, line: 70_000 },
            ]
        );
    }

    #[test]
    fn every_cut_inside_a_record_is_noticed() {
        let mut bytes = record(5, [1, 0, 0, 0]);
        bytes.extend([0; 16]);
        let second = bytes.len();
        bytes.extend(record(6, [2, 0, 0, 0]));
        bytes.extend([3, 0, 0, 0]);
        assert_eq!(trace(&bytes).unwrap().len(), 2);
        for length in 1..bytes.len() {
            match trace(&bytes[..length]) {
                Ok(records) => assert_eq!((length, records.len()), (second, 1)),
                Err(TraceError::Truncated { offset }) => {
                    assert_eq!(offset, if length < second { 0 } else { second as u64 });
                }
                Err(error) => panic!("{error}"),
            }
        }
    }

    #[test]
    fn bad_records_are_named() {
        assert!(matches!(trace(&record(1, [3, 1, 0, 0])), Err(TraceError::UnknownKind { kind: 3, offset: 0 })));
        assert!(matches!(trace(&record(1, [0, 1, 0, 9])), Err(TraceError::Reserved { offset: 0 })));
        assert!(matches!(trace(&record(1, [0, 0x10, 0, 0])), Err(TraceError::BadAxes { axes: 0x10, .. })));
        assert!(matches!(trace(&record(1, [0, 0, 0, 0])), Err(TraceError::BadAxes { axes: 0, .. })));
    }

    #[test]
    fn bad_headers_are_named() {
        let with = |from: &str, to: &str| TraceReader::new(HEADER.replace(from, to).as_bytes()).map(|_| ());
        assert!(with("", "").is_ok());
        assert!(with("[80,80,400,95.5]", r#"{"x":80,"y":80,"z":400,"e":95.5}"#).is_ok());
        assert!(matches!(with("-trace", "-tracé"), Err(TraceError::Header("format"))));
        assert!(matches!(with("\"version\":1", "\"version\":2"), Err(TraceError::Header("version"))));
        assert!(matches!(with("84000000", "0"), Err(TraceError::Header("tick_hz"))));
        assert!(matches!(with(",95.5", ""), Err(TraceError::Header("steps_per_mm"))));
        assert!(matches!(with("cartesian", "delta"), Err(TraceError::Header("kinematics"))));
        assert!(matches!(with("{", "["), Err(TraceError::HeaderJson(_))));
        assert!(matches!(with("\n", ""), Err(TraceError::NoHeader)));
        assert!(matches!(TraceReader::new(io::repeat(b' ')), Err(TraceError::NoHeader)));
    }
}
