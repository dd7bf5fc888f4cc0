//! The hard fault: a failed check of the program, a stack overflow, a bus error, corrupted memory.

use core::arch::naked_asm;
use core::fmt;

use cortex_m::peripheral::SCB;

use crate::board::RAM;
use crate::safe_state;

/// Offset of the program counter in the eight words that the core pushes, bytes.
const PROGRAM_COUNTER: u32 = 24;

/// UNDEFINSTR of the configurable fault status register: the core met an instruction that it does
/// not know (PM0214, 4.4.10).
const UNDEFINED_INSTRUCTION: u32 = 1 << 16;

/// Entry of the exception. After a stack overflow the stack pointer is below RAM, and the first
/// push of an ordinary handler would lock up the core with the heaters on; so this one first sets
/// the stack pointer back to the start of the stack.
///
/// # Safety
/// For the vector table only.
#[unsafe(naked)]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn HardFault() -> ! {
    naked_asm!("mov r0, sp", "ldr r1, =_stack_start", "mov sp, r1", "b {handler}", handler = sym handle)
}

/// Switches heaters and motors off, reports to the host, and rests until the board is reset.
extern "C" fn handle(frame: u32) -> ! {
    safe_state::enter();
    let at = frame.wrapping_add(PROGRAM_COUNTER);
    // Read only within RAM: elsewhere there is no frame.
    if frame.is_multiple_of(4) && RAM.contains(&frame) && RAM.contains(&(at + 3)) {
        // SAFETY: an aligned word of RAM that is not written any more.
        let address = unsafe { core::ptr::read_volatile(at as *const u32) };
        // SAFETY: a register is only read.
        let status = unsafe { &*SCB::PTR }.cfsr.read();
        // An image has one such instruction, for a check that fails: an overflow, an
        // index out of range.
        let what = if status & UNDEFINED_INSTRUCTION == 0 { "fault" } else { "panic" };
        tell(format_args!("{what} at {address:#010x}"));
    } else {
        tell(format_args!("fault, stack overflow"));
    }
    safe_state::rest()
}

/// Reports to the host, and keeps the text across the reset.
fn tell(what: fmt::Arguments<'_>) {
    safe_state::tell(format_args!("firmware {what}"), what);
}
