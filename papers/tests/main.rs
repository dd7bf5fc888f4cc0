//! Outside tests of the papers' methods, as one program: each would take long to link.

mod block_speeds;
mod motion;
mod wide;
