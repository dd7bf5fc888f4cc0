//! Records of a print: a trace for programs, a waveform for people.

mod motor_names;
mod trace;
mod vcd;
mod window;

pub use trace::TraceWriter;
pub use vcd::VcdWriter;
pub use window::{Bound, Window};

use std::any::Any;

use ferrostep_planner::{Move, StepObserver};

use crate::output::OutputError;

/// Observes every step and every event of the motion.
pub trait Observer: StepObserver + Any {
    /// A move was queued. If the source line's move ends with it, [`Self::move_ended`] follows when
    /// it has been executed. `slowed_moves`: number of moves slowed so far because the board could
    /// not keep up with them.
    fn planned(&mut self, _taken: &Move, _slowed_moves: u64) {}
    /// The motors' positions are redefined (homing).
    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]);
    /// A move has ended.
    fn move_ended(&mut self, tick: u64, line: u32);
}

/// An observer of any type: the machine's code is the same for all of them.
pub type AnyObserver = Box<dyn Observer>;

impl Observer for () {
    fn redefined(&mut self, _tick: u64, _motor_steps: [i64; 4]) {}
    fn move_ended(&mut self, _tick: u64, _line: u32) {}
}

/// A trace, a waveform, or both.
#[derive(Default)]
pub struct Recorder {
    /// `--trace`
    pub trace: Option<TraceWriter>,
    /// `--vcd`
    pub vcd: Option<VcdWriter>,
}

impl Recorder {
    /// Returns true if a waveform is written and no motion lies in its part so far.
    pub fn waveform_is_empty(&self) -> bool {
        self.vcd.as_ref().is_some_and(|vcd| !vcd.has_changes())
    }

    /// Flushes and completes both outputs.
    ///
    /// # Errors
    /// One of them could not be written, and was removed.
    pub fn finish(self) -> Result<(), OutputError> {
        let trace = self.trace.map_or(Ok(()), TraceWriter::finish);
        let vcd = self.vcd.map_or(Ok(()), VcdWriter::finish);
        trace.and(vcd)
    }
}

impl StepObserver for Recorder {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        if let Some(trace) = &mut self.trace {
            trace.stepped(tick, axes, directions);
        }
        if let Some(vcd) = &mut self.vcd {
            vcd.stepped(tick, axes, directions);
        }
    }
}

impl Observer for Recorder {
    fn planned(&mut self, taken: &Move, _slowed_moves: u64) {
        if let Some(vcd) = &mut self.vcd {
            vcd.planned(taken);
        }
    }

    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        if let Some(trace) = &mut self.trace {
            trace.redefined(tick, motor_steps);
        }
        if let Some(vcd) = &mut self.vcd {
            vcd.redefined(tick);
        }
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        if let Some(trace) = &mut self.trace {
            trace.move_ended(tick, line);
        }
        if let Some(vcd) = &mut self.vcd {
            vcd.move_ended(tick);
        }
    }
}
