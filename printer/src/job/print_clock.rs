//! Time of a print, and the totals of all prints together.

use core::fmt;

/// Units of 0.1 nm in 10 mm, the smallest length that M78 shows.
const CENTIMETRE_100PM: i64 = 100_000_000;

/// A time as hosts know it: `1d 2h 3m 4s`, without the parts before the first that is not 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Duration(pub u32);

impl fmt::Display for Duration {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(seconds) = *self;
        let parts =
            [(seconds / 86_400, 'd'), (seconds / 3600 % 24, 'h'), (seconds / 60 % 60, 'm'), (seconds % 60, 's')];
        let first = parts.iter().position(|(count, _)| *count > 0).unwrap_or(3);
        for (index, (count, unit)) in parts.iter().enumerate().skip(first) {
            let blank = if index > first { " " } else { "" };
            write!(out, "{blank}{count}{unit}")?;
        }
        Ok(())
    }
}

/// Totals of a machine's life. They begin anew at a reset, unless a memory keeps them
/// ([`crate::SettingsMemory`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Statistics {
    /// Prints begun.
    pub prints: u32,
    /// Complete prints.
    pub finished: u32,
    /// Time of all prints, pauses left out, s.
    pub printed_s: u32,
    /// Time of the longest print, s.
    pub longest_s: u32,
    /// Filament of all prints, units of 10 mm.
    pub filament_10mm: u32,
    /// Time for which the nozzle's and the bed's heater had a target, s.
    pub heated_s: [u32; 2],
}

impl Statistics {
    /// The numbers, in the order in which a memory has them: new ones come last.
    pub fn numbers_mut(&mut self) -> [&mut u32; 7] {
        let Self { prints, finished, printed_s, longest_s, filament_10mm, heated_s: [nozzle_s, bed_s] } = self;
        [prints, finished, printed_s, longest_s, filament_10mm, nozzle_s, bed_s]
    }
}

/// The state of the print's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum State {
    Stopped,
    Paused,
    /// Since this time, ms.
    Running(u64),
}

/// The clock of the print, and what all prints together took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PrintClock {
    pub(crate) state: State,
    /// Time counted before it began to run, ms.
    before_ms: u64,
    /// All filament when the print began, units of 0.1 nm.
    filament_before_100pm: i64,
    /// Time of the last look at the heaters, ms, and which of them had a target then.
    heat_seen: (u64, [bool; 2]),
    pub statistics: Statistics,
    /// True until the statistics are in the memory.
    pub is_unsaved: bool,
}

impl PrintClock {
    pub const fn new() -> Self {
        Self {
            state: State::Stopped,
            before_ms: 0,
            filament_before_100pm: 0,
            heat_seen: (0, [false; 2]),
            statistics: Statistics {
                prints: 0,
                finished: 0,
                printed_s: 0,
                longest_s: 0,
                filament_10mm: 0,
                heated_s: [0; 2],
            },
            is_unsaved: false,
        }
    }

    /// Time that the print has taken, without pauses, s. That of the last one, if no
    /// print is at work.
    pub(crate) fn elapsed_s(&self, now_ms: u64) -> u32 {
        let running_ms = match self.state {
            State::Running(since_ms) => now_ms.saturating_sub(since_ms),
            State::Stopped | State::Paused => 0,
        };
        u32::try_from(self.before_ms.saturating_add(running_ms) / 1000).unwrap_or(u32::MAX)
    }

    /// Starts or resumes the clock of a print.
    pub(crate) fn start(&mut self, now_ms: u64, filament_100pm: i64) {
        match self.state {
            State::Running(_) => return,
            State::Paused => {}
            State::Stopped => {
                (self.before_ms, self.filament_before_100pm) = (0, filament_100pm);
                self.statistics.prints = self.statistics.prints.saturating_add(1);
                self.is_unsaved = true;
            }
        }
        self.state = State::Running(now_ms);
    }

    pub(crate) fn pause(&mut self, now_ms: u64) {
        if let State::Running(since_ms) = self.state {
            self.before_ms = self.before_ms.saturating_add(now_ms.saturating_sub(since_ms));
            self.state = State::Paused;
        }
    }

    /// The print ends.
    pub(crate) fn stop(&mut self, now_ms: u64, filament_100pm: i64, is_complete: bool) {
        self.pause(now_ms);
        if self.state == State::Stopped {
            return;
        }
        self.state = State::Stopped;
        let (elapsed_s, all) = (self.elapsed_s(now_ms), &mut self.statistics);
        all.finished = all.finished.saturating_add(u32::from(is_complete));
        all.printed_s = all.printed_s.saturating_add(elapsed_s);
        all.longest_s = all.longest_s.max(elapsed_s);
        let used_10mm = filament_100pm.saturating_sub(self.filament_before_100pm) / CENTIMETRE_100PM;
        all.filament_10mm = all.filament_10mm.saturating_add(u32::try_from(used_10mm).unwrap_or(0));
        self.is_unsaved = true;
    }

    /// The heaters that have a target now. One that had a target before as well has had it since.
    pub(crate) fn see_heat(&mut self, now_ms: u64, are_on: [bool; 2]) {
        let (before_ms, were_on) = self.heat_seen;
        let seconds = now_ms.saturating_sub(before_ms) / 1000;
        let passed_s = u32::try_from(seconds).unwrap_or(u32::MAX);
        for ((heated_s, was_on), is_on) in self.statistics.heated_s.iter_mut().zip(were_on).zip(are_on) {
            if was_on && is_on {
                *heated_s = heated_s.saturating_add(passed_s);
                self.is_unsaved |= passed_s > 0;
            }
        }
        // The rest of a second is not lost.
        self.heat_seen = (before_ms.saturating_add(seconds.saturating_mul(1000)), are_on);
        if !were_on.into_iter().any(|was_on| was_on) {
            self.heat_seen.0 = now_ms;
        }
    }
}
