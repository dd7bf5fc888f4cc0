//! Z follows a surface: X, Y and the extruder step when they would without it, Z is where an
//! independent f64 surface has it, and within its limits.
#![allow(clippy::unwrap_used, missing_docs)]

mod bent_beds;
mod follows;
mod limits;
mod machine;
mod meshes;
mod reference;
