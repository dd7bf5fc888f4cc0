//! The two extension points for other methods of motion: a *step pattern* determines which motors
//! step in which order along a block, a *time law* the change of speed along it.
//!
//! The planner itself knows one pattern, step Bresenham, and two laws, the trapezoid and the
//! S-curve; a printer's image contains only these ([`Standard`]). The papers' other methods
//! implement these traits in a separate crate and reach the planner as its type parameter.

use core::fmt::{self, Debug};
use core::marker::PhantomData;

use crate::backlash::{BacklashCorrection, NoBacklash};
use crate::block::{Block, PlannedBlock, Speed};
use crate::kinematics::Kinematics;
use crate::motion_choice::{AccelerationProfile, Interpolation, MotionChoice};
use crate::pressure_advance::PressureAdvanceError;
use crate::shaping::ShaperError;
use crate::step_times::StepTimes;
use crate::stretches::Stretch;
use crate::surface::{Bed, NoBed};
use crate::time_law::TimeLaw;

pub use crate::pieces::{Never, OtherLaw, Pieces};

/// Reason why a choice of methods was refused. The planner then keeps its methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChoiceError {
    /// Moves wait or are being executed.
    InMotion,
    /// The method is not compiled in.
    NotContained,
    /// A parameter of the method is out of range.
    Parameter,
    /// A shaper is impossible, or not possible on this machine.
    Shaper(ShaperError),
    /// A number of the extruder's advance is out of range.
    PressureAdvance(PressureAdvanceError),
}

/// Step event of the X, Y and Z motors, and the time at which it is due.
#[derive(Clone, Copy, Debug)]
pub struct DueEvent {
    /// Time units from the block's start.
    pub time: u64,
    /// The motors that step: bits 0 to 2 are X (A), Y (B) and Z.
    pub axes: u8,
    /// Those of the motors that run backwards.
    pub backwards: u8,
}

/// An order of the motors' steps other than step Bresenham's.
///
/// A pattern yields the events of the motors that it orders, in order of time. The planner merges
/// them with the extruder's steps, and with Z's if the pattern leaves Z out: those follow the path
/// evenly.
pub trait StepPattern<P>: Copy + Debug {
    /// Number of equal parts of a block's path of which each has at most one event of the motors.
    fn densest(&self, steps: [i32; 3]) -> u32;

    /// Number of step events of the motors in a block, including those that join others.
    fn events(&self, steps: [i32; 3]) -> u32;

    /// Minimum duration of a block, ticks.
    fn least_ticks(&self, steps: [i32; 3]) -> f32;

    /// Z's steps if the pattern's events leave Z out; otherwise [`StepTimes::NONE`].
    fn z(&self) -> &StepTimes<P>;

    /// Mutable access to Z's steps.
    fn z_mut(&mut self) -> &mut StepTimes<P>;

    /// Starts a block; the stretch is all of it.
    fn start(&mut self, stretch: &Stretch, law: &TimeLaw<P>);

    /// The next event; `None` after the block's last.
    fn next(&self) -> Option<DueEvent>;

    /// Advances to the following event.
    fn advance(&mut self);
}

/// A rule for the change of speed other than constant acceleration or jerk.
pub trait SpeedRule: Copy + Debug + PartialEq {
    /// The pieces of a block's law.
    type Pieces: Pieces;

    /// Nominal speed of a block, limited to what the rule can do.
    fn nominal(&self, block: &Block) -> Speed;

    /// Highest speed with which a block can be left if it is entered at `speed`, or entered if it
    /// is left at it.
    fn reach(&self, block: &Block, speed: Speed) -> Speed;

    /// Lowest speed, at least `wanted`, with which a block can be left if it is entered at `speed`.
    fn slowest(&self, block: &Block, speed: Speed, wanted: Speed) -> Speed;

    /// The law of a planned block.
    fn law(&self, planned: &PlannedBlock) -> OtherLaw<Self::Pieces>;
}

/// The methods that a build contains besides the standard ones.
pub trait MotionMethods: Copy + Debug {
    /// The pieces of the other law.
    type Pieces: Pieces;
    /// The other law.
    type Rule: SpeedRule<Pieces = Self::Pieces>;
    /// The other pattern.
    type Pattern: StepPattern<Self::Pieces>;
    /// Bed following, or [`NoBed`] to compile it out.
    type Bed: Bed;
    /// Backlash compensation, or [`NoBacklash`] to compile it out.
    type Backlash: BacklashCorrection;

    /// The chosen pattern; `None` for step Bresenham.
    ///
    /// # Errors
    /// [`ChoiceError::NotContained`].
    fn pattern(choice: &MotionChoice, kinematics: Kinematics) -> Result<Option<Self::Pattern>, ChoiceError>;

    /// The chosen law; `None` for the trapezoid and the S-curve.
    ///
    /// # Errors
    /// [`ChoiceError::NotContained`], [`ChoiceError::Parameter`].
    fn rule(choice: &MotionChoice) -> Result<Option<Self::Rule>, ChoiceError>;
}

/// No other methods: step Bresenham under trapezoids and S-curves. `B` is the bed following, by
/// default none; `L` is the backlash compensation, by default none.
pub struct Standard<B = NoBed, L = NoBacklash>(PhantomData<fn() -> (B, L)>);

// A derived impl would require `B` and `L` to be `Clone`.
impl<B, L> Clone for Standard<B, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<B, L> Copy for Standard<B, L> {}

impl<B, L> Debug for Standard<B, L> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Standard")
    }
}

impl<B: Bed, L: BacklashCorrection> MotionMethods for Standard<B, L> {
    type Pieces = Never;
    type Rule = Never;
    type Pattern = Never;
    type Bed = B;
    type Backlash = L;

    fn pattern(choice: &MotionChoice, _: Kinematics) -> Result<Option<Never>, ChoiceError> {
        if choice.interpolation == Interpolation::StepBresenham { Ok(None) } else { Err(ChoiceError::NotContained) }
    }

    fn rule(choice: &MotionChoice) -> Result<Option<Never>, ChoiceError> {
        match choice.acceleration {
            AccelerationProfile::Trapezoid | AccelerationProfile::SCurve => Ok(None),
            AccelerationProfile::SCurveTable | AccelerationProfile::SCurveFiveSegments => {
                Err(ChoiceError::NotContained)
            }
        }
    }
}

impl SpeedRule for Never {
    type Pieces = Self;

    fn nominal(&self, _: &Block) -> Speed {
        match *self {}
    }

    fn reach(&self, _: &Block, _: Speed) -> Speed {
        match *self {}
    }

    fn slowest(&self, _: &Block, _: Speed, _: Speed) -> Speed {
        match *self {}
    }

    fn law(&self, _: &PlannedBlock) -> OtherLaw<Self> {
        match *self {}
    }
}

impl StepPattern<Self> for Never {
    fn densest(&self, _: [i32; 3]) -> u32 {
        match *self {}
    }

    fn events(&self, _: [i32; 3]) -> u32 {
        match *self {}
    }

    fn least_ticks(&self, _: [i32; 3]) -> f32 {
        match *self {}
    }

    fn z(&self) -> &StepTimes<Self> {
        match *self {}
    }

    fn z_mut(&mut self) -> &mut StepTimes<Self> {
        match *self {}
    }

    fn start(&mut self, _: &Stretch, _: &TimeLaw<Self>) {
        match *self {}
    }

    fn next(&self) -> Option<DueEvent> {
        match *self {}
    }

    fn advance(&mut self) {
        match *self {}
    }
}
