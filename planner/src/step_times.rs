//! When each step of one motor is due: s(t) solved for equally spaced path positions.

use crate::TICKS_PER_SECOND;
use crate::square_root::{square_root, square_root_f32};
use crate::time_law::{PHASES, Phase, TimeLaw};

/// Bits of fraction in the times of this module.
pub const FRACTION_BITS: u32 = 16;

/// Time units a second.
const UNITS_PER_SECOND: f64 = TICKS_PER_SECOND as f64 * (1u64 << FRACTION_BITS) as f64;

/// The step times of a motor along one block, in units of 2^-16 tick from the block's start, never decreasing.
///
/// Each phase begins anew from its exact f64 time, so that rounding never adds up over more than a phase. Inside a
/// ramp the interval is 2h/(v_k + v_k+1) with v_k = sqrt(v_0^2 + 2 a h k), in f32; inside the cruise it is constant.
#[derive(Clone, Copy, Debug)]
pub struct StepTimes {
    law: TimeLaw,
    /// Path position of the first step, mm.
    first_mm: f64,
    /// Path length a step, mm.
    spacing_mm: f64,
    /// Steps not yet handed out, the next one included.
    left: u32,
    /// Steps handed out.
    done: u32,
    /// Steps that may be handed out, of which `done` have been.
    limit: u32,
    phase: usize,
    /// Steps of this phase not yet handed out, the next one included.
    left_in_phase: u32,
    /// When the next step is due.
    next: u64,
    pace: Pace,
}

/// How the time advances within a phase.
#[derive(Clone, Copy, Debug)]
enum Pace {
    /// A constant interval.
    Cruise { interval: u64 },
    /// Squared speeds in steps^2/tick^2: at index k from the ramp's slow end, `slow + k * gain`.
    Ramp { slow: f32, gain: f32, index: f32, direction: f32, speed: f32 },
}

impl StepTimes {
    /// `count` steps at path positions `first_mm + k * spacing_mm`, all within the law's length.
    pub fn new(law: &TimeLaw, first_mm: f64, spacing_mm: f64, count: u32) -> Self {
        let mut times = Self {
            law: *law,
            first_mm,
            spacing_mm,
            left: count,
            done: 0,
            limit: count,
            phase: 0,
            left_in_phase: 0,
            next: 0,
            pace: Pace::Cruise { interval: 0 },
        };
        if count > 0 {
            times.enter_phase(0);
        }
        times
    }

    /// Hands out the first `count` steps only, until another limit is set.
    pub fn limit(&mut self, count: u32) {
        self.limit = count.clamp(self.done, self.done + self.left);
    }

    /// When the next step is due; `None` after the last and at the limit.
    #[inline]
    pub fn next_time(&self) -> Option<u64> {
        (self.done < self.limit).then_some(self.next)
    }

    /// In the cruise: the constant interval, and how many steps are left in it and to the limit, the next one included.
    #[inline]
    pub fn cruise(&self) -> Option<(u64, u32)> {
        match self.pace {
            Pace::Cruise { interval } => Some((interval, self.left_in_phase.min(self.limit - self.done))),
            Pace::Ramp { .. } => None,
        }
    }

    /// Takes `count` steps; more than one only where [`Self::cruise`] has as many.
    #[inline]
    pub fn take(&mut self, count: u32) {
        let count = count.min(self.left_in_phase);
        self.left -= count;
        self.done += count;
        self.left_in_phase -= count;
        if self.left_in_phase == 0 {
            if self.left > 0 {
                self.enter_phase(self.phase + 1);
            }
            return;
        }
        match &mut self.pace {
            Pace::Cruise { interval } => self.next += *interval * u64::from(count),
            Pace::Ramp { slow, gain, index, direction, speed } => {
                *index += *direction;
                let faster = square_root_f32(*slow + *index * *gain);
                let interval = INTERVAL_NUMERATOR / (*speed + faster);
                *speed = faster;
                self.next += to_units(interval);
            }
        }
    }

    /// Finds the first phase from `phase` on that has steps, and the exact time of its first one.
    fn enter_phase(&mut self, mut phase: usize) {
        loop {
            let bounds = self.law.phases[phase.min(PHASES - 1)];
            let last = phase + 1 >= PHASES;
            let count = if last {
                self.left
            } else {
                // Steps up to the phase's end; the float is never negative enough to matter and casts saturate.
                let reach = (bounds.start_mm + bounds.length_mm - self.first_mm) / self.spacing_mm + 1.0;
                (reach as u32).saturating_sub(self.done).min(self.left)
            };
            if count == 0 && !last {
                phase += 1;
                continue;
            }
            self.phase = phase;
            self.left_in_phase = count;
            let offset_mm = (self.first_mm + f64::from(self.done) * self.spacing_mm - bounds.start_mm).max(0.0);
            self.start_pace(&bounds, offset_mm);
            return;
        }
    }

    fn start_pace(&mut self, phase: &Phase, offset_mm: f64) {
        let speed_squared = phase.start_mm_per_s * phase.start_mm_per_s;
        let twice_acceleration = 2.0 * phase.acceleration_mm_per_s2;
        let here_squared = (speed_squared + twice_acceleration * offset_mm).max(0.0);
        let sum = phase.start_mm_per_s + square_root(here_squared);
        let delay_s = if offset_mm > 0.0 && sum > 0.0 { 2.0 * offset_mm / sum } else { 0.0 };
        let due = (phase.start_s + delay_s.min(phase.duration_s)) * UNITS_PER_SECOND;
        self.next = self.next.max(due as u64);

        if phase.acceleration_mm_per_s2 == 0.0 {
            let interval = self.spacing_mm / phase.end_mm_per_s * UNITS_PER_SECOND;
            self.pace = Pace::Cruise { interval: interval as u64 };
            return;
        }
        // From mm/s to steps/tick.
        let scale = 1.0 / (self.spacing_mm * f64::from(TICKS_PER_SECOND));
        let gain = (twice_acceleration * self.spacing_mm).abs() * scale * scale;
        // Squared speed at the ramp's slow end, which for a deceleration is its last step.
        let steps_after = f64::from(self.left_in_phase - 1);
        let (slow_squared, index, direction) = if twice_acceleration > 0.0 {
            (here_squared, 0.0, 1.0)
        } else {
            let last_mm = offset_mm + steps_after * self.spacing_mm;
            let to_end_mm = (phase.length_mm - last_mm).max(0.0);
            let end_squared = phase.end_mm_per_s * phase.end_mm_per_s;
            (end_squared - twice_acceleration * to_end_mm, steps_after as f32, -1.0)
        };
        let slow = (slow_squared * scale * scale) as f32;
        let gain = gain as f32;
        let speed = square_root_f32(slow + index * gain);
        self.pace = Pace::Ramp { slow, gain, index, direction, speed };
    }
}

/// 2 steps, in time units a tick.
const INTERVAL_NUMERATOR: f32 = 2.0 * (1u32 << FRACTION_BITS) as f32;

/// A float of time units as an integer; 32 bits serve all but the slowest steps, and cost a tenth on a Cortex-M4.
#[inline]
fn to_units(interval: f32) -> u64 {
    if interval < 4_294_967_040.0 { u64::from(interval as u32) } else { interval as u64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::{Acceleration, Block, PlannedBlock, Speed};
    use proptest::prelude::*;

    /// t(s) by the textbook, in ticks.
    fn exact_tick(law: &TimeLaw, s: f64) -> f64 {
        let phase = law
            .phases
            .iter()
            .rev()
            .find(|phase| phase.length_mm > 0.0 && s >= phase.start_mm)
            .unwrap_or(&law.phases[0]);
        let ds = (s - phase.start_mm).clamp(0.0, phase.length_mm);
        let v = phase.start_mm_per_s;
        let end = (v * v + 2.0 * phase.acceleration_mm_per_s2 * ds).max(0.0).sqrt();
        let dt = if ds > 0.0 { 2.0 * ds / (v + end) } else { 0.0 };
        (phase.start_s + dt) * f64::from(TICKS_PER_SECOND)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn times_meet_the_law_within_a_microsecond(
            entry in 0.0f64..200.0, share in 0.0f64..=1.0, nominal in 0.05f64..400.0, acceleration in 5.0f64..20_000.0,
            count in 1u32..30_000, spacing in 0.001f64..0.02, lead in 0.0f64..1.0, tail in 0.0f64..1.0,
        ) {
            // Whole units of 10 nm, and the spacing to fit.
            let length_10nm = ((f64::from(count - 1) + lead + tail).max(0.01) * spacing * 100_000.0).ceil();
            let length_mm = length_10nm / 100_000.0;
            let entry = entry.min(nominal);
            let reach = 2.0 * acceleration * length_mm;
            let slowest = (entry * entry - reach).max(0.0).sqrt();
            let fastest = (entry * entry + reach).sqrt().min(nominal);
            let exit = slowest + (fastest - slowest) * share;
            let law = TimeLaw::trapezoid(&PlannedBlock {
                block: Block { steps: [1, 0, 0], extruder_256ths: 0, length_10nm: length_10nm as u32, nominal: Speed::from_mm_per_s(nominal),
                    acceleration: Acceleration::from_mm_per_s2(acceleration), line: 1, ends_move: true, inner_ends: Default::default() },
                entry: Speed::from_mm_per_s(entry), exit: Speed::from_mm_per_s(exit),
            });
            prop_assume!(law.duration_s < 20.0);
            let mut times = StepTimes::new(&law, lead * spacing, spacing, count);
            let mut before = 0;
            for k in 0..count {
                let time = times.next_time();
                prop_assert!(time.is_some());
                let time = time.unwrap_or(0);
                prop_assert!(time >= before);
                before = time;
                let exact = exact_tick(&law, (lead + f64::from(k)) * spacing);
                let off = time as f64 / 65_536.0 - exact;
                prop_assert!(off.abs() < 84.0, "step {} of {} is {} ticks off", k, count, off);
                // In the cruise several may be taken at once; the ramp is one by one.
                times.take(1);
            }
            prop_assert_eq!(times.next_time(), None);
        }
    }
}
