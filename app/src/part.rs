//! Parts of the machine that the profile has, as types.

use ferrostep_printer::{Absent, Part, Present};

/// The part if the machine has it, in an image.
pub type PartIf<const YES: bool> = <Has<YES> as Kind>::Part;

/// Whether it has.
pub struct Has<const YES: bool>;

/// See [`Has`].
pub trait Kind {
    /// That part.
    type Part: Part;
}

impl Kind for Has<true> {
    type Part = Present;
}

impl Kind for Has<false> {
    type Part = Absent;
}
