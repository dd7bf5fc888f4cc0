//! The virtual mainboard and the images on it: one program, since each takes long to link.

mod command;
mod faults;
mod firmware;
mod mends;
mod snapshot;
