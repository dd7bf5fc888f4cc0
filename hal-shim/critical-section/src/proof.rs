//! The proof that a critical section is active.

use core::marker::PhantomData;

/// Proof that a critical section is active.
#[derive(Clone, Copy, Debug)]
pub struct CriticalSection<'cs>(PhantomData<&'cs ()>);

impl<'cs> CriticalSection<'cs> {
    /// Claims that a critical section is active.
    ///
    /// # Safety
    /// A critical section must be active for all of `'cs`.
    #[inline(always)]
    pub const unsafe fn new() -> Self {
        Self(PhantomData)
    }
}
