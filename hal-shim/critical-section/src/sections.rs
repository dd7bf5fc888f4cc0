//! Raising and restoring BASEPRI.
//!
//! Between the two no other code runs that enters a critical section or touches guarded data. There
//! is one core, and only these could interrupt it:
//!
//! - Interrupts and exceptions of configurable priority below the highest are masked by BASEPRI. A
//!   write to BASEPRI_MAX can only raise the priority: within an RTIC lock or another critical
//!   section the stricter mask applies, and [`restore`] puts back the former state, never a weaker
//!   one. PRIMASK is left alone, so that sections within `init` and after `safe_state::enter`,
//!   where it is set, do not clear it.
//! - Hardware priority 0 belongs to the step task, which does neither. Unused interrupts also have
//!   it after reset, but are not enabled; if one occurs nevertheless, its handler never returns.
//! - Non-maskable interrupt and faults end in handlers that never return.

#[cfg(target_arch = "arm")]
use core::arch::asm;

/// BASEPRI that masks all priorities but hardware priority 0. The STM32F4 implements the upper four
/// bits of eight (PM0214, 2.3.4), so 1 is written as 0x10; 0 would mask nothing.
#[cfg(target_arch = "arm")]
const ALL_BUT_HIGHEST: u8 = 1 << 4;

/// Raises BASEPRI and returns its previous value. `isb` as in RTIC's locks: the section begins
/// after the priority has changed.
#[cfg(target_arch = "arm")]
#[inline(always)]
pub fn raise() -> u32 {
    let before: u32;
    // SAFETY: a higher BASEPRI breaks no code. Without `nomem` the compiler moves no access to
    // memory across it.
    unsafe {
        asm!(
            "mrs {before}, BASEPRI",
            // Kept next to its use, where the test that reads the image finds it.
            "mov {masked}, #{ALL_BUT_HIGHEST}",
            "msr BASEPRI_MAX, {masked}",
            "isb",
            before = out(reg) before,
            masked = out(reg) _,
            ALL_BUT_HIGHEST = const ALL_BUT_HIGHEST,
            options(nostack, preserves_flags),
        );
    }
    before
}

/// Restores BASEPRI.
///
/// # Safety
/// `before` must come from the matching [`raise`].
#[cfg(target_arch = "arm")]
#[inline(always)]
pub unsafe fn restore(before: u32) {
    // SAFETY: by the contract of this function.
    unsafe {
        asm!("msr BASEPRI, {before}", before = in(reg) before, options(nostack, preserves_flags));
    }
}

/// Placeholder: on a PC this crate is only compiled, and has no critical sections.
#[cfg(not(target_arch = "arm"))]
pub fn raise() -> u32 {
    unimplemented!("critical sections are the Cortex-M's")
}

/// Placeholder: on a PC this crate is only compiled.
///
/// # Safety
/// Any use is safe: the function has no effect.
#[cfg(not(target_arch = "arm"))]
pub unsafe fn restore(_before: u32) {}
