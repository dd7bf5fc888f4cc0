//! Reports progress and obeys a person's wishes while a job is sent.

use std::time::{Duration, Instant};

use ferrostep_host::send::Watch;

use super::readings::Readings;
use super::shared::{PageHost, Phase};

/// Interval of the questions for the position during a job.
const POSITION_INTERVAL: Duration = Duration::from_secs(2);

/// The printer's pause: it moves the nozzle aside, and waits.
const PAUSE: &str = "M601";

/// The watch of a job.
pub struct Watching<'a, E> {
    host: &'a PageHost,
    /// Returns true once the program is to end.
    ends: E,
}

impl<'a, E: Fn() -> bool> Watching<'a, E> {
    /// Watches a host's job.
    pub fn new(host: &'a PageHost, ends: E) -> Self {
        Self { host, ends }
    }
}

impl<E: Fn() -> bool> Watch for Watching<'_, E> {
    fn hear(&mut self, line: &str) {
        self.host.hear(line);
    }

    fn sent(&mut self, line: u32, command: &str) {
        let mut inner = self.host.lock();
        if command == PAUSE && inner.phase == Phase::Pausing {
            // The printer has answered, and has not paused: it says why in the console.
            inner.phase = Phase::Printing;
        }
        let Some(job) = &mut inner.job else { return };
        job.line = job.line.max(line);
        let mut words = command.split_ascii_whitespace();
        if words.next() == Some("M73") {
            let minutes = words.find_map(|word| word.strip_prefix('R')?.parse().ok());
            job.slicer_left_s = minutes.map(|minutes: f64| minutes * 60.0).or(job.slicer_left_s);
        }
    }

    fn held(&mut self, is_held: bool) {
        let mut inner = self.host.lock();
        if inner.phase != Phase::Cancelling {
            inner.phase = if is_held { Phase::Paused } else { Phase::Printing };
        }
    }

    fn wants_end(&mut self) -> bool {
        (self.ends)() || self.host.lock().wishes.end
    }

    fn command_between(&mut self) -> Option<String> {
        let mut inner = self.host.lock();
        if std::mem::take(&mut inner.wishes.pause) {
            return Some(PAUSE.to_owned());
        }
        if let Some(line) = inner.waiting.pop_front() {
            return Some(line);
        }
        let is_due = inner.asked_position.is_none_or(|asked| asked.elapsed() >= POSITION_INTERVAL);
        if self.host.setup.readings == Readings::Told || !is_due {
            return None;
        }
        inner.asked_position = Some(Instant::now());
        Some("M114".to_owned())
    }

    fn wants_wait_ended(&mut self) -> bool {
        std::mem::take(&mut self.host.lock().wishes.wait_ended)
    }
}
