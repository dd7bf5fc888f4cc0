//! Hands the steps of a print to the simulation as they are made.

use ferrostep_oracle::trace::{Record, StepEvent};
use ferrostep_planner::{Move, StepObserver};
use ferrostep_session::record::Observer;
use ferrostep_simulator::steps::{StepSimulation, StepsError};

/// A step has no way to report an error: the first one is kept, and later events are dropped.
pub(super) struct StepsObserver {
    steps: StepSimulation,
    error: Option<StepsError>,
    /// The line of moves whose end no line has told.
    open_line: Option<u32>,
    /// True if moves of another line come before its end: the printer adds those.
    is_after_own: bool,
}

impl StepsObserver {
    pub(super) const fn new(steps: StepSimulation) -> Self {
        Self { steps, error: None, open_line: None, is_after_own: false }
    }

    fn play(&mut self, record: &Record) {
        if self.error.is_none() {
            self.error = self.steps.play(record).err();
        }
    }

    pub(super) fn finish(self) -> Result<StepSimulation, StepsError> {
        match self.error {
            Some(error) => Err(error),
            None => Ok(self.steps),
        }
    }
}

impl StepObserver for StepsObserver {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.play(&Record::Step(StepEvent { tick, axes, directions }));
    }
}

impl Observer for StepsObserver {
    fn planned(&mut self, taken: &Move, _slowed_moves: u64) {
        self.is_after_own |= self.open_line.is_some_and(|line| line != taken.line);
        if !taken.ends_move {
            self.open_line = Some(taken.line);
            return;
        }
        self.open_line = None;
        if std::mem::take(&mut self.is_after_own) {
            self.steps.own_moves_before(taken.line);
        }
    }

    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.play(&Record::PositionsRedefined { tick, positions: motor_steps.map(|steps| steps as i32).to_vec() });
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        self.play(&Record::MoveEnd { tick, line });
    }
}
