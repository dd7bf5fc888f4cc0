//! The relay of an autotune (M303), with full power below the target and no power above it, and the
//! response of the temperature.
//!
//! After each switching the temperature continues for the heater's delay. For a heater that answers
//! a change of power by a change of slope `k` (degrees a second at full power) after a delay `L`,
//! and is on for a share `x` of the time:
//!
//! - the swing, from the lowest temperature to the highest, is `k L + 2 h`, with `h` the distance
//!   of the switching points from the target ([`HALF_WIDTH_CELSIUS`]);
//! - a cycle takes `(L + 2 h / k) / (x (1 - x))`.
//!
//! Both hold for any share, so that the power need not be balanced first. The relay needs no other
//! knowledge of the heater.

use super::sample_time::SAMPLE_S;

/// Distance of the switching points from the target, degrees: well above a thermistor's noise.
pub const HALF_WIDTH_CELSIUS: f32 = 0.25;

/// Cycles without an entry: what heating up has left must pass, and so must a change of the fan.
const UNCOUNTED_CYCLES: u8 = 1;

/// Longest time between two switchings, samples: 20 minutes, Marlin's.
pub const MAX_HALF_CYCLE_SAMPLES: u32 = 20 * 60 * 100;
/// The same of a chamber, whose walls are warmed as well: an hour.
pub const MAX_HALF_CYCLE_OF_CHAMBER_SAMPLES: u32 = 3 * MAX_HALF_CYCLE_SAMPLES;

/// Times of several cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cycles {
    /// Samples with power.
    on: u32,
    /// All samples.
    all: u32,
}

impl Cycles {
    /// Share of the time with power.
    fn share(self) -> f32 {
        self.on as f32 / self.all.max(1) as f32
    }
}

/// A heater as the relay sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelayFindings {
    /// Change of the slope by full power, degrees a second.
    pub slope_per_power: f32,
    /// Time from a change of power until the temperature answers, s.
    pub delay_s: f32,
    /// Power that holds the target, 0 to 1.
    pub holding_power: f32,
    /// Power that the part-cooling fan takes, 0 to 1.
    pub fan_power: f32,
    /// Mean time of a cycle, s.
    pub cycle_s: f32,
}

/// Progress of a relay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RelayProgress {
    /// The tuning continues: number of cycles ended, and the lowest and highest temperature
    /// of the last one.
    Cycles {
        /// Cycles that have ended.
        ended: u8,
        /// Cycles in all.
        of: u8,
        /// Lowest temperature, degrees Celsius.
        lowest_celsius: f32,
        /// Highest temperature, degrees Celsius.
        highest_celsius: f32,
    },
    /// The tuning has ended.
    Found(RelayFindings),
    /// A half of a cycle has taken more than 20 minutes, of a chamber an hour, or the swing
    /// gives no result.
    Failed,
}

/// A relay at work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relay {
    still: Cycles,
    fanned: Cycles,
    /// Sum of the swings of the counted cycles without the fan, degrees.
    swings: f32,
    /// Lowest temperature of this cycle so far, and of the last one, degrees Celsius.
    lowest: f32,
    last_lowest: f32,
    /// Highest temperature since the heater was last switched off, degrees Celsius.
    highest: f32,
    /// Samples of this cycle so far, with power and without.
    on: u32,
    off: u32,
    /// Cycles to count, each without the fan and with it.
    counted: u8,
    ended: u8,
    has_fan: bool,
    is_on: bool,
    has_failed: bool,
}

impl Relay {
    /// A relay that counts this number of cycles, and as many again with the part-cooling fan if
    /// the heater has one.
    pub const fn new(counted: u8, has_fan: bool) -> Self {
        Self {
            still: Cycles { on: 0, all: 0 },
            fanned: Cycles { on: 0, all: 0 },
            swings: 0.0,
            lowest: f32::INFINITY,
            last_lowest: 0.0,
            highest: f32::NEG_INFINITY,
            on: 0,
            off: 0,
            counted,
            ended: 0,
            has_fan,
            is_on: true,
            has_failed: false,
        }
    }

    /// Cycles of one part: without the fan, or with it.
    const fn part(&self) -> u8 {
        self.counted.saturating_add(UNCOUNTED_CYCLES)
    }

    const fn cycles(&self) -> u8 {
        if self.has_fan { self.part().saturating_mul(2) } else { self.part() }
    }

    /// Returns true if it is over, with findings or without.
    pub fn has_ended(&self) -> bool {
        self.has_failed || self.ended >= self.cycles()
    }

    /// Returns true if the fan has to turn at full power now.
    pub fn wants_fan(&self) -> bool {
        self.has_fan && self.ended >= self.part() && !self.has_ended()
    }

    /// Power for the next sample: 0 or 1. It fails where a half of a cycle takes more than
    /// `longest_samples`.
    pub fn power(&mut self, celsius: f32, target: f32, longest_samples: u32) -> f32 {
        if self.has_ended() {
            return 0.0;
        }
        if self.is_on {
            self.on += 1;
            if celsius > target + HALF_WIDTH_CELSIUS {
                self.is_on = false;
                self.highest = celsius;
            }
            self.lowest = self.lowest.min(celsius);
            self.has_failed = self.on > longest_samples;
        } else {
            self.off += 1;
            self.highest = self.highest.max(celsius);
            if celsius < target - HALF_WIDTH_CELSIUS {
                self.end_cycle();
                self.lowest = celsius;
            }
            self.has_failed = self.off > longest_samples;
        }
        f32::from(u8::from(self.is_on && !self.has_failed))
    }

    /// A cycle begins and ends when the heater is switched on.
    fn end_cycle(&mut self) {
        let (on, all) = (self.on, self.on + self.off);
        let in_part = self.ended % self.part();
        if in_part >= UNCOUNTED_CYCLES {
            let is_still = self.ended < self.part();
            let cycles = if is_still { &mut self.still } else { &mut self.fanned };
            cycles.on += on;
            cycles.all += all;
            if is_still {
                self.swings += self.highest - self.lowest;
            }
        }
        self.last_lowest = self.lowest;
        (self.on, self.off, self.is_on) = (0, 0, true);
        self.ended += 1;
    }

    /// Returns its progress.
    pub fn progress(&self) -> RelayProgress {
        let (ended, of) = (self.ended, self.cycles());
        if self.has_failed {
            RelayProgress::Failed
        } else if ended < of {
            RelayProgress::Cycles { ended, of, lowest_celsius: self.last_lowest, highest_celsius: self.highest }
        } else {
            self.findings().map_or(RelayProgress::Failed, RelayProgress::Found)
        }
    }

    fn findings(&self) -> Option<RelayFindings> {
        let counted = f32::from(self.counted.max(1));
        let share = self.still.share();
        let swing = self.swings / counted;
        let cycle_s = self.still.all as f32 * SAMPLE_S / counted;
        let slope_per_power = swing / (cycle_s * share * (1.0 - share));
        let delay_s = (swing - 2.0 * HALF_WIDTH_CELSIUS) / slope_per_power;
        let fan_power = if self.has_fan { (self.fanned.share() - share).max(0.0) } else { 0.0 };
        let is_sound = slope_per_power.is_finite() && slope_per_power > 0.0 && delay_s > 0.0;
        is_sound.then_some(RelayFindings { slope_per_power, delay_s, holding_power: share, fan_power, cycle_s })
    }
}
