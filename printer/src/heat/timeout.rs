//! Heaters that have a target and are not used go off: a host that has gone must not leave
//! them on for good.
//!
//! Use is a line from any host, a frame of a prepared job, motion, or a line at work that ends by
//! itself: a dwell (G4), a wait for heat (M109, M190, M191) while the temperature comes nearer to
//! its target ([`Approach`]), an autotune. Otherwise a long heat soak would end with a cold bed,
//! and the print would continue. After such a line comes the next one, or silence.
//!
//! A wait for a person (M0, M25, M600) does not count: it may last any time. When it ends, the
//! print heats up again, and waits, before anything moves. So does a print whose host was silent
//! for too long. A warning comes first.

use core::fmt;

use crate::settings::profile::heaters::DEFAULT_HEATER_TIMEOUT_S;

/// Time from the warning until the heaters go off, seconds; at most half the timeout.
const WARNING_S: u32 = 300;

/// A report on heaters that rest, with the caller's duty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaterRest {
    /// The heaters will go off.
    Warning {
        /// Seconds without use so far.
        rested_s: u32,
        /// Seconds until they go off.
        left_s: u32,
    },
    /// The caller switches them off now.
    Over {
        /// Seconds without use.
        rested_s: u32,
    },
}

impl fmt::Display for HeaterRest {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Warning { rested_s, left_s } => write!(
                out,
                "echo:heaters go off in {left_s} s: {rested_s} s without a line from a host and without motion; any line \
                 (M105) keeps them on, M86 sets the time"
            ),
            Self::Over { rested_s } => write!(
                out,
                "echo:heaters switched off: {rested_s} s without a line from a host and without motion (M86); to go on, set \
                 the temperatures again (M104, M140) and wait for them"
            ),
        }
    }
}

/// Minimum approach of a temperature to its target for its wait to count as use, degrees. A heater
/// that never arrives does not keep heaters on for good.
const MIN_APPROACH_CELSIUS: f32 = 0.5;

/// Progress of a wait for heat towards its target.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Approach {
    nearest_celsius: f32,
}

impl Approach {
    /// A wait that begins.
    pub(crate) const fn new() -> Self {
        Self { nearest_celsius: f32::INFINITY }
    }

    /// Returns true if the wait makes progress, with the temperature this far from its target: it
    /// has arrived, or has come nearer since the last call that returned `true`.
    pub(crate) fn goes_on(&mut self, distance_celsius: f32, has_arrived: bool) -> bool {
        let is_nearer = distance_celsius <= self.nearest_celsius - MIN_APPROACH_CELSIUS;
        if is_nearer {
            self.nearest_celsius = distance_celsius;
        }
        is_nearer || has_arrived
    }
}

/// Watches how long heaters with a target have not been used.
#[derive(Clone, Copy, Debug, Default)]
pub struct HeaterTimeout {
    /// Time when that began, ms.
    since_ms: Option<u32>,
    warned: bool,
}

impl HeaterTimeout {
    /// No heater has a target.
    pub const fn new() -> Self {
        Self { since_ms: None, warned: false }
    }

    /// Watches the heaters; to be called several times a second, with a clock of milliseconds that
    /// may wrap. `is_used`: there was a use since the last call; `has_target`: a heater has a
    /// target; `timeout_s`: 0 is never. Warns before it ends, even if it was not called in between.
    pub fn look(&mut self, now_ms: u32, is_used: bool, has_target: bool, timeout_s: u16) -> Option<HeaterRest> {
        if is_used || !has_target || timeout_s == 0 {
            *self = Self::new();
            return None;
        }
        let timeout_s = u32::from(timeout_s);
        let rested_s = now_ms.wrapping_sub(*self.since_ms.get_or_insert(now_ms)) / 1000;
        let warned = self.warned;
        self.warned |= rested_s >= timeout_s - WARNING_S.min(timeout_s / 2);
        if self.warned && !warned {
            return Some(HeaterRest::Warning { rested_s, left_s: timeout_s.saturating_sub(rested_s) });
        }
        if rested_s < timeout_s {
            return None;
        }
        *self = Self::new();
        Some(HeaterRest::Over { rested_s })
    }
}

const _: () = assert!(WARNING_S < DEFAULT_HEATER_TIMEOUT_S as u32, "the default leaves time before its warning");

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks ten times a second; returns the reports with their times, s.
    fn looks(timeout: &mut HeaterTimeout, from_ms: u32, seconds: u32, timeout_s: u16) -> Vec<(u32, HeaterRest)> {
        let looks = (0..=seconds * 10).map(|look| (look / 10, from_ms.wrapping_add(look * 100)));
        looks.filter_map(|(s, now_ms)| Some((s, timeout.look(now_ms, false, true, timeout_s)?))).collect()
    }

    #[test]
    fn it_warns_and_then_switches_off() {
        let over = |rested_s| (rested_s, HeaterRest::Over { rested_s });
        let warning = |rested_s, left_s| (rested_s, HeaterRest::Warning { rested_s, left_s });
        // With a clock that wraps. Below ten minutes the warning comes at half the time.
        for (timeout_s, warned_s) in [(1800, 1500), (600, 300), (601, 301), (90, 45), (1, 1)] {
            let mut timeout = HeaterTimeout::new();
            let said = looks(&mut timeout, u32::MAX - 50_000, u32::from(timeout_s) + 1, timeout_s);
            let expected = [warning(warned_s, u32::from(timeout_s) - warned_s), over(timeout_s.into())];
            assert_eq!(said, expected, "{timeout_s}");
        }
    }

    #[test]
    fn use_begins_the_time_anew_and_without_targets_there_is_none() {
        for (is_used, has_target, timeout_s) in [(true, true, 1800), (false, false, 1800), (false, true, 0)] {
            let mut timeout = HeaterTimeout::new();
            assert_eq!(looks(&mut timeout, 0, 1799, 1800).len(), 1);
            assert_eq!(timeout.look(1_799_900, is_used, has_target, timeout_s), None);
            assert_eq!(looks(&mut timeout, 1_799_950, 1499, 1800), [], "the warning, too, begins anew");
        }
    }

    #[test]
    fn a_wait_counts_while_it_comes_nearer_or_has_arrived() {
        let mut approach = Approach::new();
        let distances =
            [(100.0, true), (99.6, false), (99.5, true), (120.0, false), (99.1, false), (99.0, true), (1.0, true)];
        for (distance, expected) in distances {
            assert_eq!(approach.goes_on(distance, false), expected, "{distance}");
        }
        assert!(approach.goes_on(1.0, true) && !approach.goes_on(1.0, false));
    }

    #[test]
    fn it_never_switches_off_unannounced() {
        let mut timeout = HeaterTimeout::new();
        assert_eq!(timeout.look(0, false, true, 1800), None);
        let late = timeout.look(7_200_000, false, true, 1800);
        assert_eq!(late, Some(HeaterRest::Warning { rested_s: 7200, left_s: 0 }));
        assert_eq!(timeout.look(7_200_100, false, true, 1800), Some(HeaterRest::Over { rested_s: 7200 }));
    }
}
