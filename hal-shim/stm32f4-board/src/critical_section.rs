//! Critical sections that the step interrupt does not notice.
//!
//! Signals, the queue of waits and the log are guarded by [`critical_section::with`]. On a single core PRIMASK is the
//! usual way to make one, and then each of them delays a step; the log does for as long as a whole line takes. This one
//! raises BASEPRI instead, to the highest priority that it can mask. What BASEPRI cannot mask is RTIC's priority 16
//! (hardware priority 0), and that belongs to the step task alone.
//!
//! The price is a rule: **nothing at priority 16 may enter a critical section, nor touch what one guards.** The step
//! task has `local` resources and atomics only. RTIC would guard a `#[shared]` resource of that task with these very
//! sections, so there must be none. `tests/tests/firmware/` holds the built image to it: from the vector of the step
//! timer on no instruction writes BASEPRI_MAX, and nothing is called.

use core::arch::asm;

use critical_section::{Impl, RawRestoreState, set_impl};

/// BASEPRI that masks all priorities but hardware priority 0. The STM32F4 implements the upper four bits of eight
/// (PM0214, 2.3.4), so 1 is written as 0x10; 0 would mask nothing.
const ALL_BUT_HIGHEST: u8 = 1 << 4;

struct AllButStepInterrupt;
set_impl!(AllButStepInterrupt);

// SAFETY: between `acquire` and its `release` no other code runs that enters a critical section or touches what one
// guards. There is one core, and of what could interrupt it:
//
// - Interrupts and exceptions of configurable priority below the highest are masked by BASEPRI. A write to BASEPRI_MAX
//   can only raise the priority: within an RTIC lock or another critical section the stricter of both rules, and
//   `release` puts back what was there before, never less. PRIMASK is left alone, so that sections within `init`
//   and after `safe_state::enter`, where it is set, do not clear it.
// - Hardware priority 0 is the step task's, which does neither (see above). Interrupts that nobody uses have it after
//   reset as well, but are not enabled; should one come nevertheless, it ends in a handler that never returns.
// - Non-maskable interrupt and faults end in handlers that never return.
unsafe impl Impl for AllButStepInterrupt {
    /// Raises BASEPRI; the value it had. `isb` as in RTIC's locks: the section begins after the priority has changed.
    unsafe fn acquire() -> RawRestoreState {
        let before: u32;
        // SAFETY: as above. Without `nomem` the compiler moves no access to memory across it.
        unsafe {
            asm!(
                "mrs {before}, BASEPRI",
                // Next to its use, where the test that reads the image finds it.
                "mov {masked}, #{ALL_BUT_HIGHEST}",
                "msr BASEPRI_MAX, {masked}",
                "isb",
                before = out(reg) before,
                masked = out(reg) _,
                ALL_BUT_HIGHEST = const ALL_BUT_HIGHEST,
                options(nostack, preserves_flags),
            );
        }
        // The register has eight bits.
        before as u8
    }

    /// Restores BASEPRI.
    unsafe fn release(before: RawRestoreState) {
        // SAFETY: as above; `before` comes from the `acquire` that this belongs to.
        unsafe {
            asm!("msr BASEPRI, {before}", before = in(reg) u32::from(before), options(nostack, preserves_flags));
        }
    }
}
