//! s(t) of a block: how long its phases are, in path and in time.

use crate::TICKS_PER_SECOND;
use crate::block::{PlannedBlock, Speed};
use crate::kinematics::UNITS_PER_MM;
use crate::look_ahead::Part;
use crate::real::Real;
use crate::s_curve::FrequencyTable;
use crate::s_curve::law::{Along, Curve};
use crate::s_curve::staircase::Staircase;

/// Bits of fraction in a time unit: it is 2^-16 tick.
pub const FRACTION_BITS: u32 = 16;

/// Half a tick, in time units: added before the fraction is cut, it rounds.
pub(crate) const HALF_TICK: u64 = 1 << (FRACTION_BITS - 1);

/// Ticks that one unit of path (10 nm) takes at one unit of speed (2^-16 mm/s).
const TICKS: f64 = 65_536.0 * TICKS_PER_SECOND as f64 / UNITS_PER_MM as f64;

/// The same in time units.
const TIME: f64 = TICKS * (1u64 << FRACTION_BITS) as f64;

/// Change of the squared speed over one unit of path at one unit of acceleration (2^-8 mm/s^2): v^2 = v0^2 + 2as.
const GAIN: f64 = 2.0 / 256.0 / UNITS_PER_MM as f64 * 65_536.0 * 65_536.0;

/// Longest block whose law is worked out in f32, in time units: a quarter of a second. Its steps are then within a few
/// ticks of f64's, a small part of the microsecond (84 ticks) that is allowed.
const LONGEST_IN_F32: f32 = 0.25 * TICKS_PER_SECOND as f32 * (1u64 << FRACTION_BITS) as f32;

/// A trapezoid of speed over time: acceleration, cruise, deceleration, any of them possibly empty.
///
/// Lengths are in units of 10 nm, speeds in units of 2^-16 mm/s, times in units of 2^-16 tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trapezoid<F> {
    /// Path length of the whole.
    pub(crate) length: F,
    /// Its reciprocal.
    pub(crate) per_length: F,
    /// Speed at the start.
    pub(crate) entry: F,
    /// Speed of the cruise, or where the ramps meet.
    pub(crate) peak: F,
    /// Speed at the end.
    pub(crate) exit: F,
    /// Change of the squared speed over a unit of path in the ramps.
    pub(crate) gain: F,
    /// Path length of the acceleration.
    pub(crate) up: F,
    /// Path length of the cruise.
    pub(crate) cruise: F,
    /// Path length of the deceleration.
    pub(crate) down: F,
    /// Duration of the acceleration.
    pub(crate) up_time: F,
    /// Duration of the whole.
    pub(crate) duration: F,
}

/// Difference of the squares, a >= b, without the cancellation: the difference of integers is exact.
#[inline]
fn difference_of_squares<F: Real>(a: u32, b: u32) -> F {
    F::from_u32(a.saturating_sub(b)) * (F::from_u32(a) + F::from_u32(b))
}

/// Time for a length at a constant speed.
#[inline]
pub(crate) fn cruise_time<F: Real>(length: F, speed: F) -> F {
    F::constant(TIME) * length / speed
}

/// Time for a length between two speeds. 2X/(v1 + v2) has no division by a small difference.
#[inline]
pub(crate) fn ramp_time<F: Real>(length: F, from: F, to: F) -> F {
    if length > F::ZERO { F::constant(2.0 * TIME) * length / (from + to) } else { F::ZERO }
}

/// Steps a tick for a unit of speed, at `per_spacing` steps a unit of length.
#[inline]
pub(crate) fn steps_per_tick<F: Real>(per_spacing: F) -> F {
    per_spacing * F::constant(1.0 / TICKS)
}

impl<F: Real> Trapezoid<F> {
    /// The trapezoid of a planned block (Wu 2024, eqs. 8, 9 and 12, misprints mended).
    ///
    /// X1 = (v^2 - v1^2)/2a, X2 = (v^2 - v2^2)/2a, X3 = S - X1 - X2; without room for a cruise the peak is
    /// sqrt((2aS + v1^2 + v2^2)/2). Where quantised end speeds differ by a hair more than `a` allows over S, the
    /// whole block is one ramp between them.
    #[inline]
    fn new(planned: &PlannedBlock) -> Self {
        let (v1, v2) = (planned.entry.0, planned.exit.0);
        let v = planned.block.nominal.0.max(v1).max(v2).max(1);
        let length = F::from_u32(planned.block.length_10nm.max(1));
        let (entry, exit) = (F::from_u32(v1), F::from_u32(v2));
        let gain = F::from_u32(planned.block.acceleration.quantised()) * F::constant(GAIN);
        let mut law = Self {
            length,
            per_length: F::from_u32(1) / length,
            entry,
            peak: F::from_u32(v),
            exit,
            gain,
            up: F::ZERO,
            cruise: length,
            down: F::ZERO,
            up_time: F::ZERO,
            duration: F::ZERO,
        };
        if v > v1 || v > v2 {
            law.add_ramps(v1, v, v2);
        }
        let mut duration = F::ZERO;
        if law.up > F::ZERO {
            law.up_time = ramp_time(law.up, entry, law.peak);
            duration = law.up_time;
        }
        if law.cruise > F::ZERO {
            duration = duration + cruise_time(law.cruise, law.peak);
        }
        if law.down > F::ZERO {
            duration = duration + ramp_time(law.down, law.peak, exit);
        }
        law.duration = duration;
        law
    }

    /// Takes from the cruise what the ramps between these speeds need.
    #[inline]
    fn add_ramps(&mut self, v1: u32, v: u32, v2: u32) {
        let length = self.length;
        let per_gain = F::from_u32(1) / self.gain;
        let up = difference_of_squares::<F>(v, v1) * per_gain;
        let down = difference_of_squares::<F>(v, v2) * per_gain;
        let cruise = length - up - down;
        if cruise >= F::ZERO {
            (self.up, self.cruise, self.down) = (up, cruise, down);
            return;
        }
        self.cruise = F::ZERO;
        let change = difference_of_squares::<F>(v1.max(v2), v1.min(v2));
        let whole = length * self.gain;
        if change >= whole {
            self.gain = change * self.per_length;
            (self.up, self.down, self.peak) =
                if v2 > v1 { (length, F::ZERO, self.exit) } else { (F::ZERO, length, self.entry) };
            return;
        }
        let half = F::constant(0.5);
        // The longer of the ramps: v^2 = v1^2 + 2a X1 = v2^2 + 2a (S - X1), solved for X1.
        let longer = (length + change * per_gain) * half;
        let shorter = length - longer;
        let (faster, slower) = if v2 > v1 { (self.exit, self.entry) } else { (self.entry, self.exit) };
        let peak = (slower * slower + self.gain * longer).square_root();
        self.peak = if peak > faster { peak } else { faster };
        (self.up, self.down) = if v2 > v1 { (longer, shorter) } else { (shorter, longer) };
    }

    /// Duration in whole ticks, the nearest.
    #[inline]
    pub(crate) fn duration_ticks(&self) -> u64 {
        self.duration.to_u64().saturating_add(HALF_TICK) >> FRACTION_BITS
    }

    /// When a path position is reached, in time units from the block's start; positions outside are taken to the
    /// nearer end.
    pub(crate) fn time_at(&self, length_10nm: u32) -> u64 {
        let position = F::from_u32(length_10nm);
        let rest = self.length - position;
        if position <= self.up {
            let here = (self.entry * self.entry + self.gain * position).square_root();
            return ramp_time(position, self.entry, here).to_u64();
        }
        if rest <= F::ZERO {
            return self.duration.to_u64();
        }
        if rest < self.down {
            let here = (self.exit * self.exit + self.gain * rest).square_root();
            return (self.duration - ramp_time(rest, here, self.exit)).to_u64();
        }
        (self.up_time + cruise_time(position - self.up, self.peak)).to_u64()
    }
}

/// The time law of a block: a trapezoid, in the precision that its duration asks for, or another.
#[derive(Clone, Copy, Debug)]
pub struct TimeLaw(pub(crate) Precision);

#[derive(Clone, Copy, Debug)]
pub(crate) enum Precision {
    Short(Trapezoid<f32>),
    Long(Trapezoid<f64>),
    /// Of an S-curve.
    Run(Along),
    /// Of a table of frequencies.
    Staircase(Staircase),
}

impl TimeLaw {
    /// The trapezoid of a planned block, Wu 2024.
    #[inline]
    pub fn trapezoid(planned: &PlannedBlock) -> Self {
        let short = Trapezoid::<f32>::new(planned);
        if short.duration <= LONGEST_IN_F32 { Self(Precision::Short(short)) } else { Self::long(planned) }
    }

    /// The S-curve of a run along one of its blocks, and the speed at the block's end (Li 2017).
    pub fn of_part(part: &Part) -> (Self, Speed) {
        Self::along(&Curve::new(&part.run), part)
    }

    /// The law of a block's run along the block, and the speed at the block's end.
    pub(crate) fn along(curve: &Curve, part: &Part) -> (Self, Speed) {
        let law = Along::new(part.run.jerk.offered(), curve, part.offset_10nm, part.block.length_10nm);
        (Self(Precision::Run(law)), law.exit())
    }

    /// A planned block at the frequencies of a table, Li 2017.
    pub(crate) fn staircase(planned: &PlannedBlock, table: &FrequencyTable) -> Self {
        Self(Precision::Staircase(Staircase::new(planned, table)))
    }

    #[cold]
    #[inline(never)]
    fn long(planned: &PlannedBlock) -> Self {
        Self(Precision::Long(Trapezoid::new(planned)))
    }

    /// When a path position is reached, in time units from the block's start; positions outside are taken to the nearer
    /// end.
    pub(crate) fn time_at(&self, length_10nm: u32) -> u64 {
        match &self.0 {
            Precision::Short(law) => law.time_at(length_10nm),
            Precision::Long(law) => law.time_at(length_10nm),
            Precision::Run(law) => law.time_at(length_10nm),
            Precision::Staircase(law) => law.time_at(length_10nm),
        }
    }

    /// Duration of the block in whole ticks, the nearest.
    pub fn duration_ticks(&self) -> u64 {
        match &self.0 {
            Precision::Short(law) => law.duration_ticks(),
            Precision::Long(law) => law.duration_ticks(),
            Precision::Run(law) => law.duration_ticks(),
            Precision::Staircase(law) => law.duration_ticks(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::{Acceleration, Block};
    use crate::inner_ends::InnerEnds;
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
                inner_ends: InnerEnds::NONE,
            },
            entry: Speed::from_mm_per_s(entry),
            exit: Speed::from_mm_per_s(exit),
        }
    }

    fn seconds(time: f64) -> f64 {
        time / 65_536.0 / f64::from(TICKS_PER_SECOND)
    }

    #[test]
    fn a_full_trapezoid() {
        let law = Trapezoid::<f64>::new(&planned(30.0, 0.0, 100.0, 50.0, 1000.0));
        assert!((seconds(law.up_time) - 0.1).abs() < 1e-12);
        assert!((seconds(law.duration) - 0.3625).abs() < 1e-12);
        assert!((law.up - 500_000.0).abs() < 1e-6 && (law.down - 375_000.0).abs() < 1e-6);
    }

    #[test]
    fn without_cruise_the_peak_is_wu_s() {
        let law = Trapezoid::<f64>::new(&planned(1.0, 0.0, 100.0, 0.0, 1000.0));
        assert!((law.peak / 65_536.0 - 1000f64.sqrt()).abs() < 1e-9);
        assert!((law.up - 50_000.0).abs() < 1e-6 && law.cruise == 0.0);
    }

    #[test]
    fn long_blocks_are_worked_out_in_f64() {
        let is_long = |length_mm: f64| {
            matches!(TimeLaw::trapezoid(&planned(length_mm, 10.0, 10.0, 10.0, 1000.0)).0, Precision::Long(_))
        };
        assert!(!is_long(2.4) && is_long(2.6));
    }

    proptest! {
        #[test]
        fn lengths_and_durations_add_up(
            length in 0.001f64..300.0, entry in 0.0f64..300.0, exit in 0.0f64..300.0,
            nominal in 0.01f64..500.0, acceleration in 1.0f64..20_000.0,
        ) {
            let planned = planned(length, entry, nominal, exit, acceleration);
            let law = Trapezoid::<f64>::new(&planned);
            prop_assert!((law.up + law.cruise + law.down - law.length).abs() <= 1e-9 * law.length);
            prop_assert!(law.up >= 0.0 && law.cruise >= 0.0 && law.down >= 0.0);
            prop_assert!(law.peak >= law.entry && law.peak >= law.exit);
            let mean = |from: f64, to: f64| (from + to) / 2.0;
            let times = [(law.up, mean(law.entry, law.peak)), (law.cruise, law.peak), (law.down, mean(law.peak, law.exit))];
            let sum: f64 = times.iter().filter(|part| part.0 > 0.0).map(|(length, speed)| TIME * length / speed).sum();
            prop_assert!((sum - law.duration).abs() <= 1e-9 * sum);
            let short = Trapezoid::<f32>::new(&planned);
            prop_assert!((f64::from(short.duration) - sum).abs() <= 1e-6 * sum, "{} {}", short.duration, sum);
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
            let planned = planned(length, entry, entry.max(exit) + extra, exit, acceleration);
            let law = Trapezoid::<f64>::new(&planned);
            let allowed = planned.block.acceleration.mm_per_s2();
            for (length, slow) in [(law.up, law.entry), (law.down, law.exit)] {
                if length > 0.0 {
                    let squared = (law.peak * law.peak - slow * slow) / 65_536.0 / 65_536.0;
                    let found = squared / (2.0 * length / 100_000.0);
                    prop_assert!(found <= allowed * 1.001 + 0.01, "{} > {}", found, allowed);
                }
            }
        }

        #[test]
        fn positions_are_reached_in_order(
            length in 0.01f64..300.0, entry in 0.0f64..1.0, exit in 0.0f64..1.0, nominal in 0.1f64..300.0,
            acceleration in 100.0f64..20_000.0, share in 0.0f64..=1.0,
        ) {
            let planned = planned(length, entry * nominal, nominal, exit * nominal, acceleration);
            let law = Trapezoid::<f64>::new(&planned);
            let whole = planned.block.length_10nm;
            let here = (f64::from(whole) * share) as u32;
            prop_assert_eq!(law.time_at(0), 0);
            prop_assert_eq!(law.time_at(whole), law.duration as u64);
            prop_assert!(law.time_at(here) <= law.time_at(here + 1) && law.time_at(here) <= law.duration as u64);
        }
    }
}
