//! The square root of f32, correctly rounded on every target.
//!
//! `core` has none that is stable, and `libm`'s is software on a Cortex-M4F, several times the cost
//! of a whole step event. There the processor's own instruction takes its place: VSQRT, 14 cycles.
//! IEEE 754 wants the square root correctly rounded, so both give the same bits.
#![no_std]

mod ramp;
mod root;

pub use ramp::Ramp;
pub use root::square_root;
