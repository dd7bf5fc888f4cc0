//! Records the samples around the largest error and around the strongest stop, for pictures.

use crate::measures::sample::{SAMPLE_S, Sample};
use std::collections::VecDeque;

/// Time that a snapshot covers before and after its instant, s.
const SIDE_S: f64 = 0.25;

/// Number of samples in a snapshot.
const LENGTH: usize = (2.0 * SIDE_S / SAMPLE_S) as usize;

/// Samples around an instant, each with its contour error, um, if it was printing.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// Time of the instant, s.
    pub time_s: f64,
    /// Samples in order of time, each with its contour error.
    pub samples: Vec<(Sample, Option<f64>)>,
}

/// Two snapshots of a job.
#[derive(Clone, Debug, Default)]
pub struct Snapshots {
    recent: VecDeque<(Sample, Option<f64>)>,
    error_pending_s: Option<f64>,
    stop_pending_s: Option<f64>,
    error: Snapshot,
    stop: Snapshot,
}

impl Snapshots {
    /// Returns the samples around the largest contour error.
    pub const fn around_largest_error(&self) -> &Snapshot {
        &self.error
    }

    /// Returns the samples around the stop that rings most.
    pub const fn around_strongest_stop(&self) -> &Snapshot {
        &self.stop
    }

    pub(super) fn largest_error(&mut self, time_s: f64) {
        self.error_pending_s = Some(time_s);
    }

    pub(super) fn strongest_stop(&mut self, time_s: f64) {
        self.stop_pending_s = Some(time_s);
    }

    pub(super) fn push(&mut self, sample: Sample, error_um: Option<f64>) {
        if self.recent.len() == LENGTH {
            self.recent.pop_front();
        }
        self.recent.push_back((sample, error_um));
        let pairs = [(&mut self.error_pending_s, &mut self.error), (&mut self.stop_pending_s, &mut self.stop)];
        for (pending, snapshot) in pairs {
            if let Some(time_s) = *pending
                && sample.time_s >= time_s + SIDE_S
            {
                *pending = None;
                *snapshot = Snapshot { time_s, samples: self.recent.iter().copied().collect() };
            }
        }
    }
}
