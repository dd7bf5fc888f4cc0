//! The constants of a heater's model by its response to full power (M306 T).
//!
//! Full power from cold ([`hottest_start`]) to the target, none until the temperature has passed
//! its peak, then the target is held: without the part-cooling fan and, for a nozzle, with it. For
//! a mass `C` with a loss `G` to a room at 25 degrees, whose thermistor is late by `L`:
//!
//! - holding the target takes `G (T - room)`;
//! - on the way up the temperature rises by `s = (P - G (B - room)) / C`, with the mass
//!   at `B = T + s L`;
//! - without power the temperature rises further by `s L - r t` until its peak after `t`, with
//!   `r = G (T - room) / C`. A dead time counts as `1 + r / s` times as long a lag: the loop is the
//!   slower for it, and stable.
//!
//! The power at full is not found: `C` and `G` are in proportion to it.

use super::model::{Cooling, HeaterModel, ModelLoop};
use super::sample_time::SAMPLE_S;

/// The room's temperature, degrees Celsius.
const ROOM_CELSIUS: f32 = 25.0;
/// The slope is that of this last share of the way from the room to the target.
const SLOPE_SHARE: f32 = 0.15;
/// The peak is over where the temperature is this much below it, degrees.
const PAST_PEAK_CELSIUS: f32 = 1.0;
/// Share of a new temperature that the smoothed one takes over, a sample: a time constant of 0.2 s.
const SMOOTHING: f32 = 0.05;
/// Loss with the fan over that without, before it is known.
const FIRST_FAN: f32 = 1.5;
/// Longest time of each part, samples: 20 minutes.
const MAX_PART_SAMPLES: u32 = 20 * 60 * 100;
/// Time for which the target is held before its power counts: delays, and least and most, s.
const SETTLING: [f32; 3] = [15.0, 40.0, 240.0];
/// Time for which its power counts: the same.
const MEASURING: [f32; 3] = [5.0, 20.0, 60.0];

/// Progress of a step response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepProgress {
    /// The measurement continues: number of parts ended, and of all.
    Parts {
        /// Parts that have ended.
        ended: u8,
        /// Parts in all.
        of: u8,
    },
    /// The measurement has ended.
    Found(HeaterModel),
    /// A part has taken more than 20 minutes, or the found values are not a heater's.
    Failed,
}

/// The parts of it, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Heating,
    Peak,
    Settling,
    Measuring,
    FannedSettling,
    FannedMeasuring,
    Found,
    Failed,
}

/// A step response at work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepResponse {
    phase: Phase,
    /// Samples of this part so far.
    samples: u32,
    has_fan: bool,
    /// Model that the target is held by, and the result in the end.
    model: HeaterModel,
    /// Smoothed, degrees Celsius; before the first sample not a number.
    celsius: f32,
    /// Samples since the slope is measured.
    slope_samples: u32,
    /// Degrees a second at full power.
    slope: f32,
    /// Highest temperature without power, degrees Celsius, and after how many samples.
    highest: f32,
    peak_samples: u32,
    /// Degrees by which it was above where the power ended.
    rise: f32,
    /// Temperature at which measuring began, degrees Celsius.
    begun_celsius: f32,
    /// Sum of powers, 0 to 1, and of temperatures above the room's.
    powers: f32,
    rises: f32,
}

/// The hottest that a heater may be when its step begins, degrees Celsius: the slope is to be that
/// of full power alone.
pub fn hottest_start(target: f32) -> f32 {
    target - 3.0 * SLOPE_SHARE * (target - ROOM_CELSIUS)
}

/// The response of a thermistor with this lag, 1/s; one without a lag counts as the fastest.
fn response(lag_s: f32) -> f32 {
    (1.0 / lag_s).min(HeaterModel::SENSOR_PER_S[1] as f32)
}

/// Seconds in samples.
fn samples(seconds: f32) -> u32 {
    (seconds / SAMPLE_S) as u32
}

impl StepResponse {
    /// A step of a heater of this model's power; `has_fan`: also with the part-cooling
    /// fan at full power.
    pub const fn new(model: HeaterModel, has_fan: bool) -> Self {
        Self {
            phase: Phase::Heating,
            samples: 0,
            has_fan,
            model,
            celsius: f32::NAN,
            slope_samples: 0,
            slope: 0.0,
            highest: f32::NEG_INFINITY,
            peak_samples: 0,
            rise: 0.0,
            begun_celsius: 0.0,
            powers: 0.0,
            rises: 0.0,
        }
    }

    /// Returns true if it is over, with a model or without.
    pub const fn has_ended(&self) -> bool {
        matches!(self.phase, Phase::Found | Phase::Failed)
    }

    /// Returns true if the fan has to turn at full power now.
    pub const fn wants_fan(&self) -> bool {
        matches!(self.phase, Phase::FannedSettling | Phase::FannedMeasuring)
    }

    /// Returns its progress.
    pub const fn progress(&self) -> StepProgress {
        match self.phase {
            Phase::Found => StepProgress::Found(self.model),
            Phase::Failed => StepProgress::Failed,
            phase => StepProgress::Parts { ended: phase as u8, of: if self.has_fan { 6 } else { 4 } },
        }
    }

    fn enter(&mut self, phase: Phase) {
        (self.phase, self.samples) = (phase, 0);
        (self.powers, self.rises, self.begun_celsius) = (0.0, 0.0, self.celsius);
    }

    /// Power for the next sample, 0 to 1. `power` was that of the last, and `control`
    /// holds the target.
    pub fn power(&mut self, control: &mut ModelLoop, celsius: f32, target: f32, power: f32) -> f32 {
        if self.celsius.is_nan() {
            self.celsius = celsius;
        }
        self.celsius += (celsius - self.celsius) * SMOOTHING;
        self.samples += 1;
        if self.samples > MAX_PART_SAMPLES {
            self.phase = Phase::Failed;
        }
        let slope_rise = SLOPE_SHARE * (target - ROOM_CELSIUS);
        let lag_s = 1.0 / self.model.sensor_per_s;
        let lasts = |[lags, least_s, most_s]: [f32; 3]| samples((lags * lag_s).clamp(least_s, most_s));
        match self.phase {
            Phase::Heating => {
                if self.celsius < target - slope_rise {
                    self.begun_celsius = self.celsius;
                } else {
                    self.slope_samples += 1;
                }
                if self.celsius < target {
                    return 1.0;
                }
                self.slope = (self.celsius - self.begun_celsius) / (self.slope_samples as f32 * SAMPLE_S);
                self.enter(Phase::Peak);
                0.0
            }
            Phase::Peak => {
                if self.celsius > self.highest {
                    (self.highest, self.peak_samples) = (self.celsius, self.samples);
                }
                if self.celsius < self.highest - PAST_PEAK_CELSIUS {
                    self.rise = self.highest - self.begun_celsius;
                    self.begin_holding();
                    *control = ModelLoop::new();
                }
                0.0
            }
            Phase::Settling | Phase::FannedSettling => {
                if self.samples >= lasts(SETTLING) {
                    let is_fanned = self.phase == Phase::FannedSettling;
                    self.enter(if is_fanned { Phase::FannedMeasuring } else { Phase::Measuring });
                }
                self.hold(control, celsius, target, power)
            }
            Phase::Measuring | Phase::FannedMeasuring => {
                self.powers += power;
                self.rises += self.celsius - ROOM_CELSIUS;
                if self.samples >= lasts(MEASURING) {
                    self.measured(target - 0.5 * slope_rise);
                }
                self.hold(control, celsius, target, power)
            }
            Phase::Found | Phase::Failed => 0.0,
        }
    }

    /// Returns the power by the model known so far.
    fn hold(&self, control: &mut ModelLoop, celsius: f32, target: f32, power: f32) -> f32 {
        let fan_power = if self.wants_fan() { u8::MAX } else { 0 };
        let cooling = Cooling { fan_power, filament_mm_per_s: 0.0 };
        if self.has_ended() { 0.0 } else { control.power(&self.model, celsius, target, power, &cooling) }
    }

    /// Begins to hold the target by a first model, whose loss is guessed: a third of the power. The
    /// loop finds the rest.
    fn begin_holding(&mut self) {
        let peak_s = self.peak_samples as f32 * SAMPLE_S;
        let power_w = self.model.power_w;
        let loss_w = power_w / 3.0;
        let capacity_j_per_k = (power_w - loss_w) / self.slope;
        let lag_s = (self.rise + loss_w / capacity_j_per_k * peak_s) / self.slope;
        self.model.capacity_j_per_k = capacity_j_per_k;
        self.model.sensor_per_s = response(lag_s);
        self.model.loss_w_per_k = loss_w / (self.highest - ROOM_CELSIUS);
        self.model.fanned_loss_w_per_k = self.model.loss_w_per_k;
        self.go_on(Phase::Settling);
    }

    /// Works out the model from the power that held the target. The slope was measured around
    /// `slope_celsius`.
    fn measured(&mut self, slope_celsius: f32) {
        let count = self.samples as f32;
        let stored_w = self.model.capacity_j_per_k * (self.celsius - self.begun_celsius) / (count * SAMPLE_S);
        let loss_w_per_k = (self.model.power_w * self.powers / count - stored_w) / (self.rises / count);
        if self.phase == Phase::FannedMeasuring {
            self.model.fanned_loss_w_per_k = loss_w_per_k.max(self.model.loss_w_per_k);
            return self.go_on(Phase::Found);
        }
        let peak_s = self.peak_samples as f32 * SAMPLE_S;
        let loss_w = loss_w_per_k * (self.highest - ROOM_CELSIUS);
        let mut lag_s = self.rise / self.slope;
        let mut capacity_j_per_k = 0.0;
        // Each takes the other: they agree to a thousandth after four turns.
        for _ in 0..4 {
            let block_celsius = slope_celsius + self.slope * lag_s;
            capacity_j_per_k = (self.model.power_w - loss_w_per_k * (block_celsius - ROOM_CELSIUS)) / self.slope;
            lag_s = (self.rise + loss_w / capacity_j_per_k * peak_s) / self.slope;
        }
        self.model.capacity_j_per_k = capacity_j_per_k;
        self.model.sensor_per_s = response(lag_s);
        // A first fan, until its power is known: they take up to as much again as the air.
        let fanned = if self.has_fan { FIRST_FAN * loss_w_per_k } else { loss_w_per_k };
        (self.model.loss_w_per_k, self.model.fanned_loss_w_per_k) = (loss_w_per_k, fanned);
        self.go_on(if self.has_fan { Phase::FannedSettling } else { Phase::Found });
    }

    /// Continues with a model that a heater can have.
    fn go_on(&mut self, phase: Phase) {
        self.enter(if self.model.is_possible() { phase } else { Phase::Failed });
    }
}
