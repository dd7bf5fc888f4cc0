//! A hook for tests, called between any two accesses of the planner task to shared memory.

use std::cell::RefCell;

thread_local! {
    /// The hook of each access of the task to shared memory; taken out while it runs, because the
    /// interrupt's own accesses are not interrupted.
    static INTERRUPT: RefCell<Option<Box<dyn FnMut()>>> = const { RefCell::new(None) };
}

/// An access to shared memory.
pub fn point() {
    let interrupt = INTERRUPT.with(|interrupt| interrupt.borrow_mut().take());
    if let Some(mut interrupt) = interrupt {
        interrupt();
        INTERRUPT.with(|place| *place.borrow_mut() = Some(interrupt));
    }
}

/// Runs `task` with `interrupt` called at each of its accesses.
pub fn interrupted<T>(interrupt: impl FnMut() + 'static, task: impl FnOnce() -> T) -> T {
    INTERRUPT.with(|place| *place.borrow_mut() = Some(Box::new(interrupt)));
    let result = task();
    INTERRUPT.with(|place| *place.borrow_mut() = None);
    result
}
