//! Supervision of the chip: cause of the last reset, supply voltage, watchdog, last words.

use core::fmt;

use ferrostep_stm32f4::crash_message::CrashMessage;
use ferrostep_stm32f4::{self as chip, BrownOut, ResetCause, UnderDebugger, watchdog};

use crate::board::THERMAL;
use crate::pac::{FLASH, IWDG, RCC};
use crate::volatile::Volatile;

/// Last words of a program that panicked or failed. Neither a reset nor program start fills this
/// memory.
#[unsafe(link_section = ".uninit.last_words")]
static LAST_WORDS: CrashMessage = CrashMessage::new();

/// Returns the cause of the chip's last reset; unknown from the second call on.
pub fn reset_cause(_rcc: &RCC) -> ResetCause {
    // SAFETY: a register of the RCC, which is the caller's.
    ResetCause::take(&mut unsafe { Volatile::new() })
}

/// Makes the chip stay in reset while its supply is too low. Writes to flash the first time.
pub fn set_brown_out_level(_rcc: &RCC, _flash: &FLASH) -> BrownOut {
    // SAFETY: registers of RCC and flash, which are the caller's, and of the power control, which
    // is used here alone.
    chip::set_brown_out_level(&mut unsafe { Volatile::new() })
}

/// The running watchdog.
pub struct Watchdog {
    watchdog: chip::Watchdog,
    registers: Volatile,
}

impl Watchdog {
    /// Starts the watchdog. On a board with heaters it also runs while a debugger has halted the
    /// core.
    pub fn start(_watchdog: IWDG) -> Self {
        // SAFETY: its registers were given up to this; besides, a bit of the debugger's settings
        // that is written here alone.
        let mut registers = unsafe { Volatile::new() };
        let under_debugger = if THERMAL.is_some() { UnderDebugger::Runs } else { UnderDebugger::StandsStill };
        Self { watchdog: chip::Watchdog::start(under_debugger, &mut registers), registers }
    }

    /// Feeds the watchdog.
    pub fn feed(&mut self) {
        self.watchdog.feed(&mut self.registers);
    }
}

/// Feeds the watchdog, if it runs, in the safe state: a reset would end that state.
pub(crate) fn feed_at_the_end() {
    // SAFETY: one store, which is allowed at any time and leaves the watchdog as
    // `Watchdog::feed` would.
    watchdog::feed(&mut unsafe { Volatile::new() });
}

/// Stores a text that survives the next reset.
pub(crate) fn keep_last_words(text: fmt::Arguments<'_>) {
    LAST_WORDS.keep(text);
}

/// Hands over the text kept from before the last reset, once.
pub fn take_last_words(tell: impl FnOnce(&dyn fmt::Display)) {
    if let Some(text) = LAST_WORDS.get() {
        tell(&text);
    }
    LAST_WORDS.clear();
}
