//! The trace format: a line of JSON, then 12-byte records.

use std::io::{self, BufWriter, Write};

use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::Profile;
use serde::Serialize;

use super::motor_names::motor_names;
use crate::output::{Output, OutputError};

const STEP: u8 = 0;
const REDEFINED: u8 = 1;
const MOVE_ENDED: u8 = 2;

#[derive(Serialize)]
struct Header {
    format: &'static str,
    version: u32,
    tick_hz: u32,
    axes: [char; 4],
    steps_per_mm: [f64; 4],
    kinematics: &'static str,
}

/// Writes a trace. Ticks are those of the motion clock, which advances only while blocks run.
pub struct TraceWriter {
    out: BufWriter<Output>,
    error: Option<io::Error>,
}

impl TraceWriter {
    /// Writes the header.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn new(out: Output, profile: &Profile) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 20, out);
        let header = Header {
            format: "ferrostep-trace",
            version: 1,
            tick_hz: TICKS_PER_SECOND,
            axes: motor_names(profile),
            steps_per_mm: profile.steps_per_mm.map(|steps| steps.to_f64()),
            kinematics: profile.kinematics.name(),
        };
        serde_json::to_writer(&mut out, &header)?;
        out.write_all(b"\n")?;
        Ok(Self { out, error: None })
    }

    fn write(&mut self, bytes: &[u8]) {
        // A step has no way to report an error: the first one is kept, and later
        // records are dropped.
        if self.error.is_none() {
            self.error = self.out.write_all(bytes).err();
        }
    }

    fn record(&mut self, tick: u64, kind: u8, axes: u8, directions: u8) {
        let mut record = [0; 12];
        record[..8].copy_from_slice(&tick.to_le_bytes());
        record[8..11].copy_from_slice(&[kind, axes, directions]);
        self.write(&record);
    }

    pub(super) fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.record(tick, STEP, axes, directions);
    }

    pub(super) fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.record(tick, REDEFINED, 0, 0);
        for steps in motor_steps {
            self.write(&(steps as i32).to_le_bytes());
        }
    }

    pub(super) fn move_ended(&mut self, tick: u64, line: u32) {
        self.record(tick, MOVE_ENDED, 0, 0);
        self.write(&line.to_le_bytes());
    }

    pub(super) fn finish(self) -> Result<(), OutputError> {
        match self.error {
            Some(error) => Err(self.out.get_ref().failed(error)),
            None => Output::keep_buffered(self.out),
        }
    }
}
