//! The desk's plan, as `ferrostep print --trace` writes it.
//!
//! One line of JSON (`format` "ferrostep-trace", `version` 1, `tick_hz`, `axes`), then records of
//! 12 bytes, little-endian: u64 tick, u8 kind, u8 axes, u8 directions, u8 zero. Kind 0: these axes
//! step. Kind 1: positions are redefined; one i32 for each name in `axes` follows. Kind 2: a move
//! has ended; the u32 number of its source line follows.

use serde::{Deserialize, Serialize};

use super::digest::order_digest;

/// Size of a record without its extension, bytes.
const RECORD_BYTES: usize = 12;

/// A trace of the desk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// Ticks of the motion clock per second.
    pub tick_hz: u64,
    /// The motors' names; the index is the bit in a step's masks.
    pub axes: Vec<String>,
    /// The steps.
    pub steps: Vec<TraceStep>,
    /// Redefinitions of positions, by homing.
    pub redefined: Vec<Redefined>,
}

/// Simultaneous steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TraceStep {
    /// The instant, ticks.
    pub tick: u64,
    /// The motors: bit i = axis i.
    pub axes: u8,
    /// The motors that step backwards.
    pub directions: u8,
    /// Source line of the move that ends next; 0 for the steps before a redefinition (homing) and
    /// after the last move.
    pub line: u32,
}

/// A redefinition of the motors' positions.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Redefined {
    /// The instant, ticks.
    pub tick: u64,
    /// Index of the next step.
    pub before_step: usize,
    /// The motors' new positions, steps.
    pub positions: Vec<i32>,
}

/// The first line.
#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
    tick_hz: u64,
    axes: Vec<String>,
}

impl Trace {
    /// Reads a trace.
    ///
    /// # Errors
    /// The file is not a trace of version 1, or ends within a record; the text says how to mend it.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        const WRITE: &str = "write one with `ferrostep print FILE --trace OUT`";
        let end = bytes.iter().position(|byte| *byte == b'\n').ok_or("not a trace: its first line has no end")?;
        let header: Header = serde_json::from_slice(&bytes[..end])
            .map_err(|error| format!("not a trace: the first line is not its header ({error}); {WRITE}"))?;
        if header.format != "ferrostep-trace" || header.version != 1 {
            let (format, version) = (header.format, header.version);
            return Err(format!("a {format} of version {version}, expected a ferrostep-trace of version 1; {WRITE}"));
        }
        if header.tick_hz == 0 || header.axes.is_empty() || header.axes.len() > 8 {
            return Err(format!("the header has tick_hz 0, or not 1 to 8 axes; {WRITE}"));
        }
        let mut trace = Self { tick_hz: header.tick_hz, axes: header.axes, steps: Vec::new(), redefined: Vec::new() };
        trace.records(bytes, end + 1)?;
        Ok(trace)
    }

    fn records(&mut self, bytes: &[u8], mut at: usize) -> Result<(), String> {
        let mut without_line = 0;
        let mut last_tick = 0;
        while at < bytes.len() {
            let cut = || format!("the file ends within the record at byte {at}: write the trace again");
            let record: &[u8; RECORD_BYTES] =
                bytes.get(at..at + RECORD_BYTES).and_then(|record| record.try_into().ok()).ok_or_else(cut)?;
            let [t0, t1, t2, t3, t4, t5, t6, t7, kind, axes, directions, _] = *record;
            let tick = u64::from_le_bytes([t0, t1, t2, t3, t4, t5, t6, t7]);
            if tick < last_tick {
                return Err(format!("the record at byte {at} is earlier than the one before: write the trace again"));
            }
            last_tick = tick;
            let rest = &bytes[at + RECORD_BYTES..];
            let word = |index: usize| {
                let bytes = rest.get(index * 4..index * 4 + 4).and_then(|bytes| bytes.try_into().ok());
                bytes.map(u32::from_le_bytes).ok_or_else(cut)
            };
            let mut length = RECORD_BYTES;
            match kind {
                0 => self.steps.push(TraceStep { tick, axes, directions, line: 0 }),
                1 => {
                    let positions = (0..self.axes.len()).map(|axis| word(axis).map(u32::cast_signed));
                    let positions = positions.collect::<Result<Vec<_>, _>>()?;
                    length += positions.len() * 4;
                    self.redefined.push(Redefined { tick, before_step: self.steps.len(), positions });
                    without_line = self.steps.len();
                }
                2 => {
                    let line = word(0)?;
                    length += 4;
                    for step in &mut self.steps[without_line..] {
                        step.line = line;
                    }
                    without_line = self.steps.len();
                }
                other => {
                    return Err(format!(
                        "the record at byte {at} is of kind {other}, expected 0, 1 or 2: write the trace again"
                    ));
                }
            }
            at += length;
        }
        Ok(())
    }

    /// FNV-1a-64 of the steps ([`order_digest`]): the desk's own `order_digest`.
    #[must_use]
    pub fn order_digest(&self) -> u64 {
        order_digest(self.steps.iter().map(|step| (step.axes, step.directions)))
    }

    /// The steps after the last redefinition of positions. The steps of homing depend on the
    /// machine's start, so they cannot be compared.
    #[must_use]
    pub fn steps_after_homing(&self) -> &[TraceStep] {
        let from = self.redefined.last().map_or(0, |redefined| redefined.before_step);
        self.steps.get(from..).unwrap_or_default()
    }
}
