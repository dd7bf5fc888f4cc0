//! Settings: a printer's profile, its values in a memory, and the bounds of those set by commands.

pub(crate) mod bounds;
pub(crate) mod profile;
pub(crate) mod stored;
