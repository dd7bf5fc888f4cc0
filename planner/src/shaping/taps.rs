//! The filters of all axes as one list of delays.

use core::num::Wrapping;

use super::fixed::{Mean, PartRates, WEIGHT_BITS, WeightedSum};
use super::kernel::MAX_IMPULSES;
use super::machine_filters::Shaping;
use super::motor_states::MotorStates;
use super::plan_ring::{PlanPiece, PlanRing};
use super::smoothing::{Anchor, MovingAverage, PositionSums, Reference, Seen};
use crate::kinematics::Kinematics;
use crate::pressure_advance::AdvanceSlope;

/// The most delays. Without a moving average: those of X, of Y, that of Z, and the two of the
/// extruder's advance. With one, each delay becomes two, for the start and the end of the average,
/// and the advance has two more.
const MAX_TAPS: usize = 2 * (2 * MAX_IMPULSES + 3) + 2;

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
    /// A moving average ends here; the tap before has its weights.
    is_end: bool,
    /// Number of the piece that it sees.
    piece: u32,
    /// Progress of a moving average in its piece: the number of cells passed, and the positions'
    /// sums up to there.
    cells: u32,
    sums: PositionSums,
}

impl Tap {
    const NONE: Self = Self {
        delay_ticks: 0,
        weights: [0; 4],
        advance: 0,
        motors: 0,
        is_end: false,
        piece: 0,
        cells: 0,
        sums: PositionSums::NONE,
    };
}

/// The delays of all axes' filters, each with its place in the plan.
///
/// The filters are moved in time so that at constant speed all axes are equally late. With an
/// advance the extruder's filter has the variance of the nozzle's path: a weight at that time, and
/// equal ones before and after. These two are where the average of the advance begins and ends, so
/// that they cost no breakpoints of their own. Without an advance, which leaves far more filament
/// in the wrong place than the variance does, the extruder is only as late as the rest.
///
/// With a moving average every delay of X, Y, Z and the extruder is a pair, in the list one after
/// the other: the average between them is what the axes take with the weights of the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taps {
    taps: [Tap; MAX_TAPS],
    count: usize,
    kinematics: Kinematics,
    /// The average of all axes.
    average: MovingAverage,
    /// The mean of the advance.
    advance: Mean,
    /// The weight of each of its two delays, 1/ticks.
    advance_per_tick: f32,
}

impl Taps {
    /// No filters.
    pub const fn new(kinematics: Kinematics) -> Self {
        Self {
            taps: [Tap::NONE; MAX_TAPS],
            count: 0,
            kinematics,
            average: MovingAverage::NONE,
            advance: Mean::NONE,
            advance_per_tick: 0.0,
        }
    }

    /// Sets the filters' delays; in place, as they are large.
    #[cold]
    #[inline(never)]
    pub fn set(&mut self, shaping: &Shaping) {
        let Shaping { x, y, extruder_variance, smooth_ticks, advance_ticks } = shaping;
        self.taps.fill(Tap::NONE);
        self.count = 0;
        self.average = if *smooth_ticks > 0 { MovingAverage::over(*smooth_ticks) } else { MovingAverage::NONE };
        let (late_x, late_y) = (x.centroid_ticks(), y.centroid_ticks());
        let half_advance = advance_ticks / 2;
        let late = if late_x > late_y { late_x } else { late_y };
        // The average has half of its length before its middle, which leaves the advance room.
        let half_average = smooth_ticks / 2;
        let spreads = half_advance > 0 && *extruder_variance > 0.0;
        let least = f64::from(if spreads { half_advance } else { half_advance.saturating_sub(half_average) });
        let late = if late > least { late } else { least };
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
                self.add(one.delay_ticks, if axis == 0 { [weight, 0, 0, 0] } else { [0, weight, 0, 0] });
            }
        }
        let late = whole(late);
        let outer = if half_advance > 0 {
            // Two weights W, so far before and after, have the variance 2 W times its square. At
            // most all of the weight is there.
            let half = f64::from(half_advance);
            whole(0.5 * extruder_variance / (half * half) * f64::from(WHOLE)).min(WHOLE / 2)
        } else {
            0
        };
        self.add(late, [0, 0, WHOLE, WHOLE.wrapping_sub(2 * outer)]);
        (self.advance, self.advance_per_tick) = (Mean::NONE, 0.0);
        if half_advance > 0 {
            for (from_late, advance) in [(half_advance.wrapping_neg(), 1), (half_advance, -1)] {
                if outer > 0 {
                    self.add(late.wrapping_add(from_late), [0, 0, 0, outer]);
                }
                self.add_advance(late.wrapping_add(half_average).wrapping_add(from_late), advance);
            }
            self.advance = Mean::over(half_advance.wrapping_mul(2));
            self.advance_per_tick = 0.5 / half_advance as f32;
        }
    }

    /// True if all axes have a moving average.
    pub const fn is_smooth(&self) -> bool {
        self.average.ticks > 0
    }

    /// Adds weights at a delay; a moving average begins there.
    #[cold]
    #[inline(never)]
    fn add(&mut self, delay_ticks: u32, weights: [u32; 4]) {
        let is_smooth = self.is_smooth();
        let known = self
            .taps()
            .position(|tap| tap.delay_ticks == delay_ticks && (!is_smooth || tap.motors != 0 && !tap.is_end));
        let index = known.unwrap_or(self.count);
        let Some(tap) = self.taps.get_mut(index) else { return };
        tap.delay_ticks = delay_ticks;
        for (sum, weight) in tap.weights.iter_mut().zip(weights) {
            *sum = sum.wrapping_add(weight);
        }
        for (axis, _) in tap.weights.iter().enumerate().filter(|(_, weight)| **weight != 0) {
            tap.motors |= if axis == EXTRUDER { 1 << EXTRUDER } else { self.kinematics.motors_of_axis(axis) };
        }
        let motors = tap.motors;
        let added = if is_smooth { 2 } else { 1 };
        for (tap, delay) in self.taps.iter_mut().skip(index).zip([0, self.average.ticks]).take(added) {
            tap.delay_ticks = delay_ticks.saturating_add(delay);
            tap.motors = motors;
            tap.is_end = delay > 0;
        }
        self.count = self.count.max(index + added);
    }

    /// Adds the start or the end of the advance at a delay.
    #[cold]
    #[inline(never)]
    fn add_advance(&mut self, delay_ticks: u32, advance: i8) {
        let is_smooth = self.is_smooth();
        let known = self.taps().position(|tap| tap.delay_ticks == delay_ticks && !is_smooth);
        let index = known.unwrap_or(self.count);
        let Some(tap) = self.taps.get_mut(index) else { return };
        (tap.delay_ticks, tap.advance) = (delay_ticks, advance);
        self.count = self.count.max(index + 1);
    }

    /// The longest delay, ticks.
    pub fn length_ticks(&self) -> u32 {
        self.taps().map(|tap| tap.delay_ticks).max().unwrap_or(0)
    }

    fn taps(&self) -> impl Iterator<Item = &Tap> {
        self.taps.iter().take(self.count)
    }

    /// Sets every tap to the first piece.
    pub fn rewind(&mut self) {
        for tap in &mut self.taps {
            tap.piece = 0;
            (tap.cells, tap.sums) = (0, PositionSums::NONE);
        }
    }

    /// Moves all taps to a tick, which is not before the last.
    #[inline]
    pub fn move_to(&mut self, tick: u64, ring: &PlanRing, near: &Reference) {
        let is_smooth = self.is_smooth();
        for tap in self.taps.iter_mut().take(self.count) {
            while let Some(next) = ring.get(tap.piece.wrapping_add(1))
                && next.start.wrapping_add(u64::from(tap.delay_ticks)) <= tick
            {
                if is_smooth && let Some(piece) = ring.get(tap.piece) {
                    tap.sums.pass_piece(tap.anchor(piece), next.start.wrapping_sub(piece.start), near);
                    tap.cells = 0;
                }
                tap.piece = tap.piece.wrapping_add(1);
            }
            if is_smooth
                && let Some(piece) = ring.get(tap.piece)
                && let Some(ticks) = tap.ticks_into(piece, tick)
            {
                tap.cells = tap.sums.pass_cells(tap.anchor(piece), ticks, near);
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

    /// Positions of all motors at a tick, 2^-32 step; the extruder's counts from the reference's.
    #[inline(never)]
    pub fn positions(&self, tick: u64, ring: &PlanRing, near: &Reference) -> [i64; 4] {
        let [.., extruder_zero] = near;
        let (mut axes, mut advance_sum) = ([WeightedSum::default(); 4], 0_i64);
        for (index, tap) in self.taps().enumerate() {
            let Some(piece) = ring.get(tap.piece) else { continue };
            // The motors rest before the first piece.
            let ticks = tap.ticks_into(piece, tick).unwrap_or(0);
            let is_of_plan = !self.is_smooth() || tap.advance != 0;
            let part = if is_of_plan { piece.part_after(ticks) } else { 0 };
            if tap.advance != 0 {
                let sum = piece.advance_sum_after(part, ticks);
                advance_sum =
                    if tap.advance > 0 { advance_sum.wrapping_add(sum) } else { advance_sum.wrapping_sub(sum) };
            }
            let [x, y, z, extruder] = if !self.is_smooth() {
                piece.motors_at(part, tap.motors, extruder_zero.wrapping_mul(256))
            } else if tap.motors != 0
                && !tap.is_end
                && let Some(end) = self.taps.get(index + 1)
                && let Some(ended) = ring.get(end.piece)
            {
                self.average.between(tap.seen(piece, tick), end.seen(ended, tick), near)
            } else {
                continue;
            };
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

    /// Motion of all motors from a tick on.
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
    /// Ticks since the piece began, as this tap sees it; `None` before the first piece.
    #[inline]
    fn ticks_into(&self, piece: &PlanPiece, tick: u64) -> Option<u64> {
        tick.checked_sub(piece.start.wrapping_add(u64::from(self.delay_ticks)))
    }

    /// Progress in the piece that it sees.
    #[inline]
    fn anchor<'a>(&self, piece: &'a PlanPiece) -> Anchor<'a> {
        Anchor { piece, cells: self.cells, motors: self.motors }
    }

    /// The plan's time at which it sees the plan: below zero before the first piece.
    #[inline]
    fn seen<'a>(&'a self, piece: &'a PlanPiece, tick: u64) -> Seen<'a> {
        let ticks = tick.wrapping_sub(piece.start.wrapping_add(u64::from(self.delay_ticks))).cast_signed();
        (&self.sums, self.anchor(piece), ticks)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::pressure_advance::PressureAdvance;
    use crate::shaping::{AxisShaper, ShaperKind};

    fn set(shaping: &Shaping, kinematics: Kinematics) -> Taps {
        let mut taps = Taps::new(kinematics);
        taps.set(shaping);
        taps
    }

    #[test]
    fn weights_sum_to_a_whole_exactly() {
        for (kind, frequency_hz) in ShaperKind::EXAMPLES.into_iter().flat_map(|kind| [(kind, 31.0), (kind, 57.3)]) {
            let of = |frequency_hz| AxisShaper { kind, frequency_hz, damping: 0.07 };
            let shaping = Shaping::new(&[of(frequency_hz), of(43.9)], None, &PressureAdvance::NONE).unwrap();
            let taps = set(&shaping, Kinematics::CoreXy);
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
            let shaping = Shaping::new(&shapers, None, &advance).unwrap();
            let taps = set(&shaping, Kinematics::Cartesian);
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
            set(&Shaping::new(&[mzv, mzv], None, advance).unwrap(), Kinematics::Cartesian).count
        };
        // Three of MZV, that of Z, and two of the advance.
        assert_eq!(count(&PressureAdvance { seconds: 0.04, ..PressureAdvance::NONE }), 6);
        assert_eq!(count(&PressureAdvance::NONE), 4);
    }

    #[test]
    fn a_delay_is_as_small_as_its_fields() {
        // The boards' memory has little room: a larger type must be noticed.
        assert_eq!(size_of::<Tap>(), 64);
    }

    #[test]
    fn a_moving_average_of_all_axes_has_room_beside_the_longest_shapers() {
        let of = |frequency_hz| AxisShaper { kind: ShaperKind::ThreeHumpEi, frequency_hz, damping: 0.1 };
        let advance = PressureAdvance { seconds: 0.04, smooth_time_s: Some(0.03), ..PressureAdvance::NONE };
        let shaping = Shaping::new(&[of(60.0), of(43.9)], Some(0.01), &advance).unwrap();
        let taps = set(&shaping, Kinematics::CoreXy);
        // Pairs of five delays of X, five of Y, and three of the extruder, one of them Z's;
        // two of the advance.
        assert_eq!(taps.count, MAX_TAPS);
        for axis in 0..4 {
            let sum: u32 = taps.taps().map(|tap| tap.weights[axis]).sum();
            assert_eq!(sum, 1 << WEIGHT_BITS, "{axis}");
        }
        assert!(taps.length_ticks() >= shaping.y.length_ticks() + shaping.smooth_ticks);
        // All axes are equally late at constant speed: by the middle of the averages,
        // and of the advance.
        let half = f64::from(shaping.smooth_ticks / 2);
        let late = |axis: usize| {
            let delays = taps.taps().map(|tap| f64::from(tap.weights[axis]) * f64::from(tap.delay_ticks));
            delays.sum::<f64>() / f64::from(WHOLE) + half
        };
        let advance: Vec<_> = taps.taps().filter(|tap| tap.advance != 0).map(|tap| tap.delay_ticks).collect();
        let middle = 0.5 * (f64::from(advance[0]) + f64::from(advance[1]));
        for axis in 0..4 {
            assert!((late(axis) - middle).abs() < 2.0, "{axis}: {} {middle}", late(axis));
        }
    }
}
