//! The two seams for other methods of motion: a *step pattern* says which motors step in which
//! order along a block, a *time law* how the speed changes along it.
//!
//! The planner itself knows one pattern, step Bresenham, and two laws, the trapezoid and the
//! S-curve; this is all that a printer's image contains ([`Standard`]). The papers' other methods
//! implement these traits in a crate of their own and reach the planner as its type parameter.

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

/// Reason why a choice of methods was refused. The planner continues with the methods that it had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChoiceError {
    /// Moves wait or are being executed.
    InMotion,
    /// The method is not compiled in.
    NotContained,
    /// A parameter of the method is out of range.
    Parameter,
    /// A shaper cannot be made, or not for this machine.
    Shaper(ShaperError),
    /// A number of the extruder's advance is out of range.
    PressureAdvance(PressureAdvanceError),
}

/// A step event of X, Y and Z's motors, and when it is due.
#[derive(Clone, Copy, Debug)]
pub struct DueEvent {
    /// Time units from the block's start.
    pub time: u64,
    /// The motors that step: bits 0 to 2 are X (A), Y (B) and Z.
    pub axes: u8,
    /// Motors of these that run backwards.
    pub backwards: u8,
}

/// Another order of the motors' steps than step Bresenham's.
///
/// A pattern yields the events of the motors that it orders, in order of time. The planner
/// merges them with the extruder's steps, and with Z's where the pattern leaves Z out: those
/// follow the path evenly.
pub trait StepPattern<P>: Copy + Debug {
    /// Equal parts of a block's path of which each has at most one event of the motors.
    fn densest(&self, steps: [i32; 3]) -> u32;

    /// Step events of the motors in a block, those that join others counted too.
    fn events(&self, steps: [i32; 3]) -> u32;

    /// Shortest time in which a block may be made, ticks.
    fn least_ticks(&self, steps: [i32; 3]) -> f32;

    /// Z's steps where the pattern's events leave Z out; else [`StepTimes::NONE`].
    fn z(&self) -> &StepTimes<P>;

    /// Mutable access to them.
    fn z_mut(&mut self) -> &mut StepTimes<P>;

    /// Starts with a block, of which the stretch is all.
    fn start(&mut self, stretch: &Stretch, law: &TimeLaw<P>);

    /// The next event; `None` after the block's last.
    fn next(&self) -> Option<DueEvent>;

    /// Advances to the event after it.
    fn advance(&mut self);
}

/// Another rule for the change of speed than a constant acceleration or jerk.
pub trait SpeedRule: Copy + Debug + PartialEq {
    /// The pieces of a block's law.
    type Pieces: Pieces;

    /// A block's nominal speed, held to what the rule can do.
    fn nominal(&self, block: &Block) -> Speed;

    /// The fastest speed that a block can be left with when it is entered at `speed`, or entered
    /// with to be left at it.
    fn reach(&self, block: &Block, speed: Speed) -> Speed;

    /// The slowest speed, at least `wanted`, that a block can be left with when it is
    /// entered at `speed`.
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

    /// The pattern that was chosen; `None` for step Bresenham.
    ///
    /// # Errors
    /// [`ChoiceError::NotContained`].
    fn pattern(choice: &MotionChoice, kinematics: Kinematics) -> Result<Option<Self::Pattern>, ChoiceError>;

    /// The law that was chosen; `None` for the trapezoid and the S-curve.
    ///
    /// # Errors
    /// [`ChoiceError::NotContained`], [`ChoiceError::Parameter`].
    fn rule(choice: &MotionChoice) -> Result<Option<Self::Rule>, ChoiceError>;
}

/// No other methods: step Bresenham under trapezoids and S-curves. Z follows no bed, or what `B`
/// says; the drives have no play, or it is taken up by `L`.
pub struct Standard<B = NoBed, L = NoBacklash>(PhantomData<fn() -> (B, L)>);

// Derived, they would ask for a bed that can be copied.
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
