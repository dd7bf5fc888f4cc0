//! The filters of all axes as one list of delays.

use super::Shaping;
use super::kernel::MAX_IMPULSES;
use super::plan_ring::{PlanPiece, PlanRing};
use crate::kinematics::Kinematics;

/// The most delays: those of X, of Y, and that of Z.
const MAX_TAPS: usize = 2 * MAX_IMPULSES + 1;

/// A delay, and what each axis takes of the plan as it was then.
#[derive(Clone, Copy, Debug)]
struct Tap {
    delay_ticks: u32,
    /// Weights of X, Y, Z and the extruder.
    weights: [f64; 4],
    /// Number of the piece that it sees.
    piece: u32,
}

impl Tap {
    const NONE: Self = Self { delay_ticks: 0, weights: [0.0; 4], piece: 0 };
}

/// Where all motors are, and how fast they go, steps and ticks.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MotorStates {
    pub speed: [f32; 4],
    pub acceleration: [f32; 4],
    pub jerk: [f32; 4],
}

/// The delays of all axes' filters, each with its place in the plan.
///
/// The filters are moved in time so that at constant speed all axes are equally late. The extruder goes with X and Y: where
/// their filters differ, with the mean of both. Z and the extruder without them are as late as X and Y.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taps {
    taps: [Tap; MAX_TAPS],
    count: usize,
    kinematics: Kinematics,
}

impl Taps {
    /// The filters' delays.
    #[cold]
    #[inline(never)]
    pub fn new(shaping: &Shaping, kinematics: Kinematics) -> Self {
        let Shaping { x, y } = shaping;
        let mut taps = Self { taps: [Tap::NONE; MAX_TAPS], count: 0, kinematics };
        let (late_x, late_y) = (x.centroid_ticks(), y.centroid_ticks());
        let late = if late_x > late_y { late_x } else { late_y };
        let whole = |ticks: f64| (ticks + 0.5) as u32;
        for one in x.delayed(whole(late - late_x)).impulses() {
            taps.add(one.delay_ticks, [one.weight, 0.0, 0.0, 0.5 * one.weight]);
        }
        for one in y.delayed(whole(late - late_y)).impulses() {
            taps.add(one.delay_ticks, [0.0, one.weight, 0.0, 0.5 * one.weight]);
        }
        taps.add(whole(late), [0.0, 0.0, 1.0, 0.0]);
        taps
    }

    /// Adds weights at a delay.
    #[cold]
    #[inline(never)]
    fn add(&mut self, delay_ticks: u32, weights: [f64; 4]) {
        let known = self.taps.iter().take(self.count).position(|tap| tap.delay_ticks == delay_ticks);
        let index = known.unwrap_or(self.count);
        let Some(tap) = self.taps.get_mut(index) else { return };
        tap.delay_ticks = delay_ticks;
        for (sum, weight) in tap.weights.iter_mut().zip(weights) {
            *sum += weight;
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

    /// Where all motors are at a tick, steps; the extruder from this place.
    #[inline(never)]
    pub fn positions(&self, tick: u64, ring: &PlanRing, extruder_zero: i64) -> [f64; 4] {
        let mut axes = [0.0; 4];
        for tap in self.taps() {
            let Some(piece) = ring.get(tap.piece) else { continue };
            let ticks = tap.ticks_into(piece, tick);
            // Before the first piece it stands.
            let part = piece.part.position_after(if ticks > 0.0 { ticks } else { 0.0 });
            let [x, y, z, extruder] = piece.motors_at(part, extruder_zero.wrapping_mul(256));
            let [x, y, z] = self.kinematics.position([x, y, z]);
            for ((axis, weight), position) in axes.iter_mut().zip(tap.weights).zip([x, y, z, extruder]) {
                *axis += weight * position;
            }
        }
        let [x, y, z, extruder] = axes;
        let [first, second, third] = self.kinematics.motors([x, y, z]);
        [first, second, third, extruder]
    }

    /// How all motors move from a tick on.
    #[inline(never)]
    pub fn states(&self, tick: u64, ring: &PlanRing) -> MotorStates {
        let mut states = MotorStates::default();
        for tap in self.taps() {
            let Some(piece) = ring.get(tap.piece) else { continue };
            let ticks = tap.ticks_into(piece, tick);
            if ticks < 0.0 {
                continue;
            }
            let motion = piece.part.after(ticks);
            let [dx, dy, dz, de] = piece.line.map(|line| line as f32);
            let [dx, dy, dz] = self.kinematics.position([dx, dy, dz]);
            let weights = tap.weights.map(|weight| weight as f32);
            let [speed, acceleration, jerk] =
                [motion.speed, motion.acceleration, motion.jerk].map(|value| value as f32);
            for (index, (weight, line)) in weights.into_iter().zip([dx, dy, dz, de * (1.0 / 256.0)]).enumerate() {
                let share = weight * line;
                states.add(index, share * speed, share * acceleration, share * jerk);
            }
        }
        states.of_motors(self.kinematics)
    }
}

impl Tap {
    /// Ticks since the piece began, as this tap sees it; not above zero where it stands before the first.
    #[inline]
    fn ticks_into(&self, piece: &PlanPiece, tick: u64) -> f64 {
        let ticks = tick.wrapping_sub(piece.start.wrapping_add(u64::from(self.delay_ticks))).cast_signed();
        ticks as f64
    }
}

impl MotorStates {
    #[inline]
    fn add(&mut self, index: usize, speed: f32, acceleration: f32, jerk: f32) {
        for (values, value) in
            [(&mut self.speed, speed), (&mut self.acceleration, acceleration), (&mut self.jerk, jerk)]
        {
            if let Some(sum) = values.get_mut(index) {
                *sum += value;
            }
        }
    }

    /// From axes to motors.
    fn of_motors(self, kinematics: Kinematics) -> Self {
        let motors = |[x, y, z, extruder]: [f32; 4]| {
            let [first, second, third] = kinematics.motors([x, y, z]);
            [first, second, third, extruder]
        };
        Self { speed: motors(self.speed), acceleration: motors(self.acceleration), jerk: motors(self.jerk) }
    }
}
