//! Parts that only some machines have, as types: the code for them is compiled only where they are.

use core::fmt::Debug;
use core::future::{Future, Pending, pending};

/// A part that the machine has or lacks: [`Present`] or [`Absent`].
pub trait Part: Copy + Debug + PartialEq + 'static {
    /// True if it has the part.
    const PRESENT: bool;

    /// A command's future on a machine with the part; on another one a future that never
    /// ends, without the command's code: every future that may be awaited is compiled even
    /// where none begins it.
    type Only<F: Future>: Future<Output = F::Output>;

    /// The future that `begin` makes, on a machine with the part.
    fn only<F: Future>(begin: impl FnOnce() -> F) -> Self::Only<F>;

    /// A value that only a machine with the part has room for.
    type Of<T: Copy + Debug + PartialEq>: Copy + Debug + PartialEq;

    /// Keeps a value, or forgets it.
    fn of<T: Copy + Debug + PartialEq>(value: T) -> Self::Of<T>;

    /// The kept value.
    fn get<T: Copy + Debug + PartialEq>(of: &Self::Of<T>) -> Option<&T>;

    /// The same, to be changed.
    fn get_mut<T: Copy + Debug + PartialEq>(of: &mut Self::Of<T>) -> Option<&mut T>;
}

/// The machine has the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Present;

/// The machine does not have the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Absent;

impl Part for Present {
    const PRESENT: bool = true;
    type Only<F: Future> = F;

    fn only<F: Future>(begin: impl FnOnce() -> F) -> F {
        begin()
    }

    type Of<T: Copy + Debug + PartialEq> = T;

    fn of<T: Copy + Debug + PartialEq>(value: T) -> T {
        value
    }

    fn get<T: Copy + Debug + PartialEq>(of: &T) -> Option<&T> {
        Some(of)
    }

    fn get_mut<T: Copy + Debug + PartialEq>(of: &mut T) -> Option<&mut T> {
        Some(of)
    }
}

impl Part for Absent {
    const PRESENT: bool = false;
    type Only<F: Future> = Pending<F::Output>;

    fn only<F: Future>(_: impl FnOnce() -> F) -> Pending<F::Output> {
        pending()
    }

    type Of<T: Copy + Debug + PartialEq> = ();

    fn of<T: Copy + Debug + PartialEq>(_: T) {}

    fn get<T: Copy + Debug + PartialEq>((): &()) -> Option<&T> {
        None
    }

    fn get_mut<T: Copy + Debug + PartialEq>((): &mut ()) -> Option<&mut T> {
        None
    }
}
