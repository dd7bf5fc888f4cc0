//! The end: heaters off, motors off, fans full, then a word about why. Faults of the core end the same way in
//! [`ferrostep_stm32f4_board::fault`].

use core::fmt::Write;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m_rt::exception;
use ferrostep_stm32f4_board::safe_state::{self, LastWords};

/// Whether the log has the reason, or was about to get it.
static IS_LOGGED: AtomicBool = AtomicBool::new(false);

/// Tells the log, once: if the end came in the midst of one of its lines, the log panics, and that ends here again.
fn log(tell: impl FnOnce()) {
    if !IS_LOGGED.swap(true, Ordering::Relaxed) {
        tell();
    }
}

/// A programming error, an overflow included.
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    safe_state::enter();
    safe_state::tell(format_args!("firmware panic"), format_args!("panic: {info}"));
    let _ = writeln!(LastWords, "echo:{info}");
    log(|| defmt::error!("{}", defmt::Display2Format(info)));
    safe_state::rest()
}

// cortex-m-rt asks for `unsafe` here because a handler may meet any state; this one reads nothing but its argument.
#[allow(unsafe_code)]
mod handlers {
    use super::*;

    /// The interrupt that cannot be masked, as the core numbers it (PM0214, 2.3.2).
    const NON_MASKABLE: i16 = -14;

    /// An interrupt that no task handles, and the one by which the chip reports that its crystal has stopped.
    #[exception]
    unsafe fn DefaultHandler(interrupt: i16) {
        safe_state::enter();
        if interrupt == NON_MASKABLE && safe_state::crystal_has_stopped() {
            safe_state::tell(format_args!("the crystal has stopped"), format_args!("fault: the crystal has stopped"));
            log(|| defmt::error!("the crystal has stopped"));
            safe_state::rest()
        }
        let what = format_args!("unexpected interrupt {interrupt}");
        safe_state::tell(what, what);
        log(|| defmt::error!("unexpected interrupt {}", interrupt));
        safe_state::rest()
    }
}
