//! The filters of all axes as one list of delays.

use core::num::Wrapping;

use super::Shaping;
use super::fixed::{Mean, PartRates, WEIGHT_BITS, WeightedSum};
use super::kernel::MAX_IMPULSES;
use super::plan_ring::{PlanPiece, PlanRing};
use crate::kinematics::Kinematics;
use crate::pressure_advance::AdvanceSlope;

/// The most delays: those of X, of Y, that of Z, and the two of the extruder's advance.
const MAX_TAPS: usize = 2 * MAX_IMPULSES + 3;

/// Index of the extruder.
const EXTRUDER: usize = 3;

/// A whole weight.
const WHOLE: u32 = 1 << WEIGHT_BITS;

/// A delay, and what each axis takes of the plan as it was then.
#[derive(Clone, Copy, Debug)]
struct Tap {
    delay_ticks: u32,
    /// Weights of X, Y, Z and the extruder, 2^-30: those of each sum to one.
    weights: [u32; 4],
    /// The extruder's advance is the mean between two delays: 1 for the first, -1 for the second.
    advance: i8,
    /// Mask of the motors that move an axis with a weight.
    motors: u8,
    /// Number of the piece that it sees.
    piece: u32,
}

impl Tap {
    const NONE: Self = Self { delay_ticks: 0, weights: [0; 4], advance: 0, motors: 0, piece: 0 };
}

/// How all motors move, steps and ticks.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorStates {
    pub speed: [f32; 4],
    pub acceleration: [f32; 4],
    pub jerk: [f32; 4],
}

/// The delays of all axes' filters, each with its place in the plan.
///
/// The filters are moved in time so that at constant speed all axes are equally late. With an advance the extruder's filter has the
/// variance of the nozzle's path: a weight at that time, and equal ones before and after. These two are where the average of the
/// advance begins and ends, so that they cost no breakpoints of their own. Without an advance, which leaves far more filament in the
/// wrong place than the variance does, the extruder is only as late as the rest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taps {
    taps: [Tap; MAX_TAPS],
    count: usize,
    kinematics: Kinematics,
    /// The mean of the advance.
    advance: Mean,
    /// The weight of each of its two delays, 1/ticks.
    advance_per_tick: f32,
}

impl Taps {
    /// The filters' delays.
    #[cold]
    #[inline(never)]
    pub fn new(shaping: &Shaping, kinematics: Kinematics) -> Self {
        let Shaping { x, y, path_variance, advance_ticks } = shaping;
        let mut taps =
            Self { taps: [Tap::NONE; MAX_TAPS], count: 0, kinematics, advance: Mean::NONE, advance_per_tick: 0.0 };
        let (late_x, late_y) = (x.centroid_ticks(), y.centroid_ticks());
        let half_advance = advance_ticks / 2;
        let late = if late_x > late_y { late_x } else { late_y };
        let late = if late > f64::from(half_advance) { late } else { f64::from(half_advance) };
        let whole = |ticks: f64| (ticks + 0.5) as u32;
        for (axis, kernel, own) in [(0, x, late_x), (1, y, late_y)] {
            let kernel = kernel.delayed(whole(late - own));
            // Differences of rounded sums: together they are a whole.
            let (mut sum, mut before) = (0.0, 0);
            for one in kernel.impulses() {
                sum += one.weight;
                let until = whole(sum * f64::from(WHOLE));
                let weight = until.wrapping_sub(before);
                before = until;
                taps.add(one.delay_ticks, if axis == 0 { [weight, 0, 0, 0] } else { [0, weight, 0, 0] }, 0);
            }
        }
        let late = whole(late);
        let outer = if half_advance > 0 {
            // Two weights W, so far before and after, have the variance 2 W times its square. At most all of the weight is there.
            let half = f64::from(half_advance);
            whole(0.5 * path_variance / (half * half) * f64::from(WHOLE)).min(WHOLE / 2)
        } else {
            0
        };
        taps.add(late, [0, 0, WHOLE, WHOLE.wrapping_sub(2 * outer)], 0);
        if half_advance > 0 {
            taps.add(late.saturating_sub(half_advance), [0, 0, 0, outer], 1);
            taps.add(late.saturating_add(half_advance), [0, 0, 0, outer], -1);
            taps.advance = Mean::over(half_advance.wrapping_mul(2));
            taps.advance_per_tick = 0.5 / half_advance as f32;
        }
        taps
    }

    /// Adds weights at a delay.
    #[cold]
    #[inline(never)]
    fn add(&mut self, delay_ticks: u32, weights: [u32; 4], advance: i8) {
        let known = self.taps.iter().take(self.count).position(|tap| tap.delay_ticks == delay_ticks);
        let index = known.unwrap_or(self.count);
        let Some(tap) = self.taps.get_mut(index) else { return };
        tap.delay_ticks = delay_ticks;
        tap.advance = tap.advance.wrapping_add(advance);
        for (sum, weight) in tap.weights.iter_mut().zip(weights) {
            *sum = sum.wrapping_add(weight);
        }
        for (axis, _) in tap.weights.iter().enumerate().filter(|(_, weight)| **weight != 0) {
            tap.motors |= if axis == EXTRUDER { 1 << EXTRUDER } else { self.kinematics.motors_of_axis(axis) };
        }
        self.count = self.count.max(index + 1);
    }

    /// The longest delay, ticks.
    pub fn length_ticks(&self) -> u32 {
        self.taps().map(|tap| tap.delay_ticks).max().unwrap_or(0)
    }

    fn taps(&self) -> impl Iterator<Item = &Tap> {
        self.taps.iter().take(self.count)
    }

    /// Every tap sees the first piece.
    pub fn rewind(&mut self) {
        for tap in &mut self.taps {
            tap.piece = 0;
        }
    }

    /// Moves all taps to a tick, which is not before the last.
    #[inline]
    pub fn move_to(&mut self, tick: u64, ring: &PlanRing) {
        for tap in self.taps.iter_mut().take(self.count) {
            while let Some(next) = ring.get(tap.piece.wrapping_add(1))
                && next.start.wrapping_add(u64::from(tap.delay_ticks)) <= tick
            {
                tap.piece = tap.piece.wrapping_add(1);
            }
        }
    }

    /// The next tick at which a tap sees another piece; as far as `most` if that is later.
    #[inline]
    pub fn next_change(&self, tick: u64, ring: &PlanRing, most: u64) -> u64 {
        self.taps().fold(most, |soonest, tap| {
            let delay = u64::from(tap.delay_ticks);
            let begins = ring.get(tap.piece).map(|piece| piece.start.wrapping_add(delay)).filter(|&start| start > tick);
            let next = ring.get(tap.piece.wrapping_add(1)).map(|next| next.start.wrapping_add(delay));
            begins.or(next).map_or(soonest, |change| soonest.min(change))
        })
    }

    /// Where all motors are at a tick, 2^-32 step; the extruder from this place, steps.
    #[inline(never)]
    pub fn positions(&self, tick: u64, ring: &PlanRing, extruder_zero: i64) -> [i64; 4] {
        let (mut axes, mut advance_sum) = ([WeightedSum::default(); 4], 0_i64);
        for tap in self.taps() {
            let Some(piece) = ring.get(tap.piece) else { continue };
            // Before the first piece it stands.
            let ticks = tap.ticks_into(piece, tick).unwrap_or(0);
            let part = piece.part_after(ticks);
            if tap.advance != 0 {
                let sum = piece.advance_sum_after(part, ticks);
                advance_sum =
                    if tap.advance > 0 { advance_sum.wrapping_add(sum) } else { advance_sum.wrapping_sub(sum) };
            }
            let [x, y, z, extruder] = piece.motors_at(part, tap.motors, extruder_zero.wrapping_mul(256));
            let [x, y, z] = self.kinematics.position([x, y, z].map(Wrapping));
            for ((axis, weight), position) in axes.iter_mut().zip(tap.weights).zip([x.0, y.0, z.0, extruder]) {
                if weight != 0 {
                    axis.add(position, weight);
                }
            }
        }
        let [x, y, z, extruder] = axes.map(WeightedSum::position);
        let [first, second, third] = self.kinematics.motors([x, y, z].map(Wrapping));
        [first.0, second.0, third.0, extruder.wrapping_add(self.advance.of(advance_sum))]
    }

    /// How all motors move from a tick on.
    #[inline(never)]
    pub fn states(&self, tick: u64, ring: &PlanRing) -> MotorStates {
        const PER_WEIGHT: f32 = 1.0 / (1_u32 << WEIGHT_BITS) as f32;
        const CONSTANT_UNIT: f32 = 1.0 / (1_u32 << 20) as f32;
        let (mut axes, mut advance) = ([PartRates::NONE; 4], PartRates::NONE);
        for tap in self.taps() {
            let Some(piece) = ring.get(tap.piece) else { continue };
            if piece.part.is_at_rest() {
                continue;
            }
            let Some(ticks) = tap.ticks_into(piece, tick) else { continue };
            let rates = piece.rates_after(ticks);
            let [dx, dy, dz, de] = piece.line;
            let [dx, dy, dz] = self.kinematics.position([dx as f32, dy as f32, dz as f32]);
            let line = [dx, dy, dz, de as f32 * (1.0 / 256.0)];
            for ((axis, weight), line) in axes.iter_mut().zip(tap.weights).zip(line) {
                if weight != 0 {
                    axis.add(&rates, weight as f32 * PER_WEIGHT * line);
                }
            }
            if tap.advance != 0 {
                let AdvanceSlope { ticks: slope, constant } = piece.advance;
                let [.., extruder] = line;
                let weight = f32::from(tap.advance) * self.advance_per_tick;
                advance.add(&rates, weight * slope as f32 * extruder);
                advance.speed += weight * constant as f32 * CONSTANT_UNIT;
            }
        }
        let [.., extruder] = &mut axes;
        extruder.add(&advance, 1.0);
        let motors = |rate: fn(&PartRates) -> f32| {
            let [x, y, z, extruder] = axes.each_ref().map(rate);
            let [first, second, third] = self.kinematics.motors([x, y, z]);
            [first, second, third, extruder]
        };
        MotorStates {
            speed: motors(|axis| axis.speed),
            acceleration: motors(|axis| axis.acceleration),
            jerk: motors(|axis| axis.jerk),
        }
    }
}

impl Tap {
    /// Ticks since the piece began, as this tap sees it; `None` where it stands before the first.
    #[inline]
    fn ticks_into(&self, piece: &PlanPiece, tick: u64) -> Option<u64> {
        tick.checked_sub(piece.start.wrapping_add(u64::from(self.delay_ticks)))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::pressure_advance::PressureAdvance;
    use crate::shaping::{AxisShaper, ShaperKind};

    #[test]
    fn weights_sum_to_a_whole_exactly() {
        for (kind, frequency_hz) in ShaperKind::EXAMPLES.into_iter().flat_map(|kind| [(kind, 31.0), (kind, 57.3)]) {
            let of = |frequency_hz| AxisShaper { kind, frequency_hz, damping: 0.07 };
            let shaping = Shaping::new(&[of(frequency_hz), of(43.9)], &PressureAdvance::NONE).unwrap();
            let taps = Taps::new(&shaping, Kinematics::CoreXy);
            for axis in 0..4 {
                let sum: u32 = taps.taps().map(|tap| tap.weights[axis]).sum();
                assert_eq!(sum, 1 << WEIGHT_BITS, "{kind:?} {axis}");
            }
            for tap in taps.taps() {
                // X and Y are both made by A and B.
                assert_eq!(tap.motors & 0b11 == 0b11, tap.weights[0] != 0 || tap.weights[1] != 0);
            }
        }
    }

    /// The extruder's weights: mean delay and variance.
    fn extruder_moments(taps: &Taps) -> (f64, f64) {
        let weights =
            || taps.taps().map(|tap| (f64::from(tap.weights[EXTRUDER]) / f64::from(WHOLE), f64::from(tap.delay_ticks)));
        let mean: f64 = weights().map(|(weight, delay)| weight * delay).sum();
        (mean, weights().map(|(weight, delay)| weight * (delay - mean) * (delay - mean)).sum())
    }

    #[test]
    fn filament_is_spread_as_the_path_is() {
        let of = |kind, frequency_hz| AxisShaper { kind, frequency_hz, damping: 0.1 };
        let advance = |smooth_time_s| PressureAdvance { seconds: 0.04, smooth_time_s, ..PressureAdvance::NONE };
        let none = AxisShaper::NONE;
        let mzv = of(ShaperKind::Mzv, 50.0);
        let squared_second = f64::from(crate::TICKS_PER_SECOND).powi(2);
        // MZV has 32.6e-6 s^2, and a mode of 50 Hz and a damping of 0.1 takes 19.9e-6 of that back.
        for (shapers, advance, expected_s2) in [
            ([mzv, mzv], advance(None), 12.73e-6),
            ([mzv, mzv], advance(Some(0.03)), 12.73e-6),
            ([mzv, mzv], PressureAdvance::NONE, 0.0),
            ([mzv, none], advance(None), 6.36e-6),
            ([none, none], advance(None), 0.0),
            // Half an average of 4 ms is the farthest that there is: its square.
            ([mzv, mzv], advance(Some(0.004)), 4e-6),
        ] {
            let shaping = Shaping::new(&shapers, &advance).unwrap();
            let taps = Taps::new(&shaping, Kinematics::Cartesian);
            let (mean, variance) = extruder_moments(&taps);
            let late = taps.taps().find(|tap| tap.weights[2] != 0).unwrap().delay_ticks;
            assert!((mean - f64::from(late)).abs() < 0.01, "{mean} {late}");
            let variance_s2 = variance / squared_second;
            assert!((variance_s2 - expected_s2).abs() < 0.01e-6, "{shapers:?} {advance:?}: {variance_s2}");
        }
    }

    #[test]
    fn the_extruder_has_no_delays_of_its_own_beside_its_advance() {
        let mzv = AxisShaper { kind: ShaperKind::Mzv, frequency_hz: 50.0, damping: 0.1 };
        let count = |advance: &PressureAdvance| {
            Taps::new(&Shaping::new(&[mzv, mzv], advance).unwrap(), Kinematics::Cartesian).count
        };
        // Three of MZV, that of Z, and two of the advance.
        assert_eq!(count(&PressureAdvance { seconds: 0.04, ..PressureAdvance::NONE }), 6);
        assert_eq!(count(&PressureAdvance::NONE), 4);
    }
}
