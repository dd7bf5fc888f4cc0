//! s(t) of a block: where on its path it is, when.

use crate::block::PlannedBlock;
use crate::square_root::square_root;

/// A stretch of constant acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Phase {
    /// Path position at its start, mm from the block's start.
    pub start_mm: f64,
    /// Length, mm.
    pub length_mm: f64,
    /// Time at its start, s from the block's start.
    pub start_s: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Speed at its start, mm/s.
    pub start_mm_per_s: f64,
    /// Speed at its end, mm/s.
    pub end_mm_per_s: f64,
    /// Acceleration, mm/s^2; negative while slowing down, zero in the cruise.
    pub acceleration_mm_per_s2: f64,
}

/// Number of phases of a [`TimeLaw`].
pub const PHASES: usize = 3;

/// A trapezoid of speed over time: acceleration, cruise, deceleration, any of them possibly empty.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeLaw {
    /// The three phases, in order and without gaps.
    pub phases: [Phase; PHASES],
    /// Duration of the whole, s.
    pub duration_s: f64,
}

impl TimeLaw {
    /// The trapezoid of a planned block (Wu 2024, eqs. 8, 9 and 12, misprints mended).
    ///
    /// X1 = (v^2 - v1^2)/2a, X2 = (v^2 - v2^2)/2a, X3 = S - X1 - X2; without room for a cruise the peak is
    /// sqrt((2aS + v1^2 + v2^2)/2). Where quantised end speeds differ by a hair more than `a` allows over S, the
    /// whole block is one ramp between them.
    pub fn trapezoid(planned: &PlannedBlock) -> Self {
        let length = planned.block.length_mm();
        let (entry, exit) = (planned.entry.mm_per_s(), planned.exit.mm_per_s());
        let (entry_squared, exit_squared) = (planned.entry.squared(), planned.exit.squared());
        let twice_acceleration = 2.0 * planned.block.acceleration.mm_per_s2();
        let nominal = planned.block.nominal.mm_per_s().max(entry).max(exit);

        let ramp = (exit_squared - entry_squared) / length;
        if ramp >= twice_acceleration {
            return Self::joined([(length, entry, exit), (0.0, exit, exit), (0.0, exit, exit)]);
        }
        if -ramp >= twice_acceleration {
            return Self::joined([(0.0, entry, entry), (0.0, entry, entry), (length, entry, exit)]);
        }
        let up = (nominal * nominal - entry_squared) / twice_acceleration;
        let down = (nominal * nominal - exit_squared) / twice_acceleration;
        let cruise = length - up - down;
        if cruise >= 0.0 {
            return Self::joined([(up, entry, nominal), (cruise, nominal, nominal), (down, nominal, exit)]);
        }
        let peak = square_root((twice_acceleration * length + entry_squared + exit_squared) * 0.5).max(entry).max(exit);
        let up = ((peak * peak - entry_squared) / twice_acceleration).min(length);
        Self::joined([(up, entry, peak), (0.0, peak, peak), (length - up, peak, exit)])
    }

    /// When the path position `position_mm` is reached, s from the block's start; positions outside are taken to the
    /// nearer end.
    pub fn time_at(&self, position_mm: f64) -> f64 {
        let mut time_s = 0.0;
        for phase in &self.phases {
            let inside_mm = (position_mm - phase.start_mm).min(phase.length_mm);
            if inside_mm <= 0.0 {
                continue;
            }
            let start = phase.start_mm_per_s;
            let here = square_root(start * start + 2.0 * phase.acceleration_mm_per_s2 * inside_mm);
            let sum = start + here;
            let inside_s = if sum > 0.0 { 2.0 * inside_mm / sum } else { 0.0 };
            time_s = phase.start_s + inside_s.min(phase.duration_s);
        }
        time_s
    }

    /// Phases from their lengths and end speeds.
    fn joined(parts: [(f64, f64, f64); PHASES]) -> Self {
        let mut law = Self::default();
        let (mut start_mm, mut start_s) = (0.0, 0.0);
        for (phase, (length_mm, start, end)) in law.phases.iter_mut().zip(parts) {
            let sum = start + end;
            let empty = length_mm <= 0.0 || sum <= 0.0;
            let duration_s = if empty { 0.0 } else { 2.0 * length_mm / sum };
            *phase = Phase {
                start_mm,
                length_mm,
                start_s,
                duration_s,
                start_mm_per_s: start,
                end_mm_per_s: end,
                acceleration_mm_per_s2: if empty { 0.0 } else { (end - start) / duration_s },
            };
            start_mm += length_mm;
            start_s += duration_s;
        }
        law.duration_s = start_s;
        law
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::{Acceleration, Block, Speed};
    use proptest::prelude::*;

    fn planned(length_mm: f64, entry: f64, nominal: f64, exit: f64, acceleration: f64) -> PlannedBlock {
        PlannedBlock {
            block: Block {
                steps: [1, 0, 0],
                extruder_256ths: 0,
                length_10nm: (length_mm * 100_000.0) as u32,
                nominal: Speed::from_mm_per_s(nominal),
                acceleration: Acceleration::from_mm_per_s2(acceleration),
                line: 1,
                ends_move: true,
                inner_ends: Default::default(),
            },
            entry: Speed::from_mm_per_s(entry),
            exit: Speed::from_mm_per_s(exit),
        }
    }

    #[test]
    fn a_full_trapezoid() {
        let law = TimeLaw::trapezoid(&planned(30.0, 0.0, 100.0, 50.0, 1000.0));
        let durations = law.phases.map(|phase| phase.duration_s);
        assert!((durations[0] - 0.1).abs() < 1e-12);
        assert!((durations[1] - 0.2125).abs() < 1e-12);
        assert!((durations[2] - 0.05).abs() < 1e-12);
    }

    #[test]
    fn without_cruise_the_peak_is_wu_s() {
        let law = TimeLaw::trapezoid(&planned(1.0, 0.0, 100.0, 0.0, 1000.0));
        assert!((law.phases[0].end_mm_per_s - 1000f64.sqrt()).abs() < 1e-9);
        assert!((law.phases[0].length_mm - 0.5).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn lengths_and_durations_add_up(
            length in 0.001f64..300.0, entry in 0.0f64..300.0, exit in 0.0f64..300.0,
            nominal in 0.01f64..500.0, acceleration in 1.0f64..20_000.0,
        ) {
            let law = TimeLaw::trapezoid(&planned(length, entry, nominal, exit, acceleration));
            let total: f64 = law.phases.iter().map(|phase| phase.length_mm).sum();
            let length = planned(length, entry, nominal, exit, acceleration).block.length_mm();
            prop_assert!((total - length).abs() < 1e-9 * length.max(1.0));
            prop_assert!(law.duration_s.is_finite() && law.duration_s > 0.0);
            for phase in law.phases {
                prop_assert!(phase.length_mm >= 0.0 && phase.duration_s >= 0.0);
                let mean = (phase.start_mm_per_s + phase.end_mm_per_s) / 2.0;
                prop_assert!((mean * phase.duration_s - phase.length_mm).abs() < 1e-9 * length.max(1.0));
            }
        }

        #[test]
        fn feasible_ends_keep_the_acceleration(
            length in 0.01f64..300.0, entry in 0.0f64..300.0, share in 0.0f64..=1.0,
            extra in 0.0f64..100.0, acceleration in 10.0f64..20_000.0,
        ) {
            // Any exit between the slowest and the fastest that the length allows.
            let reach = 2.0 * acceleration * length;
            let slowest = (entry * entry - reach).max(0.0).sqrt();
            let fastest = (entry * entry + reach).sqrt();
            let exit = slowest + (fastest - slowest) * share;
            let law = TimeLaw::trapezoid(&planned(length, entry, entry.max(exit) + extra, exit, acceleration));
            for phase in law.phases {
                prop_assert!(phase.acceleration_mm_per_s2.abs() <= acceleration * 1.001 + 0.01, "{:?}", phase);
            }
        }
    }
}
