//! The end: heaters off, motors off, fans full, then a word about why. A fault of the core and a
//! check of the program that fails end the same way in [`ferrostep_stm32f4_board::fault`].

use core::panic::PanicInfo;

use cortex_m_rt::exception;
use ferrostep_stm32f4_board::safe_state;

/// The language asks for it. An image is built so that nothing calls it: what fails an overflow's
/// or an index's check becomes an undefined instruction, a hard fault whose address tells
/// the place. Built in another way, it is a hard fault here.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::asm::udf()
}

// cortex-m-rt asks for `unsafe` here because a handler may meet any state; this one reads nothing
// but its argument.
#[allow(unsafe_code)]
mod handlers {
    use super::*;

    /// The interrupt that cannot be masked, as the core numbers it (PM0214, 2.3.2).
    const NON_MASKABLE: i16 = -14;

    /// An interrupt that no task handles, and the one by which the chip reports that its
    /// crystal has stopped.
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
