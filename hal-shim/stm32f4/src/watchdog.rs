//! The independent watchdog: a counter with a separate oscillator that resets the chip
//! unless it is fed.

use ferrostep_register_address::register;

use crate::registers::Registers;

// RM0090, 21.4.
const KR: u32 = register!(IWDG.kr);
const PR: u32 = register!(IWDG.pr);
const RLR: u32 = register!(IWDG.rlr);
const SR: u32 = register!(IWDG.sr);
const START: u32 = 0xcccc;
const UNLOCK: u32 = 0x5555;
const FEED: u32 = 0xaaaa;
/// SR: divider and reload value are on their way to the other clock, five of its periods.
const UPDATING: u32 = 0b11;
/// DBGMCU_APB1_FZ (RM0090, 38.16.4), whose bit pauses the watchdog while a debugger has halted the
/// core. Only power-on resets the register, so an earlier debugger may have set it.
const DEBUG_FREEZE: u32 = register!(DBGMCU.apb1_fz);
const FREEZE_WATCHDOG: u32 = 1 << 12;

/// The oscillator is divided by 64.
const DIVIDER_CODE: u32 = 4;
const DIVIDER: u32 = 64;
const COUNT: u32 = 500;
/// The largest that it counts: 5.5 s and more.
const LONG_COUNT: u32 = 0x1000;

/// Frequency of its oscillator: 17 to 47 kHz, 32 kHz as a rule (DS8626, LSI characteristics).
const FASTEST_HZ: u32 = 47_000;
const SLOWEST_HZ: u32 = 17_000;

/// Shortest time-out, ms.
pub const FASTEST_TIMEOUT_MS: u32 = COUNT * DIVIDER * 1000 / FASTEST_HZ;

/// Longest time-out, ms.
pub const SLOWEST_TIMEOUT_MS: u32 = (COUNT * DIVIDER * 1000).div_ceil(SLOWEST_HZ);

/// Looks at a flag, more than five periods of the slowest oscillator divided by 256 at 168 MHz.
const MAX_LOOKS: u32 = 1_000_000;

/// Behaviour of the watchdog while a debugger has halted the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnderDebugger {
    /// The watchdog resets the chip: on a board with heaters. The timers keep the heaters at their
    /// last power, so a halted core would let a bed heat without limit.
    Runs,
    /// The watchdog is paused as well: on a board without heaters.
    StandsStill,
}

/// The watchdog, which runs: only a reset stops it.
#[derive(Clone, Copy, Debug)]
pub struct Watchdog(());

impl Watchdog {
    /// Starts it with a time-out of a second: 0.68 to 1.88 s, by its oscillator's tolerance.
    pub fn start(under_debugger: UnderDebugger, registers: &mut impl Registers) -> Self {
        let frozen = match under_debugger {
            UnderDebugger::Runs => 0,
            UnderDebugger::StandsStill => FREEZE_WATCHDOG,
        };
        registers.modify(DEBUG_FREEZE, FREEZE_WATCHDOG, frozen);
        registers.write(KR, START);
        registers.write(KR, UNLOCK);
        registers.write(PR, DIVIDER_CODE);
        registers.write(RLR, COUNT - 1);
        // Where it has no such flag, or never clears it, the longer time-out after reset
        // may be in force.
        let _updated = registers.comes_to(SR, UPDATING, false, MAX_LOOKS);
        let watchdog = Self(());
        watchdog.feed(registers);
        watchdog
    }

    /// Restarts the time-out.
    pub fn feed(self, registers: &mut impl Registers) {
        feed(registers);
    }
}

/// Makes the watchdog wait for 5.5 s or more, whether it runs or not: an erasure of flash keeps the
/// processor for up to 2 s.
pub(crate) fn wait_longer(registers: &mut impl Registers) {
    set_count(LONG_COUNT, registers);
}

/// Makes the watchdog wait as long as after [`Watchdog::start`].
pub(crate) fn wait_as_usual(registers: &mut impl Registers) {
    set_count(COUNT, registers);
}

/// Changes how far it counts and restarts it from there.
fn set_count(count: u32, registers: &mut impl Registers) {
    registers.write(KR, UNLOCK);
    registers.write(RLR, count - 1);
    // Fed earlier it would count from the old value.
    let _updated = registers.comes_to(SR, UPDATING, false, MAX_LOOKS);
    feed(registers);
}

/// Feeds it whether it runs or not, for the safe state.
pub fn feed(registers: &mut impl Registers) {
    registers.write(KR, FEED);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    #[test]
    fn it_is_started_unlocked_set_and_fed() {
        let mut registers = Recorder::default().with(DEBUG_FREEZE, 1);
        let watchdog = Watchdog::start(UnderDebugger::StandsStill, &mut registers);
        let set = [
            (0xe004_2008, 1 | 1 << 12),
            (0x4000_3000, 0xcccc),
            (0x4000_3000, 0x5555),
            (0x4000_3004, 4),
            (0x4000_3008, 499),
            (0x4000_3000, 0xaaaa),
        ];
        assert_eq!(registers.stores, set);
        // 500 ticks of 32 kHz / 64.
        let ticks = f64::from(registers.value(RLR) + 1) * f64::from(4_u32 << registers.value(PR));
        assert_eq!(ticks / 32_000.0, 1.0);
        assert_eq!((FASTEST_TIMEOUT_MS, SLOWEST_TIMEOUT_MS), (680, 1883));
        registers.stores.clear();
        watchdog.feed(&mut registers);
        assert_eq!(registers.stores, [(0x4000_3000, 0xaaaa)]);
    }

    /// The watchdog runs even if a debugger froze it before: only power-on resets that register.
    #[test]
    fn with_heaters_a_halted_core_is_reset() {
        let mut registers = Recorder::default().with(DEBUG_FREEZE, u32::MAX);
        Watchdog::start(UnderDebugger::Runs, &mut registers);
        assert_eq!(registers.stores.first(), Some(&(0xe004_2008, !(1 << 12))), "before it is started");
        assert_eq!(registers.stored(DEBUG_FREEZE).len(), 1);
        let mut untouched = Recorder::default();
        Watchdog::start(UnderDebugger::Runs, &mut untouched);
        assert_eq!(untouched.value(DEBUG_FREEZE), 0);
    }

    #[test]
    fn a_flag_that_never_clears_is_not_waited_for_without_end() {
        let mut registers = Recorder::default();
        registers.fix(SR, UPDATING);
        Watchdog::start(UnderDebugger::Runs, &mut registers);
        assert_eq!(registers.stores.last(), Some(&(KR, FEED)));
    }
}
