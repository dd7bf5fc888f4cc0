//! Types for the parts of the machine that the profile has.

use ferrostep_planner::backlash::{BacklashCorrection, BacklashStage, NoBacklash};
use ferrostep_printer::{Absent, Part, Present};

/// Type of a part: the part itself if the machine has it, otherwise an empty stand-in.
pub type PartIf<const YES: bool> = <Has<YES> as Kind>::Part;

/// Type of the stage that takes up the play of the drives, on machines that have play.
pub type BacklashIf<const YES: bool> = <Has<YES> as Kind>::Backlash;

/// Type-level choice by a constant: `Has<true>` is a machine with the part.
pub struct Has<const YES: bool>;

/// Types chosen by [`Has`].
pub trait Kind {
    /// Type of the part.
    type Part: Part;
    /// Type of the stage that takes up play.
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
