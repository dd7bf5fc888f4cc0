//! Paces virtual time by the wall clock.

use std::fmt;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// Longest stop of time for a host that has its `ok`, at any speed above real time. A host that
/// prints answers within milliseconds; one that takes longer than this has stopped sending.
pub const HOST_TURN: Duration = Duration::from_millis(1000);

/// Maximum delay that is caught up. A larger one stays: a host would see a printer that races.
const CATCH_UP: Duration = Duration::from_millis(100);

/// Minimum portion of time granted, ns: smaller ones would cost too much.
const PORTION_NS: f64 = 1e6;

/// Portion granted if time may pass without limit, ns.
const LEAP_NS: u64 = 1_000_000_000;

/// Longest wait for the host before the pace is looked at again.
const MAX_WAIT: Duration = Duration::from_millis(20);

/// Speed of virtual time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// Number of virtual seconds in a second.
    Times(f64),
    /// The maximum that this computer reaches while the printer has something to do;
    /// otherwise real time.
    Max,
}

impl FromStr for Speed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::Max);
        }
        let factor = text.parse().ok().filter(|factor: &f64| factor.is_finite() && *factor > 0.0);
        factor.map(Self::Times).ok_or_else(|| "write a number above 0, or max; 1 is real time".to_owned())
    }
}

impl fmt::Display for Speed {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Times(factor) => write!(out, "{factor}"),
            Self::Max => out.write_str("max"),
        }
    }
}

/// The printer's activity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Doing {
    /// A command is being executed.
    pub command: bool,
    /// The command waits for a person.
    pub waits_for_person: bool,
    /// Motion is planned or under way.
    pub motion: bool,
}

/// Next permission for virtual time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Virtual time that may pass, ns.
    Pass(u64),
    /// No time may pass; this long at most until that changes.
    Wait(Duration),
}

/// Decides how much virtual time may pass.
///
/// A board whose host answers after a millisecond loses a millisecond. At twenty times the speed it
/// would lose twenty, and whether steps run out would depend on the host's computer. Therefore,
/// above real time, virtual time stands still while it is the host's turn: it has been answered,
/// and its next line has not come yet.
#[derive(Debug)]
pub struct Pace {
    speed: Speed,
    looked: Instant,
    looked_ns: u64,
    /// Virtual time that is due, ns.
    due_ns: f64,
    host_turn_since: Option<Instant>,
}

impl Pace {
    /// Starts now.
    pub fn new(speed: Speed, now: Instant) -> Self {
        Self { speed, looked: now, looked_ns: 0, due_ns: 0.0, host_turn_since: None }
    }

    /// The host has sent something.
    pub fn hear(&mut self) {
        // The host has its turn again if a line is not complete.
        self.host_turn_since = None;
    }

    /// Returns how much time may pass at a moment, when virtual time is `now_ns`.
    pub fn look(&mut self, now: Instant, now_ns: u64, doing: Doing) -> Next {
        let passed = now.saturating_duration_since(self.looked);
        self.due_ns = (self.due_ns - now_ns.saturating_sub(self.looked_ns) as f64).max(0.0);
        (self.looked, self.looked_ns) = (now, now_ns);
        if doing.command {
            self.host_turn_since = None;
        } else {
            let since = *self.host_turn_since.get_or_insert(now);
            let left = HOST_TURN.saturating_sub(now.saturating_duration_since(since));
            if !left.is_zero() && self.stands_still_for_host() {
                self.due_ns = 0.0;
                return Next::Wait(left.min(MAX_WAIT));
            }
        }
        let factor = match self.speed {
            Speed::Max if (doing.command || doing.motion) && !doing.waits_for_person => return Next::Pass(LEAP_NS),
            Speed::Max => 1.0,
            Speed::Times(factor) => factor,
        };
        let a_second_ns = factor * 1e9;
        self.due_ns = (self.due_ns + passed.as_secs_f64() * a_second_ns).min(CATCH_UP.as_secs_f64() * a_second_ns);
        if self.due_ns >= PORTION_NS {
            return Next::Pass(self.due_ns as u64);
        }
        Next::Wait(Duration::from_secs_f64((PORTION_NS - self.due_ns) / a_second_ns).min(MAX_WAIT))
    }

    fn stands_still_for_host(&self) -> bool {
        match self.speed {
            Speed::Times(factor) => factor > 1.0,
            Speed::Max => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);
    const IDLE: Doing = Doing { command: false, waits_for_person: false, motion: false };
    const WORK: Doing = Doing { command: true, ..IDLE };

    /// The virtual time that passes in this many milliseconds, ns.
    fn passes(pace: &mut Pace, from: Instant, milliseconds: u32, mut now_ns: u64, doing: Doing) -> u64 {
        let start_ns = now_ns;
        for ms in 1..=milliseconds {
            if let Next::Pass(ns) = pace.look(from + MS * ms, now_ns, doing) {
                now_ns += ns.min(2_000_000);
            }
        }
        now_ns - start_ns
    }

    #[test]
    fn real_time_passes_whatever_the_host_does() {
        for doing in [IDLE, WORK] {
            let start = Instant::now();
            let mut pace = Pace::new(Speed::Times(1.0), start);
            let passed = passes(&mut pace, start, 1000, 0, doing);
            assert!((998_000_000..=1_000_000_000).contains(&passed), "{passed}");
        }
        let start = Instant::now();
        let mut slow = Pace::new(Speed::Times(0.25), start);
        assert_eq!(passes(&mut slow, start, 1000, 0, IDLE) / 1_000_000, 250);
    }

    #[test]
    fn above_real_time_it_stands_still_for_the_host_but_not_for_ever() {
        for (speed, later_s) in [(Speed::Times(2.0), 2.0), (Speed::Max, 1.0)] {
            let start = Instant::now();
            let mut pace = Pace::new(speed, start);
            assert_eq!(passes(&mut pace, start, 999, 0, IDLE), 0, "{speed:?}");
            let later_ns = passes(&mut pace, start + MS * 1001, 1000, 0, IDLE);
            assert!((later_ns as f64 / 1e9 - later_s).abs() < 0.01, "{speed:?}: {later_ns}");
            // A line, and its answer: the host's turn again.
            pace.hear();
            let start = start + MS * 2500;
            assert_eq!(passes(&mut pace, start, 999, later_ns, IDLE), 0, "{speed:?}");
        }
    }

    #[test]
    fn a_command_has_the_time_it_needs() {
        let start = Instant::now();
        let mut pace = Pace::new(Speed::Times(2.0), start);
        let passed = passes(&mut pace, start, 100, 0, WORK);
        assert!((198_000_000..=200_000_000).contains(&passed), "{passed}");
        let mut max = Pace::new(Speed::Max, start);
        assert_eq!(max.look(start, 0, WORK), Next::Pass(LEAP_NS));
        // A person's minute is a minute.
        let person = Doing { waits_for_person: true, ..WORK };
        let mut max = Pace::new(Speed::Max, start);
        assert_eq!(passes(&mut max, start, 1000, 0, person) / 10_000_000, 100);
    }

    #[test]
    fn a_computer_that_was_away_does_not_race() {
        let start = Instant::now();
        let mut pace = Pace::new(Speed::Times(1.0), start);
        assert_eq!(pace.look(start + Duration::from_secs(60), 0, WORK), Next::Pass(100_000_000));
    }

    #[test]
    fn speeds_are_read() {
        assert_eq!("max".parse(), Ok(Speed::Max));
        assert_eq!("2.5".parse(), Ok(Speed::Times(2.5)));
        for text in ["0", "-1", "inf", "nan", "", "fast"] {
            assert!(text.parse::<Speed>().is_err(), "{text}");
        }
    }
}
