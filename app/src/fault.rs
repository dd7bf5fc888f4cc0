//! The end: heaters off, motors off, then a word about why.

use core::panic::PanicInfo;

use cortex_m_rt::{ExceptionFrame, exception};
use ferrostep_stm32f4::safe_state;

/// A programming error, an overflow included.
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    safe_state::enter();
    safe_state::say("\nError:firmware panic, printer halted. kill() called!\n");
    defmt::error!("panic: {}", defmt::Display2Format(info));
    rest()
}

// cortex-m-rt asks for `unsafe` here because a handler may meet any state; this one reads nothing but its argument.
#[allow(unsafe_code)]
mod handlers {
    use super::*;

    /// A stack overflow ends here too: the stack's lower end is the end of RAM.
    #[exception]
    unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
        safe_state::enter();
        safe_state::say("\nError:firmware fault, printer halted. kill() called!\n");
        defmt::error!("hard fault at {=u32:#x}", frame.pc());
        rest()
    }

    /// An interrupt that nobody has asked for.
    #[exception]
    unsafe fn DefaultHandler(interrupt: i16) {
        safe_state::enter();
        safe_state::say("\nError:unexpected interrupt, printer halted. kill() called!\n");
        defmt::error!("unexpected interrupt {}", interrupt);
        rest()
    }
}

/// Until someone resets the board: a machine that starts again on its own might start heating.
fn rest() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}
