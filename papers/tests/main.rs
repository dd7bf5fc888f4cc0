//! The papers' methods from outside, as one program: each takes long to link.

mod block_speeds;
mod motion;
mod wide;
