//! Cause of the chip's last reset.

use core::fmt;

use ferrostep_register_address::register;

use crate::registers::Registers;

/// RM0090, 7.3.21.
const RCC_CSR: u32 = register!(RCC.csr);
const LOW_POWER: u32 = 1 << 31;
const WINDOW_WATCHDOG: u32 = 1 << 30;
const INDEPENDENT_WATCHDOG: u32 = 1 << 29;
const SOFTWARE: u32 = 1 << 28;
const POWER_ON: u32 = 1 << 27;
const PIN: u32 = 1 << 26;
const BROWN_OUT: u32 = 1 << 25;
/// The bit that clears the flags.
const REMOVE: u32 = 1 << 24;

/// The cause of the chip's reset. Its text is for the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Power-on.
    PowerOn,
    /// The supply was too low for a moment.
    BrownOut,
    /// The reset button, a host's adapter or a debug probe.
    Pin,
    /// The program itself, or a boot loader.
    Software,
    /// [`Watchdog`](super::Watchdog): a task has stopped.
    Watchdog,
    /// The other watchdog, which a boot loader may have used.
    WindowWatchdog,
    /// A low-power mode that the option bytes forbid.
    LowPower,
    /// Unknown: an emulator, or a boot loader has cleared the flags.
    Unknown,
}

impl ResetCause {
    /// Reads the flags and clears them for the next time.
    ///
    /// Several may be set. Every reset sets that of the pin, since it pulls the pin low; power-on
    /// also sets that of a low supply.
    pub fn take(registers: &mut impl Registers) -> Self {
        let flags = registers.read(RCC_CSR);
        registers.write(RCC_CSR, flags | REMOVE);
        let order = [
            (POWER_ON, Self::PowerOn),
            (BROWN_OUT, Self::BrownOut),
            (INDEPENDENT_WATCHDOG, Self::Watchdog),
            (WINDOW_WATCHDOG, Self::WindowWatchdog),
            (LOW_POWER, Self::LowPower),
            (SOFTWARE, Self::Software),
            (PIN, Self::Pin),
        ];
        order.into_iter().find(|(flag, _)| flags & flag != 0).map_or(Self::Unknown, |(_, cause)| cause)
    }
}

impl ResetCause {
    /// Text of the cause.
    pub const fn name(self) -> &'static str {
        match self {
            Self::PowerOn => "power-on",
            Self::BrownOut => "brown-out",
            Self::Pin => "pin",
            Self::Software => "software",
            Self::Watchdog => "watchdog",
            Self::WindowWatchdog => "window watchdog",
            Self::LowPower => "low power",
            Self::Unknown => "unknown",
        }
    }
}

impl fmt::Display for ResetCause {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    #[test]
    fn the_cause_is_what_the_flags_of_the_manual_say() {
        // The oscillator's switch, which is not the flags', stays.
        const LSION: u32 = 1;
        for (flags, cause, text) in [
            (0x0e00_0000, ResetCause::PowerOn, "power-on"),
            (0x0600_0000, ResetCause::BrownOut, "brown-out"),
            (0x0400_0000, ResetCause::Pin, "pin"),
            (0x1400_0000, ResetCause::Software, "software"),
            (0x2400_0000, ResetCause::Watchdog, "watchdog"),
            (0x4400_0000, ResetCause::WindowWatchdog, "window watchdog"),
            (0x8400_0000, ResetCause::LowPower, "low power"),
            (0, ResetCause::Unknown, "unknown"),
        ] {
            let mut registers = Recorder::default().with(0x4002_3874, flags | LSION);
            assert_eq!(ResetCause::take(&mut registers), cause, "{flags:#x}");
            assert_eq!(cause.to_string(), text);
            let cleared = registers.stored(0x4002_3874);
            assert_eq!(cleared.len(), 1);
            assert_eq!((cleared[0] >> 24 & 1, cleared[0] & 1), (1, 1), "{flags:#x}");
        }
    }
}
