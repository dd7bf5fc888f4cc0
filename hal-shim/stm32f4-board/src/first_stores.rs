//! The image's first stores.

use core::arch::naked_asm;

use crate::board::FIRST;

/// Executes the stores [`FIRST`] before anything else: a heater that a boot loader left floating or
/// on is off within microseconds of its jump here. In assembly, since Rust code needs memory that
/// is not initialised yet.
///
/// # Safety
/// For cortex-m-rt, which calls it before it fills RAM.
#[unsafe(naked)]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn __pre_init() {
    naked_asm!(
        // A boot loader that ran as a task leaves another stack selected, and one that masked
        // interrupts would leave them masked. The earlier stack is not touched: cortex-m-rt has set
        // the main one.
        "movs r0, #0",
        "msr BASEPRI, r0",
        "msr CONTROL, r0",
        "isb",
        "ldr r0, ={first}",
        "ldr r1, ={bytes}",
        "add r1, r1, r0",
        "1:",
        "ldr r2, [r0], #4",
        "ldr r12, [r2]",
        "ldr r3, [r0], #4",
        "bic r12, r12, r3",
        "ldr r3, [r0], #4",
        "orr r12, r12, r3",
        "str r12, [r2]",
        "cmp r0, r1",
        "bne 1b",
        "bx lr",
        first = sym FIRST,
        bytes = const size_of_val(&FIRST),
    )
}
