//! The hard fault: a stack that overflowed, a bus error, memory run wild.

use core::arch::naked_asm;
use core::fmt;

use crate::board::RAM;
use crate::safe_state;

/// Where the program counter stands in the eight words that the core pushes.
const PROGRAM_COUNTER: u32 = 24;

/// The exception's entry. After a stack overflow the stack pointer is below RAM, and the first push of an ordinary
/// handler would lock the core up, heaters on: so this one begins with a stack of its own, the same one anew.
///
/// # Safety
/// For the vector table only.
#[unsafe(naked)]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn HardFault() -> ! {
    naked_asm!("mov r0, sp", "ldr r1, =_stack_start", "mov sp, r1", "b {handler}", handler = sym handle)
}

/// Heaters off, motors off, a line to the host; then rest until someone resets the board.
extern "C" fn handle(frame: u32) -> ! {
    safe_state::enter();
    let at = frame.wrapping_add(PROGRAM_COUNTER);
    // In RAM, that is: elsewhere there is no frame.
    if frame.is_multiple_of(4) && RAM.contains(&frame) && RAM.contains(&(at + 3)) {
        // SAFETY: an aligned word of RAM that is not written any more.
        let address = unsafe { core::ptr::read_volatile(at as *const u32) };
        tell(format_args!("fault at {address:#010x}"));
    } else {
        tell(format_args!("fault, stack overflow"));
    }
    safe_state::rest()
}

/// To the host, and for after the reset.
fn tell(what: fmt::Arguments<'_>) {
    safe_state::tell(format_args!("firmware {what}"), what);
}
