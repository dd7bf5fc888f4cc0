//! Parts of the machine that the profile has, as types.

use ferrostep_planner::backlash::{BacklashCorrection, BacklashStage, NoBacklash};
use ferrostep_printer::{Absent, Part, Present};

/// The part if the machine has it, in an image.
pub type PartIf<const YES: bool> = <Has<YES> as Kind>::Part;

/// Stage that takes up the play of the drives, on a machine that has play.
pub type BacklashIf<const YES: bool> = <Has<YES> as Kind>::Backlash;

/// Selects a part by a constant: `Has<true>` is a machine that has it.
pub struct Has<const YES: bool>;

/// See [`Has`].
pub trait Kind {
    /// The part itself.
    type Part: Part;
    /// The part that takes up play.
    type Backlash: BacklashCorrection;
}

impl Kind for Has<true> {
    type Part = Present;
    type Backlash = BacklashStage;
}

impl Kind for Has<false> {
    type Part = Absent;
    type Backlash = NoBacklash;
}
