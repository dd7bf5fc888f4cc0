//! Data that is reached in critical sections only.

use core::cell::{Ref, RefCell, RefMut, UnsafeCell};

use crate::proof::CriticalSection;

/// Data that is reached in critical sections only.
#[derive(Debug)]
pub struct Mutex<T>(UnsafeCell<T>);

// SAFETY: the data is reached with a proof that a critical section is active, which no other code
// interrupts that could have another proof.
unsafe impl<T: Send> Sync for Mutex<T> {}

impl<T> Mutex<T> {
    /// Guards a value.
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// The value; the mutex is borrowed here alone.
    pub fn get_mut(&mut self) -> &mut T {
        self.0.get_mut()
    }

    /// The value, without its guard.
    pub fn into_inner(self) -> T {
        self.0.into_inner()
    }

    /// The value, for as long as the critical section lasts.
    pub fn borrow<'cs>(&'cs self, _section: CriticalSection<'cs>) -> &'cs T {
        // SAFETY: only shared references are handed out, in critical sections, which do not
        // interrupt each other.
        unsafe { &*self.0.get() }
    }
}

impl<T> Mutex<RefCell<T>> {
    /// Replaces the value and returns the one before.
    #[track_caller]
    pub fn replace<'cs>(&'cs self, section: CriticalSection<'cs>, value: T) -> T {
        self.borrow(section).replace(value)
    }

    /// Replaces the value by one made from it, and returns the one before.
    #[track_caller]
    pub fn replace_with<'cs>(&'cs self, section: CriticalSection<'cs>, f: impl FnOnce(&mut T) -> T) -> T {
        self.borrow(section).replace_with(f)
    }

    /// Borrows the value.
    #[track_caller]
    pub fn borrow_ref<'cs>(&'cs self, section: CriticalSection<'cs>) -> Ref<'cs, T> {
        self.borrow(section).borrow()
    }

    /// Borrows the value to change it.
    #[track_caller]
    pub fn borrow_ref_mut<'cs>(&'cs self, section: CriticalSection<'cs>) -> RefMut<'cs, T> {
        self.borrow(section).borrow_mut()
    }
}

impl<T: Default> Mutex<RefCell<T>> {
    /// Takes the value and leaves its default.
    #[track_caller]
    pub fn take<'cs>(&'cs self, section: CriticalSection<'cs>) -> T {
        self.borrow(section).take()
    }
}
