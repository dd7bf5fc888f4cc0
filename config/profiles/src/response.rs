//! Response of an axis's filter and of the frame after it to a change of the commanded motion.

use std::f64::consts::TAU;

use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_planner::shaping::{Impulse, Kernel};

/// The frame's mode along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameMode {
    /// Undamped frequency, Hz.
    pub frequency_hz: f64,
    /// The true frequency lies within this of it, Hz.
    pub frequency_uncertainty_hz: f64,
    /// Damping ratio.
    pub damping: f64,
}

/// The largest distances from the commanded motion that one change of it causes while an earlier
/// one of the same size still rings, apart from a delay of the whole axis: a delay leaves the
/// nozzle on its path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// mm for each mm/s^2 by which the acceleration jumps: s^2.
    pub of_acceleration_s2: f64,
    /// mm for each mm/s by which the speed jumps: s.
    pub of_speed_s: f64,
}

/// Number of frequencies that are tried over the frame's range, its ends included.
const FREQUENCIES: u32 = 9;

/// Damping ratios that are tried: parts of the one that was measured, which is known far worse
/// than the frequency.
const DAMPING_PARTS: [f64; 3] = [0.5, 1.0, 1.5];

/// Time for which the response is followed after the last impulse, periods of the mode. The first
/// swing is the largest.
const FOLLOWED_PERIODS: f64 = 2.0;

/// Points of a period.
const POINTS: f64 = 48.0;

impl FrameMode {
    /// The worst response, over the frequencies that the frame may have and half to one and a half
    /// times the damping, to a command that goes through this kernel.
    pub fn worst(&self, kernel: &[Impulse]) -> Response {
        let mut worst = Response { of_acceleration_s2: 0.0, of_speed_s: 0.0 };
        for place in 0..FREQUENCIES {
            let side = 2.0 * f64::from(place) / f64::from(FREQUENCIES - 1) - 1.0;
            let frequency_hz = self.frequency_hz + side * self.frequency_uncertainty_hz;
            for part in DAMPING_PARTS {
                let mode = Mode { omega: TAU * frequency_hz, damping: (part * self.damping).min(MAX_DAMPING) };
                let response = mode.response(kernel);
                worst.of_acceleration_s2 = worst.of_acceleration_s2.max(response.of_acceleration_s2);
                worst.of_speed_s = worst.of_speed_s.max(response.of_speed_s);
            }
        }
        worst
    }
}

/// A mode with this much damping hardly swings; with 1 it would have no frequency.
const MAX_DAMPING: f64 = 0.95;

/// x'' + 2 damping omega x' + omega^2 x = omega^2 u.
#[derive(Clone, Copy, Debug)]
struct Mode {
    omega: f64,
    damping: f64,
}

impl Mode {
    fn response(&self, kernel: &[Impulse]) -> Response {
        let delay_s = centroid_ticks(kernel) / f64::from(TICKS_PER_SECOND) + self.lag_s();
        let period_s = TAU / self.omega;
        let end_s = seconds(length_ticks(kernel)) + FOLLOWED_PERIODS * period_s;
        let points = (end_s * POINTS / period_s).ceil() as u32;
        let mut response = Response { of_acceleration_s2: 0.0, of_speed_s: 0.0 };
        let left = self.left_ringing(kernel);
        for point in 0..=points {
            let time_s = end_s * f64::from(point) / f64::from(points);
            let sum = |of: fn(&Self, f64) -> f64| -> f64 {
                let after = |one: &Impulse| (time_s - seconds(one.delay_ticks)).max(0.0);
                kernel.iter().map(|one| one.weight * of(self, after(one))).sum()
            };
            let command_s = (time_s - delay_s).max(0.0);
            let acceleration = sum(Self::after_acceleration) - 0.5 * command_s * command_s;
            let speed = sum(Self::after_speed) - command_s;
            response.of_acceleration_s2 = response.of_acceleration_s2.max(acceleration.abs());
            response.of_speed_s = response.of_speed_s.max(speed.abs());
        }
        let [acceleration, speed] =
            [self.start_of_acceleration(), self.start_of_speed()].map(|start| self.amplitude(start));
        Response {
            of_acceleration_s2: response.of_acceleration_s2 + left * acceleration,
            of_speed_s: response.of_speed_s + left * speed,
        }
    }

    /// The share of one impulse's vibration that a kernel leaves at the time of its last impulse.
    fn left_ringing(&self, kernel: &[Impulse]) -> f64 {
        let (mut sine, mut cosine) = (0.0, 0.0);
        for one in kernel {
            let before_s = seconds(length_ticks(kernel) - one.delay_ticks);
            let part = one.weight * (-self.damping * self.omega * before_s).exp();
            sine += part * (self.damped_omega() * before_s).sin();
            cosine += part * (self.damped_omega() * before_s).cos();
        }
        sine.hypot(cosine)
    }

    /// Delay of the mode at constant speed, s.
    fn lag_s(&self) -> f64 {
        2.0 * self.damping / self.omega
    }

    /// Position of the mode, mm, at a time after a command of 1 mm/s began at rest.
    fn after_speed(&self, time_s: f64) -> f64 {
        time_s - self.lag_s() + self.ringing(time_s, self.start_of_speed())
    }

    /// Position of the mode, mm, at a time after a command of 1 mm/s^2 began at rest.
    fn after_acceleration(&self, time_s: f64) -> f64 {
        let lag_mm = self.lag_s() * time_s;
        0.5 * time_s * time_s - lag_mm + self.compliance_s2() + self.ringing(time_s, self.start_of_acceleration())
    }

    /// Offset of the mode at constant acceleration, mm from a command that is as late as the mode,
    /// for each mm/s^2.
    fn compliance_s2(&self) -> f64 {
        (4.0 * self.damping * self.damping - 1.0) / (self.omega * self.omega)
    }

    /// The vibration that a command of 1 mm/s begins: position and speed.
    fn start_of_speed(&self) -> [f64; 2] {
        [self.lag_s(), -1.0]
    }

    /// The vibration that a command of 1 mm/s^2 begins.
    fn start_of_acceleration(&self) -> [f64; 2] {
        [-self.compliance_s2(), self.lag_s()]
    }

    fn damped_omega(&self) -> f64 {
        self.omega * (1.0 - self.damping * self.damping).sqrt()
    }

    /// A free vibration that began with this position and speed.
    fn ringing(&self, time_s: f64, [position, speed]: [f64; 2]) -> f64 {
        let decay = self.damping * self.omega;
        let (sine, cosine) = (self.damped_omega() * time_s).sin_cos();
        (-decay * time_s).exp() * (position * cosine + (speed + decay * position) / self.damped_omega() * sine)
    }

    fn amplitude(&self, [position, speed]: [f64; 2]) -> f64 {
        position.hypot((speed + self.damping * self.omega * position) / self.damped_omega())
    }
}

/// The impulses of a filter: those of a shaper, each of them followed by a moving average over
/// `smooth_ticks`, 0 for none.
pub fn impulses(kernel: &Kernel, smooth_ticks: u32) -> Vec<Impulse> {
    let parts = if smooth_ticks > 0 { AVERAGE_PARTS } else { 1 };
    let part = f64::from(smooth_ticks) / f64::from(parts);
    let mut all: Vec<Impulse> = (kernel.impulses().iter())
        .flat_map(|one| (0..parts).map(move |index| (one, index)))
        .map(|(one, index)| Impulse {
            weight: one.weight / f64::from(parts),
            delay_ticks: one.delay_ticks + ((f64::from(index) + 0.5) * part).round() as u32,
        })
        .collect();
    all.sort_by_key(|one| one.delay_ticks);
    all
}

/// Impulses for which a moving average is taken: its variance is by 1 / 576 smaller.
const AVERAGE_PARTS: u32 = 24;

fn centroid_ticks(kernel: &[Impulse]) -> f64 {
    kernel.iter().map(|one| one.weight * f64::from(one.delay_ticks)).sum()
}

fn length_ticks(kernel: &[Impulse]) -> u32 {
    kernel.last().map_or(0, |last| last.delay_ticks)
}

fn seconds(ticks: u32) -> f64 {
    f64::from(ticks) / f64::from(TICKS_PER_SECOND)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ferrostep_planner::{AxisShaper, ShaperKind};

    fn worst(kind: ShaperKind, uncertainty_hz: f64, damping: f64) -> Response {
        let shaper = AxisShaper { kind, frequency_hz: 50.0, damping };
        FrameMode { frequency_hz: 50.0, frequency_uncertainty_hz: uncertainty_hz, damping }
            .worst(shaper.kernel().unwrap().impulses())
    }

    #[test]
    fn a_bare_undamped_frame_swings_by_the_textbook() {
        let omega = TAU * 50.0;
        let bare = worst(ShaperKind::None, 0.0, 0.0);
        // Twice the offset at constant acceleration, and once more for the vibration
        // that never decays.
        assert!((bare.of_acceleration_s2 * omega * omega - 3.0).abs() < 0.01, "{bare:?}");
        assert!((bare.of_speed_s * omega - 2.0).abs() < 0.01, "{bare:?}");
    }

    #[test]
    fn a_shaper_of_the_right_frequency_leaves_what_it_and_the_frame_round() {
        let omega = TAU * 50.0;
        // The end of ZV's step response counts, where half of it is over: after 1/4 period
        // the mode lags most.
        let zv = worst(ShaperKind::Zv, 0.0, 0.0);
        let [rounded, compliance] = [0.5 / 16.0 / (50.0 * 50.0), 1.0 / (omega * omega)];
        assert!(zv.of_acceleration_s2 >= rounded - compliance && zv.of_acceleration_s2 < 0.4 * compliance, "{zv:?}");
    }

    #[test]
    fn the_less_is_known_the_worse() {
        for kind in [ShaperKind::None, ShaperKind::Zv, ShaperKind::Mzv, ShaperKind::Ei] {
            let known = [0.0, 0.5, 2.0, 5.0, 10.0].map(|uncertainty_hz| worst(kind, uncertainty_hz, 0.06));
            for pair in known.windows(2) {
                assert!(pair[1].of_acceleration_s2 > pair[0].of_acceleration_s2, "{kind} {pair:?}");
                assert!(pair[1].of_speed_s >= pair[0].of_speed_s, "{kind} {pair:?}");
            }
        }
    }
}
