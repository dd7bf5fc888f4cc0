//! Which clock a board runs on: the best one that starts.

use core::fmt;

use ferrostep_planner::TICKS_PER_SECOND;

/// Where the clock comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockSource {
    /// The crystal, multiplied by the PLL.
    Crystal,
    /// The internal oscillator (1 % accurate), multiplied by the PLL: the crystal did not start.
    InternalWithPll,
    /// The internal oscillator as it is: the PLL did not lock. All motion is slower.
    Internal,
}

/// What a chip's clock is made of. Every attempt ends in bounded time.
pub trait ClockTree {
    /// Starts the crystal; whether it oscillates.
    fn start_crystal(&mut self) -> bool;
    /// Stops the crystal.
    fn stop_crystal(&mut self);
    /// Runs the chip from the PLL, fed by the crystal or the internal oscillator; if that fails (`false`) the chip runs
    /// from the internal oscillator.
    fn start_pll(&mut self, source: PllSource) -> bool;
    /// From now on the chip looks after the crystal, and calls an interrupt that cannot be masked when it stops: without
    /// that the PLL drifts, and heaters, steps and time go on at a wrong pace.
    fn watch_crystal(&mut self);
}

/// What feeds the PLL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PllSource {
    /// The crystal.
    Crystal,
    /// The internal oscillator.
    Internal,
}

/// Starts the best clock there is: crystal with PLL, else internal oscillator with PLL, else that alone.
pub fn start_best(tree: &mut impl ClockTree) -> ClockSource {
    if tree.start_crystal() && tree.start_pll(PllSource::Crystal) {
        tree.watch_crystal();
        return ClockSource::Crystal;
    }
    tree.stop_crystal();
    if tree.start_pll(PllSource::Internal) { ClockSource::InternalWithPll } else { ClockSource::Internal }
}

/// A clock that runs. As text it is what the host is told, `HSI 16 MHz, time stretched 5.25 times`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// Where it comes from.
    pub source: ClockSource,
    /// Frequency of the core and of its SysTick, Hz.
    pub core_hz: u32,
    /// Frequency of the timers that count the ticks of the motion clock, Hz.
    pub timer_hz: u32,
    /// Frequency of the serial port's bus, Hz.
    pub serial_hz: u32,
}

impl Clock {
    /// Frequency of the slow bus, APB1, Hz: half that of its timers where it is divided (RM0090 7.2).
    pub const fn slow_bus_hz(&self) -> u32 {
        match self.source {
            ClockSource::Internal => self.timer_hz,
            ClockSource::Crystal | ClockSource::InternalWithPll => self.timer_hz / 2,
        }
    }

    /// By how much time is stretched against the nominal time base, in hundredths: 100 is not at all.
    pub const fn stretch_percent(&self) -> u32 {
        let timer_hz = if self.timer_hz == 0 { 1 } else { self.timer_hz };
        (TICKS_PER_SECOND as u64 * 100 / timer_hz as u64) as u32
    }
}

impl fmt::Display for Clock {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match self.source {
            ClockSource::Crystal => "crystal with PLL",
            ClockSource::InternalWithPll => "the crystal did not start, HSI with PLL",
            ClockSource::Internal => "HSI",
        };
        write!(out, "{source} {} MHz", self.core_hz / 1_000_000)?;
        match self.stretch_percent() {
            100 => Ok(()),
            percent => write!(out, ", time stretched {}.{:02} times", percent / 100, percent % 100),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chip of which some parts work.
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
        let full =
            Clock { source: ClockSource::Crystal, core_hz: 168_000_000, timer_hz: 84_000_000, serial_hz: 84_000_000 };
        assert_eq!(full.to_string(), "crystal with PLL 168 MHz");
        let slow =
            Clock { source: ClockSource::Internal, core_hz: 16_000_000, timer_hz: 16_000_000, serial_hz: 16_000_000 };
        assert_eq!(slow.to_string(), "HSI 16 MHz, time stretched 5.25 times");
    }
}
