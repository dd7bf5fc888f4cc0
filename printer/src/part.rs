//! Parts that only some machines have, as types: the code for them is compiled only where they are.

use core::future::{Future, Pending, pending};

/// Whether the machine has a part: [`Present`] or [`Absent`].
pub trait Part {
    /// Whether it has.
    const PRESENT: bool;

    /// A command's future on a machine with the part, and on another one that never ends, and contains no code of it: what a future
    /// may be waiting for is compiled even where nothing begins it.
    type Only<F: Future>: Future<Output = F::Output>;

    /// The future that `begin` makes, on a machine with the part.
    fn only<F: Future>(begin: impl FnOnce() -> F) -> Self::Only<F>;
}

/// The machine has the part.
#[derive(Clone, Copy, Debug)]
pub struct Present;

/// The machine does not have the part.
#[derive(Clone, Copy, Debug)]
pub struct Absent;

impl Part for Present {
    const PRESENT: bool = true;
    type Only<F: Future> = F;

    fn only<F: Future>(begin: impl FnOnce() -> F) -> F {
        begin()
    }
}

impl Part for Absent {
    const PRESENT: bool = false;
    type Only<F: Future> = Pending<F::Output>;

    fn only<F: Future>(_: impl FnOnce() -> F) -> Pending<F::Output> {
        pending()
    }
}
