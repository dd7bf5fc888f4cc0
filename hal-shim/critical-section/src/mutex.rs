//! Data accessible only within critical sections.

use core::cell::{Ref, RefCell, RefMut, UnsafeCell};

use crate::proof::CriticalSection;

/// Data accessible only within critical sections.
#[derive(Debug)]
pub struct Mutex<T>(UnsafeCell<T>);

// SAFETY: access to the data requires proof of an active critical section, and no code that could
// hold another proof can interrupt that section.
unsafe impl<T: Send> Sync for Mutex<T> {}

impl<T> Mutex<T> {
    /// Guards a value.
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// Borrows the value without a critical section, through the exclusive reference to the mutex.
    pub fn get_mut(&mut self) -> &mut T {
        self.0.get_mut()
    }

    /// Unwraps the value.
    pub fn into_inner(self) -> T {
        self.0.into_inner()
    }

    /// Borrows the value for the duration of the critical section.
    pub fn borrow<'cs>(&'cs self, _section: CriticalSection<'cs>) -> &'cs T {
        // SAFETY: only shared references are handed out, in critical sections, which do not
        // interrupt each other.
        unsafe { &*self.0.get() }
    }
}

impl<T> Mutex<RefCell<T>> {
    /// Replaces the value and returns the old one.
    #[track_caller]
    pub fn replace<'cs>(&'cs self, section: CriticalSection<'cs>, value: T) -> T {
        self.borrow(section).replace(value)
    }

    /// Replaces the value with one computed from it, and returns the old value.
    #[track_caller]
    pub fn replace_with<'cs>(&'cs self, section: CriticalSection<'cs>, f: impl FnOnce(&mut T) -> T) -> T {
        self.borrow(section).replace_with(f)
    }

    /// Borrows the value immutably.
    #[track_caller]
    pub fn borrow_ref<'cs>(&'cs self, section: CriticalSection<'cs>) -> Ref<'cs, T> {
        self.borrow(section).borrow()
    }

    /// Borrows the value mutably.
    #[track_caller]
    pub fn borrow_ref_mut<'cs>(&'cs self, section: CriticalSection<'cs>) -> RefMut<'cs, T> {
        self.borrow(section).borrow_mut()
    }
}

impl<T: Default> Mutex<RefCell<T>> {
    /// Takes the value and leaves the default instead.
    #[track_caller]
    pub fn take<'cs>(&'cs self, section: CriticalSection<'cs>) -> T {
        self.borrow(section).take()
    }
}
