//! The final stop: heaters off, motors off, fans full, then a report of the cause. A core fault or
//! a failed check of the program ends the same way in [`ferrostep_stm32f4_board::fault`].

use core::panic::PanicInfo;

use cortex_m_rt::exception;
use ferrostep_stm32f4_board::safe_state;

/// Panic handler required by the language. An image is built so that nothing calls it: a failed
/// overflow or index check becomes an undefined instruction, a hard fault whose address tells the
/// place. In any other build this handler causes a hard fault.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::asm::udf()
}

// cortex-m-rt requires `unsafe` here because a handler may meet any state; this one reads only its
// argument.
#[allow(unsafe_code)]
mod handlers {
    use super::*;

    /// Number of the non-maskable interrupt, as the core numbers it (PM0214, 2.3.2).
    const NON_MASKABLE: i16 = -14;

    /// Handler of interrupts without a task, and of the interrupt by which the chip reports that
    /// its crystal has stopped.
    #[exception]
    unsafe fn DefaultHandler(interrupt: i16) {
        safe_state::enter();
        if interrupt == NON_MASKABLE && safe_state::crystal_has_stopped() {
            safe_state::tell(format_args!("the crystal has stopped"), format_args!("fault: the crystal has stopped"));
        } else {
            let what = format_args!("unexpected interrupt {interrupt}");
            safe_state::tell(what, what);
        }
        safe_state::rest()
    }
}
