//! Parts of the machine that the profile has, as types.

use ferrostep_planner::backlash::{BacklashCorrection, BacklashStage, NoBacklash};
use ferrostep_printer::{Absent, Part, Present};

/// The part if the machine has it, in an image.
pub type PartIf<const YES: bool> = <Has<YES> as Kind>::Part;

/// What takes up the play of the drives, if there is any.
pub type BacklashIf<const YES: bool> = <Has<YES> as Kind>::Backlash;

/// Whether it has.
pub struct Has<const YES: bool>;

/// See [`Has`].
pub trait Kind {
    /// That part.
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
