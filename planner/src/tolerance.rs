//! Limits of the speed in a corner and of the acceleration of the moves beside it, so that the
//! filtered path keeps a tolerance.
//!
//! The filters of X and Y take the mean of the plan at times around now: q(t) = E p(t - tau), tau
//! being distributed as the filter's weights and 0 in the mean. Along the path that is a mean of
//! places R, and with the corners at r_c, each turning the direction by a difference k_c of unit
//! vectors, the filtered path is from the planned one by no more than
//!
//! > sum over the corners of k_c m_c,
//! > m_c = min(E(R - r_c)+, E(r_c - R)+) <= v_c G(t - t_c) + a K(t - t_c),
//!
//! where G(u) is how far a filtered ramp is ahead of the ramp, convex on each side and largest
//! at 0, where it is half of E|tau|, and K(u) its integral from |u| outwards, at 0 half of the
//! second moment of one side. Between two corners the bound is convex in time, so it is
//! largest at corners. What of it is the others' there, this module limits by a rule for each
//! corner by itself:
//!
//! - *alone*: both moves beside it last as long as the filter reaches. Nothing else counts, and k
//!   (v G(0) + a K(0)) is all.
//! - *in a crowd*: the velocity jumps by no more than A times the time of the shorter move beside
//!   it, and the path turns by no more than a radian in the filter's reach H. As G is convex, each
//!   jump of the others is no more than A times the integral of G over the move's own time around
//!   it, together 2 A K(0), less what the corner's own time covers. Their terms of K are at most a
//!   K(0) / 3 a side, since the integral of K is no more than H K(0) / 3.
//!
//! Unequal filters of X and Y, and of Z, which has the moving average only, part from a straight
//! line while the speed along it changes: by a |u_x u_y| times the integral of |G_x - G_y|.
//!
//! With a moving average over T the same rule holds the acceleration of the filtered path to 5/4 of
//! what the moves may have, and that of the extruder: it is the change of the velocity within T,
//! divided by T. A lone corner adds to a T its jump J: together sqrt((aT)^2 + J^2 + k J a T). In a
//! crowd moves keep 0.59 of their acceleration, and jumps of no more than 0.65 a d T / (d + T), d
//! being the time of the shorter move, add up to no more than 0.65 a T in any T, since d T / (d +
//! T) is concave. A hundredth of a is left for speeds and lengths that are rounded.

mod filter;

use crate::kinematics::UNITS_PER_MM;
use crate::limits::{larger, smaller};
use crate::path::Path;
use crate::shaping::Shaping;
use crate::square_root::square_root_f32;
use crate::time_units::TICKS_PER_SECOND;
use filter::{Filter, apart};

/// Tolerances of the commanded path, mm.
pub const PATH_TOLERANCE_MM: [f64; 2] = [0.001, 1.0];

/// Share of the tolerance kept back for what the bound leaves out: rounded weights and delays, and
/// Z's filter on slopes.
const KEPT_BACK: f32 = 0.02;

/// The part of the tolerance that acceleration may take beside a lone corner, and in a crowd; the
/// rest is the corner's speed.
const ALONE: f32 = 0.95;
const CROWDED: f32 = 0.85;

/// Acceleration of moves along the path in a crowd, as a multiple of that across it, A. A larger
/// one makes short lines faster, and curves slower.
const ALONG_PER_ACROSS: f32 = 1.5;

/// The least difference of directions that is a corner: single precision does not
/// know smaller ones.
const LEAST_TURN: f32 = 1e-6;

/// Shares of a move's acceleration in a crowd with a moving average: what is left along the path,
/// and what its corners may take.
const ALONG: f32 = 0.59;
const ACROSS: f32 = 0.65;

/// Bisections between a speed that keeps the tolerance and one that does not.
const HALVINGS: u32 = 3;

/// Share of the extruder's acceleration that its jumps at corners may take beside what it
/// has along lines.
const EXTRUDER_JUMPS: f32 = 0.25;

/// The filters' measures, and the tolerance that they are to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PathTolerance {
    /// The tolerance, less what is kept back, mm.
    tolerance_mm: f32,
    /// G(0), s, of the axis with the larger.
    jump_s: f32,
    /// K(0), s^2, of the axis and side with the largest.
    bend_s2: f32,
    /// H: how far from its mean a filter reaches, s; with a moving average no less than that.
    reach_s: f32,
    /// The most weight that is on one side of a mean.
    side: f32,
    /// Integrals of the difference between the G of X and Y, and of these and Z, s^2.
    apart_s2: f32,
    apart_from_z_s2: f32,
    /// T, s; 0 without a moving average.
    smooth_s: f32,
    /// Acceleration A in a crowd, mm/s^2.
    across_mm_per_s2: f32,
    /// ... and the acceleration along the path.
    along_mm_per_s2: f32,
}

/// One of the moves at a corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beside<'a> {
    pub path: &'a Path,
    /// The acceleration that the machine allows it, mm/s^2.
    pub allowed: f32,
    /// Acceleration that its other end leaves of that, mm/s^2.
    pub acceleration: f32,
}

/// Limits of a corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Corner {
    /// The speed in it, mm/s.
    pub mm_per_s: f32,
    /// The accelerations of the moves before and after it, mm/s^2.
    pub accelerations: [f32; 2],
}

impl PathTolerance {
    /// Tolerance for these filters; `None` if they do not change the path.
    #[cold]
    pub fn new(tolerance_mm: f64, shaping: &Shaping) -> Option<Self> {
        const PER_SECOND: f32 = 1.0 / TICKS_PER_SECOND as f32;
        const SQUARED: f32 = PER_SECOND * PER_SECOND;
        let Shaping { x: kernel_x, y: kernel_y, smooth_ticks, .. } = shaping;
        let half_average = 0.5 * *smooth_ticks as f32;
        let (x, y) = (Filter::of(kernel_x, half_average), Filter::of(kernel_y, half_average));
        let smooth_s = 2.0 * half_average * PER_SECOND;
        let jump_s = larger(x.jump, y.jump) * PER_SECOND;
        if jump_s <= 0.0 {
            return None;
        }
        let apart_from_z = larger(kernel_x.variance() as f32, kernel_y.variance() as f32);
        let reach = larger(x.reach, y.reach);
        let tolerance_mm = (1.0 - KEPT_BACK) * tolerance_mm as f32;
        let bend_s2 = larger(x.bend, y.bend) * SQUARED;
        let apart_s2 = apart(kernel_x, kernel_y, half_average, reach) * SQUARED;
        let turns_s2 = ALONG_PER_ACROSS * (2.0 / 3.0 * bend_s2 + 0.5 * apart_s2);
        let across_mm_per_s2 = CROWDED * tolerance_mm / (2.0 * bend_s2 + turns_s2);
        Some(Self {
            tolerance_mm,
            jump_s,
            bend_s2,
            reach_s: larger(reach * PER_SECOND, smooth_s),
            side: larger(x.weight, y.weight),
            apart_s2,
            apart_from_z_s2: 0.5 * apart_from_z * SQUARED,
            smooth_s,
            across_mm_per_s2,
            along_mm_per_s2: ALONG_PER_ACROSS * across_mm_per_s2,
        })
    }

    /// The acceleration of moves in a crowd, mm/s^2; in proportion to the tolerance.
    pub fn crowded_mm_per_s2(&self) -> f32 {
        self.along_mm_per_s2
    }

    /// The acceleration of a move by itself, mm/s^2: on its line it parts from it by no more
    /// than the tolerance.
    pub fn along(&self, path: &Path, acceleration: f32) -> f32 {
        if path.length <= 0.0 {
            return acceleration;
        }
        let (plane, slope) = self.apart_along(path);
        let in_plane = smaller(acceleration, ALONE * self.tolerance_mm / plane);
        smaller(in_plane, KEPT_BACK * self.tolerance_mm / slope)
    }

    /// Difference between the axes' filters on a line for each mm/s^2, s^2: between X and Y, and
    /// between Z and these.
    fn apart_along(&self, path: &Path) -> (f32, f32) {
        let per_length = 1.0 / path.length;
        let [x, y, z] = path.vector.map(|component| (component * per_length).abs());
        (x * y * self.apart_s2, z * larger(x, y) * self.apart_from_z_s2)
    }

    /// The acceleration of a move that keeps the tolerance whatever comes before or after it, in a
    /// stop if need be.
    pub fn beside_any(&self, one: &Beside<'_>) -> f32 {
        smaller(self.along_in_crowd(one), length_mm(one.path) / (self.reach_s * self.reach_s))
    }

    /// Acceleration along the path left in a crowd.
    fn along_in_crowd(&self, one: &Beside<'_>) -> f32 {
        let along = if self.smooth_s > 0.0 { ALONG * one.allowed } else { one.allowed };
        smaller(smaller(along, one.acceleration), self.along_mm_per_s2)
    }

    /// True if a stop of this many ticks is longer than the filters.
    pub fn forgets(&self, ticks: u64) -> bool {
        ticks as f32 >= 2.0 * self.reach_s * TICKS_PER_SECOND as f32
    }

    /// Limits of a corner between two moves that have a path; `nominal_mm_per_s` is the slower
    /// one's nominal speed, and the extruder's acceleration is in mm/s^2.
    pub fn corner(&self, moves: &[Beside<'_>; 2], nominal_mm_per_s: f32, extruder_mm_per_s2: f32) -> Corner {
        let [before, after] = moves;
        let [x, y, z, filament] = Path::jumps(before.path, after.path);
        let turn = square_root_f32(x * x + y * y + z * z);
        let at_rate = ExtruderRule { jump: filament, acceleration: extruder_mm_per_s2 };
        // Included: a line that continues in another with a larger acceleration, which a
        // corner nearby may see.
        let turn = larger(turn, LEAST_TURN);
        let alone = self.alone(moves, turn, &at_rate);
        // Turning more than a radian within their reach they are never in a crowd.
        if turn >= 1.0 || alone.mm_per_s >= nominal_mm_per_s {
            return alone;
        }
        let crowded = self.crowded(moves, turn, &at_rate);
        if crowded.mm_per_s > alone.mm_per_s { crowded } else { alone }
    }

    /// Limits of a corner that is alone in the filters.
    fn alone(&self, moves: &[Beside<'_>; 2], turn: f32, extruder: &ExtruderRule) -> Corner {
        let [(plane_before, _), (plane_after, _)] = moves.each_ref().map(|one| self.apart_along(one.path));
        let of_acceleration = turn * self.bend_s2 + larger(plane_before, plane_after);
        let most = ALONE * self.tolerance_mm / of_acceleration;
        let reach_s = self.reach_s;
        let accelerations = moves.each_ref().map(|one| {
            let least = smaller(one.acceleration, most);
            // Half of a short move's time is left to speed.
            if turn >= 1.0 { smaller(least, length_mm(one.path) / (reach_s * reach_s)) } else { least }
        });
        let [before, after] = accelerations;
        let mut mm_per_s = (self.tolerance_mm - larger(before, after) * of_acceleration) / (turn * self.jump_s);
        for (one, acceleration) in moves.iter().zip(accelerations) {
            // d >= v H + a H^2 / 2: it lasts at least H, whatever its other end is.
            mm_per_s = smaller(mm_per_s, length_mm(one.path) / reach_s - 0.5 * acceleration * reach_s);
        }
        if self.smooth_s > 0.0 {
            let [before, after] = moves;
            let acceleration = smaller(before.allowed, after.allowed);
            // J^2 + k J a T <= (1.24^2 - 1) (a T)^2
            let jump = 0.5 * (square_root_f32(turn * turn + 2.15) - turn) * acceleration * self.smooth_s;
            mm_per_s = smaller(smaller(mm_per_s, jump / turn), self.alone_with_filament(extruder));
        }
        Corner { mm_per_s: larger(mm_per_s, 0.0), accelerations }
    }

    /// The speed at which the flow changes by no more than what the extruder may within
    /// half an average.
    fn alone_with_filament(&self, extruder: &ExtruderRule) -> f32 {
        if self.smooth_s <= 0.0 {
            return f32::INFINITY;
        }
        0.5 * EXTRUDER_JUMPS * extruder.acceleration * self.smooth_s / extruder.jump
    }

    /// Limits of a corner that turns by less than 1, among others.
    fn crowded(&self, moves: &[Beside<'_>; 2], turn: f32, extruder: &ExtruderRule) -> Corner {
        let turn_s = turn * self.reach_s;
        let lengths = moves.each_ref().map(|one| length_mm(one.path));
        let [before_mm, after_mm] = lengths;
        let shorter_mm = smaller(before_mm, after_mm);
        let accelerations =
            moves.each_ref().map(|one| smaller(self.along_in_crowd(one), length_mm(one.path) / (turn_s * turn_s)));
        let mut mm_per_s = self.fitting_in_crowd(turn, shorter_mm);
        for (length_mm, acceleration) in lengths.into_iter().zip(accelerations) {
            // The move lasts at least k H.
            mm_per_s = smaller(mm_per_s, length_mm / turn_s - 0.5 * acceleration * turn_s);
        }
        if self.smooth_s > 0.0 {
            let [before, after] = moves;
            let acceleration = smaller(before.allowed, after.allowed);
            // 1/d <= v / l + sqrt(A / 2 l)
            let [along_before, along_after] = accelerations;
            let along = larger(along_before, along_after);
            let rate = square_root_f32(along / (2.0 * shorter_mm)) + 1.0 / self.smooth_s;
            mm_per_s = smaller(mm_per_s, spread_speed(ACROSS * acceleration / turn, rate, shorter_mm));
            let for_filament = EXTRUDER_JUMPS * extruder.acceleration / extruder.jump;
            mm_per_s = smaller(mm_per_s, spread_speed(for_filament, rate, shorter_mm));
        }
        Corner { mm_per_s: larger(mm_per_s, 0.0), accelerations }
    }

    /// The speed at which a corner beside others keeps the tolerance: its jump, what it covers of
    /// the others', and what it turns.
    fn fitting_in_crowd(&self, turn: f32, shorter_mm: f32) -> f32 {
        let Self { tolerance_mm, jump_s, bend_s2, apart_s2, across_mm_per_s2: across, along_mm_per_s2: along, .. } =
            *self;
        // k v <= A d, d = 2 l / (v + sqrt(v^2 + 2 a l)) being the least time of the shorter move.
        let most = square_root_f32(across * shorter_mm / (turn * (1.0 + 0.5 * ALONG_PER_ACROSS * turn)));
        // k + 2/3 (1 - k/2)^3 is convex: 2/3 at 0, 13/12 at 1.
        let turns_s2 = bend_s2 * (2.0 / 3.0 + 5.0 / 12.0 * turn) + 0.5 * apart_s2;
        let left_mm = tolerance_mm - 2.0 * across * bend_s2 - along * turns_s2;
        let allowed = |covered_s2: f32| (left_mm + across * covered_s2) / (turn * jump_s);
        let covered = |mm_per_s: f32| {
            let root = square_root_f32(mm_per_s * mm_per_s + 2.0 * along * shorter_mm);
            self.covered_s2(2.0 * shorter_mm / (mm_per_s + root))
        };
        if allowed(covered(most)) >= most {
            return most;
        }
        // The slower, the longer the moves last and the more they cover. Lasting k H they keep the
        // others away by half of that, which leaves 2 (1 - k/2)^2 of the 2 for jumps.
        let mut kept = larger(allowed(covered(most)), allowed(1.5 * turn * bend_s2));
        let mut not_kept = most;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (kept + not_kept);
            if allowed(covered(middle)) >= middle { kept = middle } else { not_kept = middle }
        }
        kept
    }

    /// Part of the integral of G covered by a move of this duration, half of it to each side of the
    /// corner: G falls by no more than the weight of a side.
    fn covered_s2(&self, time_s: f32) -> f32 {
        let within_s = smaller(time_s, 2.0 * self.jump_s / self.side);
        within_s * (self.jump_s - 0.25 * self.side * within_s)
    }
}

/// The extruder at a corner.
#[derive(Clone, Copy, Debug)]
struct ExtruderRule {
    /// Change of its share of the path's speed.
    jump: f32,
    /// mm/s^2.
    acceleration: f32,
}

/// The speed v with v (v / l + rate) = `share`: so much of an acceleration, over the jump of a
/// speed of 1, that a corner takes.
fn spread_speed(share: f32, rate: f32, length_mm: f32) -> f32 {
    // Written so that nothing cancels. An infinite share, of a corner without a
    // jump, sets no bound.
    if share > f32::MAX {
        return f32::INFINITY;
    }
    2.0 * share / (rate + square_root_f32(rate * rate + 4.0 * share / length_mm))
}

fn length_mm(path: &Path) -> f32 {
    path.length / UNITS_PER_MM as f32
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::pressure_advance::PressureAdvance;
    use crate::shaping::{AxisShaper, ShaperKind};

    fn tolerance(kind: ShaperKind, smooth_time_s: Option<f64>, tolerance_mm: f64) -> PathTolerance {
        let shaper = AxisShaper { kind, frequency_hz: 50.0, damping: 0.0 };
        let shaping = Shaping::new(&[shaper; 2], smooth_time_s, &PressureAdvance::NONE).unwrap();
        PathTolerance::new(tolerance_mm, &shaping).unwrap()
    }

    /// A corner of this many radians between moves of these lengths, at 3000 mm/s^2.
    fn corner(tolerance: &PathTolerance, angle: f64, lengths_mm: [f64; 2]) -> Corner {
        let [before, after] = lengths_mm.map(|length_mm| length_mm * 1e5);
        let before = Path::along([before.round() as i32, 0, 0]);
        let after = Path::along([(after * angle.cos()).round() as i32, (after * angle.sin()).round() as i32, 0]);
        let beside = [&before, &after].map(|path| Beside { path, allowed: 3000.0, acceleration: 3000.0 });
        tolerance.corner(&beside, 500.0, 5000.0)
    }

    #[test]
    fn a_lone_corner_has_the_speed_of_the_formula() {
        // ZV without damping: E|tau| is a quarter of the period, the variance its square over 16.
        let (mean_s, variance_s2) = (0.005, 0.02 * 0.02 / 16.0);
        for (angle, tolerance_mm) in [(0.5f64, 0.05), (1.0, 0.05), (1.57, 0.1), (3.0, 0.1)] {
            let Corner { mm_per_s, accelerations } =
                corner(&tolerance(ShaperKind::Zv, None, tolerance_mm), angle, [80.0, 90.0]);
            let sine = (angle / 2.0).sin();
            let expected = ((0.98 * tolerance_mm) / sine - 0.5 * 3000.0 * variance_s2) / mean_s;
            assert!((f64::from(mm_per_s) / expected - 1.0).abs() < 1e-3, "{angle}: {mm_per_s} {expected}");
            assert_eq!(accelerations, [3000.0; 2]);
        }
    }

    #[test]
    fn where_not_even_a_stop_keeps_it_the_acceleration_is_lower() {
        // A reversal rounds by a Var / 2.
        let Corner { mm_per_s, accelerations } =
            corner(&tolerance(ShaperKind::Zv, None, 0.02), core::f64::consts::PI, [80.0, 90.0]);
        let rounded_mm = 0.5 * f64::from(accelerations[0]) * 0.02 * 0.02 / 16.0;
        assert!(mm_per_s > 0.0 && rounded_mm < 0.02 && rounded_mm > 0.018, "{mm_per_s} {accelerations:?}");
        // The same beside a short move, which must last as long as the filter reaches.
        let Corner { mm_per_s, accelerations } = corner(&tolerance(ShaperKind::Zv, None, 0.1), 1.57, [0.02, 90.0]);
        assert!(
            mm_per_s > 0.0 && accelerations[0] < 1000.0 && accelerations[1] > 2500.0,
            "{mm_per_s} {accelerations:?}"
        );
    }

    #[test]
    fn nearly_in_line_nothing_is_held() {
        let held = corner(&tolerance(ShaperKind::Mzv, Some(0.008), 0.02), 1e-4, [80.0, 90.0]);
        assert!(held.mm_per_s > 500.0 && held.accelerations == [3000.0; 2], "{held:?}");
    }

    #[test]
    fn filters_that_do_nothing_have_no_tolerance() {
        assert_eq!(PathTolerance::new(0.05, &Shaping::NONE), None);
    }
}
