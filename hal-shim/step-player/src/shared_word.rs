//! Memory shared by the planner task and the step interrupt.
//!
//! Both run on one core, and the task never interrupts the interrupt. So plain loads and stores of
//! whole words (which is what relaxed atomics are on a Cortex-M), kept in order by the compiler,
//! are enough: no barrier instruction. On a host, where tests run the two sides in threads, the
//! processor keeps the order as well.

use core::sync::atomic::{AtomicI32, AtomicU8, AtomicU32, Ordering};

/// Orders all earlier stores before a later one: a reader that sees the later store also sees the
/// earlier ones. Call before publishing.
#[inline(always)]
pub fn publish() {
    #[cfg(target_os = "none")]
    core::sync::atomic::compiler_fence(Ordering::Release);
    #[cfg(not(target_os = "none"))]
    core::sync::atomic::fence(Ordering::Release);
}

/// Orders later loads after that of a published value. Call after reading it.
#[inline(always)]
pub fn acquire() {
    #[cfg(target_os = "none")]
    core::sync::atomic::compiler_fence(Ordering::Acquire);
    #[cfg(not(target_os = "none"))]
    core::sync::atomic::fence(Ordering::Acquire);
}

macro_rules! word {
    ($name:ident, $atomic:ty, $value:ty) => {
        /// A value that either side may load and store whole.
        #[derive(Debug)]
        pub struct $name($atomic);

        impl $name {
            pub const fn new(value: $value) -> Self {
                Self(<$atomic>::new(value))
            }

            #[inline(always)]
            pub fn load(&self) -> $value {
                #[cfg(test)]
                crate::interrupted_access::point();
                self.0.load(Ordering::Relaxed)
            }

            #[inline(always)]
            pub fn store(&self, value: $value) {
                #[cfg(test)]
                crate::interrupted_access::point();
                self.0.store(value, Ordering::Relaxed);
            }
        }
    };
}

word!(WordI32, AtomicI32, i32);
word!(WordU8, AtomicU8, u8);
word!(WordU32, AtomicU32, u32);
