//! Settings: a printer's profile, what a memory keeps of it, and the bounds of what commands set.

pub(crate) mod bounds;
pub(crate) mod profile;
pub(crate) mod stored;
