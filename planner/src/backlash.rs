//! Backlash compensation: the play of a drive is taken up where its motor reverses.
//!
//! A nut, a gear or a belt leaves its axis some play: after a reversal the motor turns by that much
//! before the axis follows. The compensating steps join the motor's own on their way to the step
//! queue ([`BacklashStage`]), after the ones that follow the bed: no block is split, look-ahead
//! plans as before, and every step of the plan keeps its time.

mod changes;
mod stage;

use core::fmt::Debug;

pub use stage::BacklashStage;

use crate::kinematics::{Geometry, Kinematics};
use crate::limits::Limits;
use crate::passing::PassedEntries;
use crate::step_queue::{Notice, StepEntry};

/// The play of the drives of X, Y and Z, and the way it is taken up: Marlin's M425.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backlash {
    /// Play of each axis, mm, 0 to [`Self::MAX_MM`]: the distance that its motor turns after a
    /// reversal before the axis follows.
    pub play_mm: [f64; 3],
    /// Share of the play that is taken up, 0 to 1.
    pub correction: f64,
    /// Path on which play is taken up, mm, the sum over X, Y and Z, 0 to
    /// [`Self::MAX_SMOOTHING_MM`]; 0 means the shortest possible path.
    pub smoothing_mm: f64,
}

impl Backlash {
    /// No play.
    pub const NONE: Self = Self { play_mm: [0.0; 3], correction: 1.0, smoothing_mm: Self::SMOOTHING_MM };

    /// The largest play of an axis, mm. A machine with more needs repair.
    pub const MAX_MM: f64 = 2.0;

    /// The longest smoothing path, mm.
    pub const MAX_SMOOTHING_MM: f64 = 100.0;

    /// Default path on which play is taken up, mm. A motor with 0.1 mm of play moves a tenth faster
    /// on it.
    pub const SMOOTHING_MM: f64 = 1.0;

    /// First axis with play whose motor also moves another axis, on a machine with these
    /// kinematics: that motor also turns when the other axis reverses, which does not concern its
    /// play.
    pub fn shared_axis(&self, kinematics: Kinematics) -> Option<usize> {
        (0..3).zip(self.play_mm).find(|(axis, mm)| *mm > 0.0 && kinematics.shares_motors(*axis)).map(|(axis, _)| axis)
    }
}

/// Backlash compensation between the planner and the step queue: [`BacklashStage`], or
/// [`NoBacklash`] in an image for a machine without play.
pub trait BacklashCorrection: Debug {
    /// True if the image contains the compensation.
    const PRESENT: bool;

    /// Starts with no play on any axis.
    fn new(geometry: &Geometry, limits: &Limits) -> Self;

    /// The play.
    fn backlash(&self) -> Backlash;

    /// Sets the play, at standstill, after a call of [`Self::stand`].
    fn set(&mut self, backlash: &Backlash);

    /// Sets the limits of the machine: a motor takes up play at a fraction of its axis' largest
    /// speed.
    fn set_limits(&mut self, _limits: &Limits) {}

    /// Notes that the motors rest, nothing waits, and `issued` steps of each were made: later
    /// entries that were handed on did not happen. Returns the number of compensating steps in each
    /// motor's position.
    fn stand(&mut self, issued: [u64; 4], directions: u8) -> [i64; 3];

    /// Notes that the motors' positions are counted anew, without the compensating steps.
    fn redefined(&mut self) {}

    /// Takes entries; `false` if they may pass unchanged.
    fn take(&mut self, entries: &[StepEntry]) -> bool;

    /// Takes a notice that follows the entries; returns `false` if the notice may pass.
    fn take_notice(&mut self, notice: &Notice) -> bool;

    /// True while something waits for [`Self::work`].
    fn is_waiting(&self) -> bool;

    /// Passes on the next waiting item: writes entries to `out`, which must be empty, or returns
    /// the notice that follows them. `seeks`: the motors move towards a sensor.
    fn work(&mut self, seeks: bool, out: &mut PassedEntries) -> Option<Notice>;
}

/// Placeholder for no play, without memory.
#[derive(Clone, Copy, Debug)]
pub struct NoBacklash;

impl BacklashCorrection for NoBacklash {
    const PRESENT: bool = false;

    fn new(_: &Geometry, _: &Limits) -> Self {
        Self
    }

    fn backlash(&self) -> Backlash {
        Backlash::NONE
    }

    fn set(&mut self, _: &Backlash) {}

    fn stand(&mut self, _: [u64; 4], _: u8) -> [i64; 3] {
        [0; 3]
    }

    fn take(&mut self, _: &[StepEntry]) -> bool {
        false
    }

    fn take_notice(&mut self, _: &Notice) -> bool {
        false
    }

    fn is_waiting(&self) -> bool {
        false
    }

    fn work(&mut self, _: bool, _: &mut PassedEntries) -> Option<Notice> {
        None
    }
}
