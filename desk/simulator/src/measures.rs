//! Measures a nozzle's motion and flow against the programmed path.

mod bead;
mod histogram;
mod sample;
mod snapshot;

pub use bead::BeadReport;
pub use histogram::Histogram;
pub use sample::{SAMPLE_S, Sample};
pub use snapshot::{Snapshot, Snapshots};

use crate::path::{PathSegment, PathWindow};
use bead::Bead;
use serde::Serialize;
use std::collections::VecDeque;

/// Accelerations are differences over this many samples: 1 ms.
const DIFFERENCE_SAMPLES: usize = 4;

/// Interval of these differences, s.
const DIFFERENCE_S: f64 = DIFFERENCE_SAMPLES as f64 * SAMPLE_S;

/// Maximum time by which the nozzle leads or lags the plan, s: half a shaper's length plus the
/// frame's lag.
pub const WINDOW_S: f64 = 0.03;

/// Maximum number of samples that wait for the path: 10 min. Only the end of a longer move is
/// measured.
const MAX_WAITING: usize = 2_400_000;

/// Duration of a pause after which the motion counts as stopped, s.
pub const STOP_S: f64 = 0.02;

/// Contour error, um: distance of the nozzle from the programmed path while printing, sampled at
/// equal times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ContourError {
    /// Root mean square.
    pub rms: f64,
    /// Value not exceeded 99 % of the time.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

/// Ringing of the nozzle around the motors' position after they stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Ringing {
    /// Number of stops of X and Y.
    pub stops: u64,
    /// Root mean square of the amplitudes, um.
    pub rms_um: f64,
    /// Maximum amplitude, um.
    pub max_um: f64,
    /// `rms_um` relative to that of the same job planned without any filter; missing if that plan
    /// is unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative: Option<f64>,
}

impl Ringing {
    /// Sets `relative` from the ringing of the plan without filters; `None` if that plan does not
    /// ring.
    pub fn relative_to(self, unfiltered: &Self) -> Self {
        let relative = (unfiltered.rms_um > 0.0).then(|| self.rms_um / unfiltered.rms_um);
        Self { relative, ..self }
    }
}

/// Acceleration of the motors in X and Y while printing, by second differences over 1 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TrueAcceleration {
    /// Value not exceeded 99 % of the time.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

/// Motion of the extruder's motor, by differences over 1 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ExtruderReport {
    /// Maximum speed of the filament, mm/s.
    pub max_speed_mm_per_s: f64,
    /// Maximum acceleration of the filament, mm/s^2.
    pub max_acceleration_mm_per_s2: f64,
    /// Maximum speed while printing, mm/s.
    pub max_printing_speed_mm_per_s: f64,
    /// Maximum acceleration while printing, mm/s^2.
    pub max_printing_acceleration_mm_per_s2: f64,
}

/// Measures of a job.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Duration of the motion, s.
    pub time_s: f64,
    /// Distance of the nozzle from the path.
    pub contour_error_um: ContourError,
    /// Misplaced material.
    #[serde(flatten)]
    pub bead: BeadReport,
    /// Vibration after stops.
    pub ringing: Ringing,
    /// Acceleration of X and Y.
    pub true_acceleration_mm_per_s2: TrueAcceleration,
    /// Demands on the extruder.
    pub extruder: ExtruderReport,
    /// Time spent printing, s.
    pub printing_time_s: f64,
}

/// Takes samples and the path, interleaved in any way, and measures.
#[derive(Debug)]
pub struct Measures {
    path: PathWindow,
    waiting: VecDeque<Sample>,
    bead: Bead,
    contour_um: Histogram,
    acceleration: Histogram,
    ringing_um: Histogram,
    recent: VecDeque<(Sample, bool)>,
    extruder: ExtruderReport,
    snapshots: Option<Snapshots>,
}

impl Default for Measures {
    fn default() -> Self {
        Self {
            path: PathWindow::default(),
            waiting: VecDeque::new(),
            bead: Bead::default(),
            contour_um: Histogram::new(0.1, 100_000),
            acceleration: Histogram::new(10.0, 100_000),
            ringing_um: Histogram::new(0.1, 1),
            recent: VecDeque::with_capacity(2 * DIFFERENCE_SAMPLES + 1),
            extruder: ExtruderReport::default(),
            snapshots: None,
        }
    }
}

impl Measures {
    /// Creates measures that also keep the motion around the largest error and after the strongest
    /// stop.
    pub fn with_snapshots() -> Self {
        Self { snapshots: Some(Snapshots::default()), ..Self::default() }
    }

    /// Appends the next part of the path.
    pub fn push_segment(&mut self, segment: PathSegment) {
        self.bead.push_segment(&segment, self.path.length_mm());
        self.path.push(segment);
        self.work(false);
    }

    /// Marks the path as complete up to a time, s.
    pub fn nothing_until(&mut self, time_s: f64) {
        self.path.nothing_until(time_s);
    }

    /// Appends the next sample.
    pub fn push_sample(&mut self, sample: Sample) {
        self.waiting.push_back(sample);
        self.work(false);
        while self.waiting.len() > MAX_WAITING {
            let Some(sample) = self.waiting.pop_front() else { return };
            self.measure(sample);
        }
    }

    /// Records a stop of X and Y after which the nozzle rings with this amplitude, mm.
    pub fn stopped(&mut self, time_s: f64, amplitude_mm: f64) {
        let amplitude_um = amplitude_mm * 1000.0;
        if let Some(snapshots) = self.snapshots.as_mut().filter(|_| amplitude_um > self.ringing_um.max()) {
            snapshots.strongest_stop(time_s);
        }
        self.ringing_um.add(amplitude_um);
    }

    /// Returns the length of the path so far, mm.
    #[cfg(test)]
    pub(crate) const fn path_mm(&self) -> f64 {
        self.path.length_mm()
    }

    /// Returns the number of samples that wait for the path.
    #[cfg(test)]
    pub(crate) fn waiting_samples(&self) -> usize {
        self.waiting.len()
    }

    fn work(&mut self, to_the_end: bool) {
        while let Some(sample) = self.waiting.front().copied() {
            if !to_the_end && self.path.known_until_s() < sample.time_s + WINDOW_S {
                return;
            }
            self.waiting.pop_front();
            self.measure(sample);
        }
    }

    fn measure(&mut self, sample: Sample) {
        let time_s = sample.time_s;
        self.path.forget_before(time_s - 2.0 * WINDOW_S);
        let is_printing = self.path.at(time_s).is_some_and(PathSegment::is_printing);
        let nearest = self.path.nearest(sample.nozzle_mm, [time_s - WINDOW_S, time_s + WINDOW_S]);
        let mut error_um = None;
        let (mut place_mm, mut wanted_mm3) = (None, 0.0);
        if let Some((distance_mm, along_mm, segment)) = nearest {
            place_mm = Some(along_mm);
            let [x, y] = sample.nozzle_mm_per_s;
            wanted_mm3 = segment.bead_mm2 * x.hypot(y) * SAMPLE_S;
            if is_printing {
                let distance_um = distance_mm * 1000.0;
                if let Some(snapshots) = self.snapshots.as_mut().filter(|_| distance_um > self.contour_um.max()) {
                    snapshots.largest_error(time_s);
                }
                self.contour_um.add(distance_um);
                error_um = Some(distance_um);
            }
        }
        if !is_printing {
            self.bead.ooze(sample.out_mm3);
        }
        self.bead.add(place_mm, sample.out_mm3 - wanted_mm3, self.path.length_mm());
        if let Some(snapshots) = &mut self.snapshots {
            snapshots.push(sample, error_um);
        }
        self.differences(sample, is_printing);
    }

    fn differences(&mut self, sample: Sample, is_printing: bool) {
        if sample.restart {
            self.recent.clear();
        }
        self.recent.push_back((sample, is_printing));
        let &mut [(before, _), .., (after, _)] = self.recent.make_contiguous() else { return };
        if self.recent.len() <= 2 * DIFFERENCE_SAMPLES {
            return;
        }
        let (middle, is_printing) = self.recent[DIFFERENCE_SAMPLES];
        self.recent.pop_front();
        let second =
            |before: f64, middle: f64, after: f64| (after - 2.0 * middle + before) / (DIFFERENCE_S * DIFFERENCE_S);
        let speed = (after.filament_mm - middle.filament_mm).abs() / DIFFERENCE_S;
        let acceleration = second(before.filament_mm, middle.filament_mm, after.filament_mm).abs();
        let extruder = &mut self.extruder;
        extruder.max_speed_mm_per_s = extruder.max_speed_mm_per_s.max(speed);
        extruder.max_acceleration_mm_per_s2 = extruder.max_acceleration_mm_per_s2.max(acceleration);
        if is_printing {
            extruder.max_printing_speed_mm_per_s = extruder.max_printing_speed_mm_per_s.max(speed);
            extruder.max_printing_acceleration_mm_per_s2 =
                extruder.max_printing_acceleration_mm_per_s2.max(acceleration);
            let [x, y] = [0, 1]
                .map(|axis: usize| second(before.command_mm[axis], middle.command_mm[axis], after.command_mm[axis]));
            self.acceleration.add(x.hypot(y));
        }
    }

    /// Returns the measures, and the motion kept for pictures.
    pub fn finish(mut self, time_s: f64) -> (Report, Option<Snapshots>) {
        self.work(true);
        let report = Report {
            time_s,
            contour_error_um: ContourError {
                rms: self.contour_um.rms(),
                p99: self.contour_um.percentile(0.99),
                max: self.contour_um.max(),
            },
            bead: self.bead.finish(),
            ringing: Ringing {
                stops: self.ringing_um.count(),
                rms_um: self.ringing_um.rms(),
                max_um: self.ringing_um.max(),
                relative: None,
            },
            true_acceleration_mm_per_s2: TrueAcceleration {
                p99: self.acceleration.percentile(0.99),
                max: self.acceleration.max(),
            },
            extruder: self.extruder,
            printing_time_s: self.contour_um.count() as f64 * SAMPLE_S,
        };
        (report, self.snapshots)
    }
}
