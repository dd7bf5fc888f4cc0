//! Choice of a board's clock: the best one that starts.

use core::fmt;

use ferrostep_planner::TICKS_PER_SECOND;
use fugit::HertzU32 as Hertz;

/// Source of the clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockSource {
    /// The crystal, multiplied by the PLL.
    Crystal,
    /// The internal oscillator (1 % accurate), multiplied by the PLL: the crystal did not start.
    InternalWithPll,
    /// The internal oscillator as it is: the PLL did not lock. All motion is slower.
    Internal,
}

/// The parts of a chip's clock. Every attempt ends in bounded time.
pub trait ClockTree {
    /// Starts the crystal. Returns true if it oscillates.
    fn start_crystal(&mut self) -> bool;
    /// Stops the crystal.
    fn stop_crystal(&mut self);
    /// Runs the chip from the PLL, fed by the crystal or the internal oscillator; if that fails
    /// (`false`) the chip runs from the internal oscillator.
    fn start_pll(&mut self, source: PllSource) -> bool;
    /// Makes the chip watch the crystal from now on, with a non-maskable interrupt when it stops:
    /// otherwise the PLL would drift, and heaters, steps and time would continue at a wrong pace.
    fn watch_crystal(&mut self);
}

/// Source of the PLL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PllSource {
    /// The crystal.
    Crystal,
    /// The internal oscillator.
    Internal,
}

/// Starts the best clock there is: crystal with PLL, else internal oscillator with PLL,
/// else that alone.
pub fn start_best(tree: &mut impl ClockTree) -> ClockSource {
    if tree.start_crystal() && tree.start_pll(PllSource::Crystal) {
        tree.watch_crystal();
        return ClockSource::Crystal;
    }
    tree.stop_crystal();
    if tree.start_pll(PllSource::Internal) { ClockSource::InternalWithPll } else { ClockSource::Internal }
}

/// A clock that runs. Its text is for the host: `HSI 16 MHz, time stretched 5.25 times`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// The clock's source.
    pub source: ClockSource,
    /// Frequency of the core and of its SysTick.
    pub core: Hertz,
    /// Frequency of the slow bus, APB1.
    pub slow_bus: Hertz,
    /// Frequency of the timers on the slow bus, which count the ticks of the motion clock.
    pub slow_timers: Hertz,
    /// Frequency of the fast bus, APB2, which feeds the host's line.
    pub fast_bus: Hertz,
    /// Frequency of the timers on the fast bus.
    pub fast_timers: Hertz,
}

impl Clock {
    /// Length of a tick in hundredths of the nominal one: 100 is exact.
    pub const fn stretch_percent(&self) -> u32 {
        let timers_hz = if self.slow_timers.raw() == 0 { 1 } else { self.slow_timers.raw() };
        (TICKS_PER_SECOND as u64 * 100 / timers_hz as u64) as u32
    }
}

impl fmt::Display for Clock {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match self.source {
            ClockSource::Crystal => "crystal with PLL",
            ClockSource::InternalWithPll => "the crystal did not start, HSI with PLL",
            ClockSource::Internal => "HSI",
        };
        write!(out, "{source} {} MHz", self.core.to_MHz())?;
        match self.stretch_percent() {
            100 => Ok(()),
            percent => write!(out, ", time stretched {}.{:02} times", percent / 100, percent % 100),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chip whose crystal and PLL may fail.
    #[derive(Default)]
    struct Chip {
        crystal_works: bool,
        pll_works_with: &'static [PllSource],
        crystal_runs: bool,
        attempts: Vec<PllSource>,
        is_watched: bool,
    }

    impl ClockTree for Chip {
        fn start_crystal(&mut self) -> bool {
            self.crystal_runs = true;
            self.crystal_works
        }
        fn stop_crystal(&mut self) {
            self.crystal_runs = false;
        }
        fn start_pll(&mut self, source: PllSource) -> bool {
            self.attempts.push(source);
            self.pll_works_with.contains(&source)
        }
        fn watch_crystal(&mut self) {
            assert!(self.crystal_runs && self.attempts == [PllSource::Crystal], "before the core runs from it");
            self.is_watched = true;
        }
    }

    #[test]
    fn the_best_clock_that_starts_is_taken() {
        use PllSource::{Crystal, Internal};
        for (crystal_works, pll_works_with, expected, attempts) in [
            (true, &[Crystal, Internal][..], ClockSource::Crystal, &[Crystal][..]),
            (false, &[Crystal, Internal], ClockSource::InternalWithPll, &[Internal]),
            (true, &[Internal], ClockSource::InternalWithPll, &[Crystal, Internal]),
            (false, &[], ClockSource::Internal, &[Internal]),
            (true, &[], ClockSource::Internal, &[Crystal, Internal]),
        ] {
            let mut chip = Chip { crystal_works, pll_works_with, ..Chip::default() };
            assert_eq!(start_best(&mut chip), expected);
            assert_eq!(chip.attempts, attempts);
            assert_eq!(chip.crystal_runs, expected == ClockSource::Crystal);
            assert_eq!(chip.is_watched, expected == ClockSource::Crystal);
        }
    }

    #[test]
    fn the_host_is_told_what_time_is_worth() {
        let clock = |source, core_mhz, slow_timers_mhz| Clock {
            source,
            core: Hertz::MHz(core_mhz),
            slow_bus: Hertz::MHz(slow_timers_mhz / 2),
            slow_timers: Hertz::MHz(slow_timers_mhz),
            fast_bus: Hertz::MHz(84),
            fast_timers: Hertz::MHz(168),
        };
        assert_eq!(clock(ClockSource::Crystal, 168, 84).to_string(), "crystal with PLL 168 MHz");
        let slow = clock(ClockSource::Internal, 16, 16);
        assert_eq!(slow.to_string(), "HSI 16 MHz, time stretched 5.25 times");
    }
}
