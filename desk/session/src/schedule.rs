//! Times at which the lines of a job are executed: the remaining time is read from
//! them, and only falls.

use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ferrostep_printer::{Ports, Printer, Profile};

use crate::input::Input;
use crate::job::{self, JobProgress, Onlooker};
use crate::job_replies::JobReplies;
use crate::macros::Macros;
use crate::session::Session;

/// Minimum time between two lines that are noted, s.
const STEP_S: f64 = 0.5;

/// Maximum number of lines that are noted: only every second of them is kept of a longer job, and
/// the time between them doubles.
const MAX_POINTS: usize = 1 << 16;

/// The printer's time at some lines of a file.
#[derive(Debug, Default)]
pub struct Schedule {
    /// Lines from 1 and a time at each, s; both ascend.
    points: Vec<(u32, f64)>,
    /// The newest time, which need not be among the points.
    last: Option<(u32, f64)>,
    /// Minimum time between two points, s.
    step_s: f64,
    /// Time of the whole job, s.
    total_s: f64,
}

impl Schedule {
    /// Estimates a file for a machine with this look-ahead in blocks; stops when it
    /// becomes `unwanted`.
    ///
    /// # Errors
    /// The printer would stop in it; where and why.
    pub fn of(path: &Path, profile: Profile, look_ahead: usize, unwanted: &Arc<AtomicBool>) -> Result<Self, String> {
        let input = Input::open(path).map_err(|error| error.to_string())?;
        let mut input = Wanted { input, unwanted };
        let session = Session::estimate(profile, look_ahead, JobReplies::new(|_: &str| {}));
        let mut printer = session.printer();
        let schedule = Self { step_s: STEP_S, ..Self::default() };
        let mut sampler = Sampler { now_s: || session.figures().print_time_s, schedule };
        let mut progress = JobProgress::default();
        let outcome = session.run(job::run_watched(
            &mut input,
            &mut printer,
            &mut progress,
            Macros::chosen(),
            &mut sampler,
            |_| {},
        ));
        outcome.map_err(|error| error.to_string())?;
        Ok(Self { total_s: session.figures().print_time_s, ..sampler.schedule })
    }

    /// Notes the time at a line, s. Lines and times ascend; others are left out.
    pub fn note(&mut self, line: u32, now_s: f64) {
        if self.last.is_some_and(|(last, last_s)| line < last || now_s < last_s) {
            return;
        }
        self.last = Some((line, now_s));
        if self.points.last().is_some_and(|(_, last_s)| now_s < last_s + self.step_s) {
            return;
        }
        self.points.push((line, now_s));
        if self.points.len() >= MAX_POINTS {
            let mut number = 0_u32;
            self.points.retain(|_| {
                number = number.wrapping_add(1);
                number % 2 == 1
            });
            self.step_s = (self.step_s * 2.0).max(STEP_S);
        }
    }

    /// Ends the job: the newest time becomes a point, whatever its distance to the one before.
    pub fn end(&mut self, total_s: f64) {
        self.points.extend(self.last.filter(|last| self.points.last() != Some(last)));
        self.total_s = total_s;
    }

    /// The newest time that was noted, s.
    pub fn newest_s(&self) -> f64 {
        self.last.map_or(0.0, |(_, time_s)| time_s)
    }

    /// Time of the whole job, s.
    pub const fn total_s(&self) -> f64 {
        self.total_s
    }

    /// Time at a line, s.
    pub fn at_s(&self, line: u32) -> f64 {
        let after = self.points.partition_point(|(point, _)| *point <= line);
        after.checked_sub(1).and_then(|before| self.points.get(before)).map_or(0.0, |(_, time_s)| *time_s)
    }
}

/// Notes the time at the lines.
struct Sampler<F> {
    now_s: F,
    schedule: Schedule,
}

impl<P: Ports, F: Fn() -> f64> Onlooker<P> for Sampler<F> {
    fn begins(&mut self, _: &Printer<'_, P>, line: u32, _: &str) {
        let now_s = (self.now_s)();
        self.schedule.note(line, now_s);
    }

    fn ended(&mut self, _: &Printer<'_, P>) {}
}

/// A file that ends with an error as soon as it is unwanted.
struct Wanted<'a> {
    input: Input,
    unwanted: &'a Arc<AtomicBool>,
}

impl Read for Wanted<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.unwanted.load(Ordering::Relaxed) {
            return Err(io::Error::other("another file has come"));
        }
        self.input.read(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A print of any length takes the same memory; its first line stays.
    #[test]
    fn a_long_job_keeps_every_second_line() {
        let mut schedule = Schedule { step_s: STEP_S, ..Schedule::default() };
        for line in 1..=1_000_000_u32 {
            schedule.note(line, f64::from(line) * 0.5);
        }
        assert!((MAX_POINTS / 2 - 1..MAX_POINTS).contains(&schedule.points.len()), "{}", schedule.points.len());
        assert_eq!(schedule.points.first(), Some(&(1, 0.5)));
        assert!(schedule.points.is_sorted_by(|a, b| a.0 < b.0 && b.1 >= a.1 + 8.0));
        assert!((schedule.at_s(777_777) - 388_888.5).abs() <= 16.0, "{}", schedule.at_s(777_777));
        schedule.end(500_000.0);
        assert_eq!((schedule.at_s(1_000_000), schedule.total_s()), (500_000.0, 500_000.0));
    }

    #[test]
    fn a_short_job_keeps_every_line() {
        let mut schedule = Schedule::default();
        for (line, time_s) in [(3, 1.0), (5, 1.25), (4, 2.0), (6, 1.0), (9, 1.5)] {
            schedule.note(line, time_s);
        }
        schedule.end(1.5);
        let times = [0, 3, 4, 5, 6, 8, 9, 10].map(|line| schedule.at_s(line));
        assert_eq!(times, [0.0, 1.0, 1.0, 1.25, 1.25, 1.25, 1.5, 1.5], "a line or a time that goes back is left out");
    }
}
