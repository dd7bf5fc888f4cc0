//! The signal of a failing supply, while a module still feeds the board.

use crate::job::debounce::Debounce;
use crate::settings::profile::supply::SupplySignal;
use crate::signals::Signals;

/// Text for hosts when the supply has failed and no print from the card is under way.
pub const SUPPLY_FAILS: &str = "echo:power loss: the supply fails";

/// Watches the signal, freed of spikes.
#[derive(Clone, Copy, Debug, Default)]
pub struct SupplyWatch {
    /// True while the supply fails; `None` before the first look.
    is_failing: Option<bool>,
    debounce: Debounce,
}

impl SupplyWatch {
    /// The watch before the signal's first look.
    pub const fn new() -> Self {
        Self { is_failing: None, debounce: Debounce::new() }
    }

    /// Looks at the signal; to be called every few milliseconds with its present state and a clock
    /// of milliseconds that may wrap. Returns true if the supply has just failed; the state at the
    /// first look never counts as a failure, because a wire may be missing.
    pub fn look(&mut self, now_ms: u32, is_failing: bool, signal: &SupplySignal, signals: &Signals) -> bool {
        let before = *self.is_failing.get_or_insert(is_failing);
        signals.set_supply_failing(before);
        if !self.debounce.has_settled(now_ms, is_failing, before, signal.debounce_ms.into()) {
            return false;
        }
        self.is_failing = Some(is_failing);
        signals.set_supply_failing(is_failing);
        if is_failing {
            signals.note_supply_failure();
        }
        is_failing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGNAL: SupplySignal = SupplySignal { failing_is_low: true, debounce_ms: 4, rise_10nm: 0 };

    /// Looks every 2 ms at these levels, beginning just before the clock wraps. Returns at which
    /// looks the supply has failed.
    fn failures(levels: &[bool], signals: &Signals) -> Vec<usize> {
        let mut watch = SupplyWatch::new();
        let at_ms = |index: usize| (u32::MAX - 3).wrapping_add(2 * index as u32);
        let looks = levels.iter().enumerate();
        looks
            .filter(|(index, failing)| watch.look(at_ms(*index), **failing, &SIGNAL, signals))
            .map(|(i, _)| i)
            .collect()
    }

    #[test]
    fn a_failure_counts_once_when_it_has_lasted() {
        let signals = Signals::new();
        let levels = [false, true, true, true, true, true, false, false, false, false, true, true, true];
        assert_eq!(failures(&levels, &signals), [3, 12]);
        assert!(signals.is_supply_failing());
        assert!(signals.take_supply_failure() && !signals.take_supply_failure());
    }

    #[test]
    fn a_spike_does_not_count() {
        let signals = Signals::new();
        assert_eq!(failures(&[false, true, true, false, true, true, false, false], &signals), [0; 0]);
        assert!(!signals.is_supply_failing() && !signals.take_supply_failure());
    }

    #[test]
    fn a_signal_that_fails_from_the_start_is_known_and_halts_nothing() {
        let signals = Signals::new();
        assert_eq!(failures(&[true; 9], &signals), [0; 0]);
        assert!(signals.is_supply_failing() && !signals.take_supply_failure());
    }
}
