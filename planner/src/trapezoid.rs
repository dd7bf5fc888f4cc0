//! The trapezoid: speed at a constant acceleration, with a cruise between.

use crate::block::PlannedBlock;
use crate::kinematics::UNITS_PER_MM;
use crate::piece::{Anchor, Motion, Piece, PieceEnd, Place, time_at};
use crate::real::Real;
use crate::time_units::{FRACTION_BITS, HALF_TICK, UNITS, cruise_time, ramp_time};

/// Change of the squared speed over one unit of path at one unit of acceleration (2^-8 mm/s^2):
/// v^2 = v0^2 + 2as.
const GAIN: f64 = 2.0 / 256.0 / UNITS_PER_MM as f64 * 65_536.0 * 65_536.0;

/// A trapezoid of speed over time: acceleration, cruise, deceleration, any of them possibly empty.
///
/// Lengths are in units of 10 nm, speeds in units of 2^-16 mm/s, times in units of 2^-16 tick.
#[derive(Clone, Copy, Debug)]
pub struct Trapezoid<F> {
    /// Path length of the whole.
    pub(crate) length: F,
    /// Reciprocal of the length.
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

/// Difference of the squares, a >= b, without the cancellation: the difference of
/// integers is exact.
#[inline]
fn difference_of_squares<F: Real>(a: u32, b: u32) -> F {
    F::from_u32(a.saturating_sub(b)) * (F::from_u32(a) + F::from_u32(b))
}

impl<F: Real> Trapezoid<F> {
    /// The trapezoid of a planned block (Wu 2024, eqs. 8, 9 and 12, misprints mended).
    ///
    /// X1 = (v^2 - v1^2)/2a, X2 = (v^2 - v2^2)/2a, X3 = S - X1 - X2; without room for a cruise the
    /// peak is sqrt((2aS + v1^2 + v2^2)/2). Where quantised end speeds differ by a hair more than
    /// `a` allows over S, the whole block is one ramp between them.
    #[inline]
    pub(crate) fn new(planned: &PlannedBlock) -> Self {
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

    /// Pieces with a length: acceleration, cruise and deceleration.
    #[inline]
    pub(crate) fn pieces(&self) -> TrapezoidPieces<F> {
        TrapezoidPieces { law: *self, next: 0 }
    }

    /// Time at a path position, time units from the block's start.
    pub(crate) fn time_at(&self, length_10nm: u32) -> u64 {
        let from_start = F::from_u32(length_10nm);
        time_at(self.pieces(), &Place { from_start, to_end: self.length - from_start }).to_u64()
    }
}

/// The pieces of a trapezoid, in their order.
#[derive(Clone, Copy, Debug)]
pub struct TrapezoidPieces<F> {
    law: Trapezoid<F>,
    next: u8,
}

impl<F: Real> Iterator for TrapezoidPieces<F> {
    type Item = Piece<F>;

    #[inline]
    fn next(&mut self) -> Option<Piece<F>> {
        let Self { law, next } = self;
        if *next == 0 {
            *next = 1;
            if law.up > F::ZERO {
                return Some(Piece {
                    anchor: Anchor::Start,
                    time: F::ZERO,
                    position: F::ZERO,
                    motion: Motion::Accelerated { speed: law.entry, gain: law.gain },
                    end: if law.cruise > F::ZERO || law.down > F::ZERO {
                        PieceEnd::FromStart(law.up)
                    } else {
                        PieceEnd::Last
                    },
                });
            }
        }
        if *next == 1 {
            *next = 2;
            if law.cruise > F::ZERO {
                return Some(Piece {
                    anchor: Anchor::Start,
                    time: law.up_time,
                    position: law.up,
                    motion: Motion::Constant { path: law.peak, time: F::constant(UNITS) },
                    end: if law.down > F::ZERO { PieceEnd::ToEnd(law.down) } else { PieceEnd::Last },
                });
            }
        }
        if *next == 2 {
            *next = 3;
            if law.down > F::ZERO {
                return Some(Piece {
                    anchor: Anchor::End,
                    time: law.duration,
                    position: F::ZERO,
                    motion: Motion::Accelerated { speed: law.exit, gain: law.gain },
                    end: PieceEnd::Last,
                });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TICKS_PER_SECOND;
    use crate::block::{Acceleration, Block, Speed};
    use crate::inner_ends::InnerEnds;
    use crate::methods::Never;
    use crate::time_law::TimeLaw;
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
            matches!(TimeLaw::<Never>::trapezoid(&planned(length_mm, 10.0, 10.0, 10.0, 1000.0)), TimeLaw::Long(_))
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
            let sum: f64 = times.iter().filter(|part| part.0 > 0.0).map(|(length, speed)| UNITS * length / speed).sum();
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
