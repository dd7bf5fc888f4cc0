//! The play of a drive is taken up where its motor turns.
//!
//! A nut, a gear or a belt leaves its axis some play: after a reversal the motor turns by that much
//! before the axis follows. The steps that make up for it join the motor's own on their way to the
//! step queue ([`BacklashStage`]), after the ones that follow the bed: no block is split,
//! look-ahead plans as ever, and every step of the plan comes when it would without them.

mod changes;
mod stage;

use core::fmt::Debug;

pub use stage::BacklashStage;

use crate::kinematics::{Geometry, Kinematics};
use crate::limits::Limits;
use crate::passing::PassedEntries;
use crate::step_queue::{Notice, StepEntry};

/// The play of the drives of X, Y and Z, and how it is taken up: Marlin's M425.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backlash {
    /// Play of each axis, mm, 0 to [`Self::MAX_MM`]: how far its motor turns after a reversal
    /// before the axis follows.
    pub play_mm: [f64; 3],
    /// Share of the play that is taken up, 0 to 1.
    pub correction: f64,
    /// The way on which that happens, mm, those of X, Y and Z added, 0 to
    /// [`Self::MAX_SMOOTHING_MM`]; with 0 it is the shortest one.
    pub smoothing_mm: f64,
}

impl Backlash {
    /// No play.
    pub const NONE: Self = Self { play_mm: [0.0; 3], correction: 1.0, smoothing_mm: Self::SMOOTHING_MM };

    /// The largest play of an axis, mm. A machine with more needs repair.
    pub const MAX_MM: f64 = 2.0;

    /// The longest way, mm.
    pub const MAX_SMOOTHING_MM: f64 = 100.0;

    /// Distance over which play is taken up by default, mm. A motor with 0.1 mm of play moves a
    /// tenth faster on it.
    pub const SMOOTHING_MM: f64 = 1.0;

    /// The first axis with play whose motor moves another axis as well, on a machine with
    /// these kinematics: that motor also turns when the other axis reverses, which does not
    /// concern its play.
    pub fn shared_axis(&self, kinematics: Kinematics) -> Option<usize> {
        (0..3).zip(self.play_mm).find(|(axis, mm)| *mm > 0.0 && kinematics.shares_motors(*axis)).map(|(axis, _)| axis)
    }
}

/// Takes up the play between the planner and the step queue: [`BacklashStage`], or [`NoBacklash`]
/// in an image of a machine without play.
pub trait BacklashCorrection: Debug {
    /// True if the image contains the compensation.
    const PRESENT: bool;

    /// Starts with no play on any axis.
    fn new(geometry: &Geometry, limits: &Limits) -> Self;

    /// The play.
    fn backlash(&self) -> Backlash;

    /// Sets the play, at standstill, after a call of [`Self::stand`].
    fn set(&mut self, backlash: &Backlash);

    /// Sets the limits of the machine: a motor takes up play at a part of its axis' largest speed.
    fn set_limits(&mut self, _limits: &Limits) {}

    /// Takes note that the motors rest, nothing waits, and `issued` steps of each were made:
    /// later entries that were handed on did not happen. Returns how many steps of each motor
    /// are for its play.
    fn stand(&mut self, issued: [u64; 4], directions: u8) -> [i64; 3];

    /// Takes note that the motors' positions are counted anew, without those steps.
    fn redefined(&mut self) {}

    /// Takes entries; `false`: they may pass as they are.
    fn take(&mut self, entries: &[StepEntry]) -> bool;

    /// Takes a notice that follows the entries; returns `false` if the notice may pass.
    fn take_notice(&mut self, notice: &Notice) -> bool;

    /// True while something waits for [`Self::work`].
    fn is_waiting(&self) -> bool;

    /// Passes on the next waiting item: writes entries to `out`, which must be empty, or returns
    /// the notice that follows them. `seeks`: the motors move towards a sensor.
    fn work(&mut self, seeks: bool, out: &mut PassedEntries) -> Option<Notice>;
}

/// No play, and no memory for any.
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
