//! The progress bar, on standard error.

use std::cell::Cell;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use ferrostep_printer::Profile;
use ferrostep_session::desk::Figures;
use ferrostep_session::job::JobProgress;
use ferrostep_session::schedule::Schedule;
use indicatif::{ProgressBar, ProgressStyle};

use crate::terminal::tell;

/// Length of the bar, characters.
const LENGTH: usize = 20;

/// Minimum time between two messages: what changes faster cannot be read.
const INTERVAL: Duration = Duration::from_millis(50);

/// Times at which the lines of a file are executed, once a thread beside this one
/// has estimated them.
#[derive(Clone, Default)]
pub struct Estimate(Arc<OnceLock<Schedule>>);

impl Estimate {
    /// Begins to estimate a file for a machine. Only a regular file is estimated: others can
    /// be read once only.
    pub fn begin(&self, file: &Path, profile: Profile, look_ahead: usize) {
        if !file.metadata().is_ok_and(|metadata| metadata.is_file()) {
            return;
        }
        let (file, estimated) = (file.to_owned(), Arc::clone(&self.0));
        let estimate = move || {
            // A job that stops has no time; its error comes from the print itself.
            if let Ok(schedule) = Schedule::of(&file, profile, look_ahead, &Arc::new(AtomicBool::new(false))) {
                let _ = estimated.set(schedule);
            }
        };
        // The time stays unknown if no thread can be started.
        let _ = std::thread::Builder::new().name("estimate".to_owned()).spawn(estimate);
    }

    /// The estimate, if it is made.
    pub fn get(&self) -> Option<&Schedule> {
        self.0.get()
    }
}

/// Shows the progress of a job. If standard error is not a terminal, only messages appear.
pub struct Progress {
    bar: ProgressBar,
    started: Instant,
    shown: Cell<Option<Instant>>,
    /// The greatest share so far.
    most: Cell<f64>,
    /// The job's motion, s, if its file says it.
    motion_time_s: Cell<Option<f64>>,
    layers: Cell<Option<u32>>,
    /// The estimate that is made beside the print.
    schedule: Estimate,
}

impl Progress {
    /// A bar that begins now.
    pub fn new() -> Self {
        Self {
            bar: bar(0, "{wide_msg}"),
            started: Instant::now(),
            shown: Cell::default(),
            most: Cell::default(),
            motion_time_s: Cell::default(),
            layers: Cell::default(),
            schedule: Estimate::default(),
        }
    }

    /// Estimates the time of a file's print meanwhile: only that gives the remaining time.
    /// Without a terminal it would not be seen.
    pub fn estimate(&self, file: &Path, profile: Profile, look_ahead: usize) {
        if !self.bar.is_hidden() {
            self.schedule.begin(file, profile, look_ahead);
        }
    }

    /// Takes in where the job is, and moves the bar. `share`: the part of the file that was read, 0
    /// to 1, if its size is known.
    pub fn show(&self, share: Option<f64>, job: &JobProgress, figures: impl FnOnce() -> Figures) {
        self.motion_time_s.set(job.motion_time_s);
        // A prepared job gives the number of all layers, not the present one.
        self.layers.set((job.motion_time_s.is_none() && job.layers > 0).then_some(job.layers));
        self.show_if_due(share, figures);
    }

    /// Moves the bar of a prepared job, whose time is known, while it is executed.
    pub fn pass_time(&self, figures: impl FnOnce() -> Figures) {
        if self.motion_time_s.get().is_some() {
            self.show_if_due(None, figures);
        }
    }

    fn show_if_due(&self, share: Option<f64>, figures: impl FnOnce() -> Figures) {
        let now = Instant::now();
        if self.bar.is_hidden() || self.shown.get().is_some_and(|shown| now.duration_since(shown) < INTERVAL) {
            return;
        }
        self.shown.set(Some(now));
        let figures = figures();
        // The remaining time can only fall.
        let times = match (self.motion_time_s.get(), self.schedule.get().map(Schedule::total_s)) {
            (Some(all_s), _) => Some((figures.motion_time_s, all_s)),
            (None, Some(all_s)) => Some((figures.print_time_s, all_s)),
            (None, None) => None,
        };
        let times = times.filter(|(_, all_s)| *all_s > 0.0);
        let share = times.map_or(share, |(done_s, all_s)| Some((done_s / all_s).min(1.0)));
        let left_s = times.map(|(done_s, all_s)| all_s - done_s);
        // Shares of packed files are estimates: the bar does not go back.
        let share = share.map(|share| share.max(self.most.get()));
        self.most.set(share.unwrap_or_default());
        // All of the line at once: a bar and a message of indicatif's would be drawn one
        // after the other.
        self.bar.set_message(line(share, left_s, self.layers.get(), &figures, self.started.elapsed()));
    }

    /// A message, above the bar.
    pub fn say(&self, text: &str) {
        self.bar.suspend(|| tell(text));
    }

    /// Removes the bar.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }
}

/// A bar with a template of indicatif's. Only `{wide_msg}` of its parts may be long: it is cut to
/// the terminal's width, and a line that wraps would leave a copy at each change.
pub fn bar(length: u64, template: &str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style.progress_chars("=> ")),
        Err(_) => bar,
    }
}

/// The bar, where the share is known, and the text beside it, the most important first.
fn line(share: Option<f64>, left_s: Option<f64>, layers: Option<u32>, figures: &Figures, elapsed: Duration) -> String {
    let mut parts = Vec::new();
    if let Some(share) = share {
        let filled = "=".repeat((share * LENGTH as f64) as usize) + ">";
        parts.push(format!("{filled:LENGTH$.LENGTH$} {:>3.0} %", (share * 100.0).floor()));
    }
    // The time that the printer will still need, not the desk.
    parts.extend(left_s.map(|left_s| format!("left {}", clock(left_s))));
    parts.push(format!("printed {}", clock(figures.print_time_s)));
    parts.extend(layers.map(|layers| format!("layer {layers}")));
    parts.push(format!("{:.0} x", figures.motion_time_s / elapsed.as_secs_f64().max(1e-6)));
    parts.join("  ")
}

/// Hours, minutes and seconds as a clock writes them.
pub fn clock(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    let (hours, minutes, seconds) = (whole / 3600, whole / 60 % 60, whole % 60);
    if hours > 0 { format!("{hours}:{minutes:02}:{seconds:02}") } else { format!("{minutes}:{seconds:02}") }
}

#[cfg(test)]
mod tests {
    use ferrostep_planner::StepDigests;

    use super::*;

    #[test]
    fn a_print_of_days_fits_into_80_columns() {
        let figures = Figures {
            print_time_s: 90.0 * 3600.0,
            motion_time_s: 89.0 * 3600.0,
            motor_steps: [0; 4],
            max_event_rate_hz: 0,
            underruns: 0,
            starvation_flushes: 0,
            slowed_moves: 0,
            merged_moves: 0,
            digests: StepDigests::default(),
        };
        let text = line(Some(0.5), Some(89.0 * 3600.0), Some(1234), &figures, Duration::from_secs(30));
        assert_eq!(text, "==========>           50 %  left 89:00:00  printed 90:00:00  layer 1234  10680 x");
        assert!(text.len() <= 80, "{}", text.len());
        assert!(
            line(Some(1.0), Some(0.0), None, &figures, Duration::from_secs(30))
                .starts_with("==================== 100 %  left 0:00  ")
        );
        let text = line(None, None, None, &figures, Duration::from_secs(30));
        assert_eq!(text, "printed 90:00:00  10680 x");
    }

    #[test]
    fn times_are_written_as_clocks_do() {
        for (seconds, text) in [(0.4, "0:00"), (59.6, "1:00"), (3599.0, "59:59"), (3661.0, "1:01:01"), (-1.0, "0:00")] {
            assert_eq!(clock(seconds), text);
        }
    }
}
