//! The progress bar, on standard error.

use std::time::Duration;

use ferrostep::desk::Figures;
use ferrostep::duration::hms;
use ferrostep::job::JobProgress;
use ferrostep::terminal::tell;
use indicatif::{ProgressBar, ProgressStyle};

/// Shows the progress of a job. If standard error is not a terminal, only messages appear.
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// A bar for a file of this size.
    pub fn new(size_bytes: u64) -> Self {
        let bar = ProgressBar::new(size_bytes);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar }
    }

    /// Moves the bar.
    pub fn show(&self, read_bytes: u64, job: &JobProgress, figures: &Figures, elapsed: Duration) {
        self.bar.set_position(read_bytes);
        let wall_s = elapsed.as_secs_f64().max(1e-6);
        let share = read_bytes as f64 / self.bar.length().unwrap_or(0).max(1) as f64;
        // By the share of the file: the time that the printer will still need, not the desk.
        let left_s = if share > 0.0 { figures.print_time_s * (1.0 / share - 1.0) } else { 0.0 };
        self.bar.set_message(format!(
            "layer {}  printed {}  left {}  {:.0} x real time",
            job.layers,
            hms(figures.print_time_s),
            hms(left_s.max(0.0)),
            figures.motion_time_s / wall_s
        ));
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
