//! Critical sections that do not mask the step interrupt, with the interface of
//! critical-section 1.2.
//!
//! Signals, the queue of waits and the log are guarded by [`with`]. On a single core PRIMASK is
//! the usual way to make a section, and then each of them delays a step; the log does for as long
//! as a whole line takes. These sections raise BASEPRI instead, to the highest priority that it
//! can mask. BASEPRI cannot mask RTIC's priority 16 (hardware priority 0), and that belongs to the
//! step task alone.
//!
//! The price is a rule: **nothing at priority 16 may enter a critical section, nor touch what one
//! guards.** The step task has `local` resources and atomics only. RTIC would guard a `#[shared]`
//! resource of that task with these very sections, so it has none. `tests/outside/tests/firmware/`
//! checks the built image: the code that the step timer's vector leads to never writes BASEPRI_MAX
//! and calls no function.
//!
//! crates.io's crate lets any crate provide the sections, but only one in an image, and
//! stm32f4xx-hal has cortex-m provide them with PRIMASK. Here [`set_impl`] accepts a provider and
//! leaves it unused.
#![no_std]
#![deny(clippy::undocumented_unsafe_blocks)]

mod mutex;
mod proof;
mod sections;

pub use mutex::Mutex;
pub use proof::CriticalSection;

/// The state that a provider restores at the end of a section.
pub type RawRestoreState = u32;

/// The state that [`release`] restores.
#[derive(Clone, Copy, Debug)]
pub struct RestoreState(RawRestoreState);

impl RestoreState {
    /// A state that must not be restored, for memory that is filled later.
    pub const fn invalid() -> Self {
        Self(0)
    }
}

/// A provider of critical sections; unused, see [`set_impl`].
///
/// # Safety
/// As in crates.io's crate: between `acquire` and `release` no other code runs that
/// enters a section.
pub unsafe trait Impl {
    /// Begins a section.
    ///
    /// # Safety
    /// A `release` with the returned value follows, in nested order.
    unsafe fn acquire() -> RawRestoreState;
    /// Ends a section.
    ///
    /// # Safety
    /// `state` is that of the matching `acquire`.
    unsafe fn release(state: RawRestoreState);
}

/// Accepts a provider of critical sections and leaves it unused: the sections of this crate are
/// always BASEPRI's.
#[macro_export]
macro_rules! set_impl {
    ($provider:ty) => {
        const _: () = {
            const fn provides<T: $crate::Impl>() {}
            provides::<$provider>();
        };
    };
}

/// Begins a critical section: raises BASEPRI.
///
/// # Safety
/// A [`release`] with the returned value follows, in nested order.
#[inline(always)]
pub unsafe fn acquire() -> RestoreState {
    RestoreState(sections::raise())
}

/// Ends a critical section: restores BASEPRI.
///
/// # Safety
/// `state` is that of the matching [`acquire`].
#[inline(always)]
pub unsafe fn release(state: RestoreState) {
    // SAFETY: by the contract of this function.
    unsafe { sections::restore(state.0) };
}

/// Runs `f` in a critical section.
#[inline]
pub fn with<R>(f: impl FnOnce(CriticalSection<'_>) -> R) -> R {
    let state = sections::raise();
    // SAFETY: the section lasts until BASEPRI is restored below. A panic in `f` never returns.
    let result = f(unsafe { CriticalSection::new() });
    // SAFETY: restores the value that was raised above.
    unsafe { sections::restore(state) };
    result
}
