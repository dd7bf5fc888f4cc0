//! Time laws of other kinds as values that yield pieces.

use core::fmt::Debug;

use crate::piece::Piece;

/// Iterator over the pieces of a block's time law, in order.
pub trait Pieces: Iterator<Item = Piece<f64>> + Copy + Debug {}

impl<T: Iterator<Item = Piece<f64>> + Copy + Debug> Pieces for T {}

/// s(t) of a block under another law.
#[derive(Clone, Copy, Debug)]
pub struct OtherLaw<P> {
    /// The pieces, from the first.
    pub pieces: P,
    /// The block's length, 10 nm.
    pub length: f64,
    /// The block's duration in whole ticks, the nearest.
    pub duration_ticks: u64,
}

/// A method that does not exist. It has no value, so the compiler leaves out all that
/// would act on one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Never {}

impl Iterator for Never {
    type Item = Piece<f64>;

    fn next(&mut self) -> Option<Piece<f64>> {
        match *self {}
    }
}
