//! Moves of prepared jobs as nearly all are: in the plane, at a feed and an acceleration that no axis asks to lower.
//!
//! They are planned as any other move, to the same bits, but what lasts from one to the next is worked out once, and what
//! checks find nothing is asked first by checks that are a little stricter and need two products. Whatever does not pass
//! them goes the long way, which knows.

use super::prepared::OpenPrepared;
use super::{MIN_FEED_MM_PER_S, Planner, PreparedMove, TICKS_PER_10NM_AT_1_MM_PER_S};
use crate::block::{Acceleration, Speed};
use crate::extruder::FILAMENT_UNITS_PER_MM;
use crate::junction::{Pull, radius_in_plane_10nm};
use crate::kinematics::{Kinematics, StepsPerMm, UNITS_PER_MM};
use crate::limits::{larger, smaller};
use crate::look_ahead::{Entry, Slot};
use crate::path::Path;

/// What the stricter checks take off: far more than single precision rounds.
const STRICTER: f32 = 0.999;

/// Filament of a unit of path from which it might move alone, with a path that is rounded.
const MOST_FILAMENT: f32 = 0.5 * (super::MOST_FILAMENT_PER_PATH * super::FILAMENT_UNITS_PER_10NM) as f32;

/// A bit that no feed has.
const PRINTS: u32 = 1 << 31;

/// What moves at one feed, all with filament or all without, have in common.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cruise {
    /// Bits of the feed, mm/s, and whether there is filament.
    key: u32,
    acceleration: Acceleration,
    pull: Pull,
    nominal: Speed,
    /// The most filament, in its units, for a unit of path; below zero where no move passes.
    most_filament: f32,
    /// The shortest path, units of 10 nm, of a move, and of each unit of its filament: events and moves must not come faster
    /// than they may.
    move_10nm: f32,
    filament_10nm: f32,
}

impl Cruise {
    /// None.
    pub const NONE: Self = Self {
        key: 0,
        acceleration: Acceleration::MAX,
        pull: Pull::ZERO,
        nominal: Speed::ZERO,
        most_filament: -1.0,
        move_10nm: 0.0,
        filament_10nm: 0.0,
    };
}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> Planner<S> {
    /// Whether a move stays in the plane, as the one before, draws no filament back, and begins a block.
    #[inline(always)]
    pub(super) fn may_be_plain(&self, prepared: &PreparedMove) -> bool {
        let ([.., z], [.., from_z]) = (prepared.target_10nm(), self.position_10nm);
        z == from_z
            && self.previous.path.is_in_plane()
            && u32::try_from(prepared.filament_100pm).is_ok()
            && prepared.entry != Entry::Continues
    }

    /// Opens the block of a move that [may be plain](Self::may_be_plain); `false`, and nothing has changed, if it is not.
    #[inline(never)]
    pub(super) fn begin_plain(&mut self, prepared: &PreparedMove) -> bool {
        let filament_100pm = prepared.filament_100pm as u32;
        let prints = if filament_100pm != 0 { PRINTS } else { 0 };
        if self.cruise.key ^ prepared.feed_mm_per_s.to_bits() != prints {
            self.cruise = self.cruise_at(prepared.feed_mm_per_s, prints);
        }
        let cruise = &self.cruise;
        let ([x, y, _], [from_x, from_y, _]) = (prepared.target_10nm(), self.position_10nm);
        let mut path = Path::in_plane([x.wrapping_sub(from_x), y.wrapping_sub(from_y)]);
        let filament = filament_100pm as f32;
        path.filament = filament / super::FILAMENT_UNITS_PER_10NM as f32;
        if filament > path.length * cruise.most_filament
            || filament * cruise.filament_10nm + cruise.move_10nm > path.length
        {
            return false;
        }
        let [from_first, from_second, _] = self.motor_steps;
        let Some([first, second]) = self.geometry.plane_steps(x, y) else { return false };
        let Some((extruder, extruder_256ths)) = self.extruder.advanced_if_near(filament_100pm) else { return false };
        // From here on it is plain.
        let open = &mut self.open;
        open.block.steps = [first.wrapping_sub(from_first), second.wrapping_sub(from_second), 0];
        // 43 cm at most, at 10,000 steps/mm.
        open.block.extruder_256ths = extruder_256ths as i32;
        open.block.length_10nm = path.length_10nm();
        open.block.nominal = cruise.nominal;
        open.block.acceleration = cruise.acceleration;
        open.block.line = prepared.line;
        open.block.ends_move = prepared.ends_move;
        open.block.inner_ends.clear();
        // Its events, and what it adds to the block, are worked out if another move joins it.
        open.moves = 1;
        self.open_prepared =
            Some(OpenPrepared { entry: prepared.entry, nominal: cruise.nominal, is_within_budget: true });
        self.extruder_256ths = self.extruder.set_above_zero(extruder);
        [self.position_10nm[0], self.position_10nm[1]] = [x, y];
        [self.motor_steps[0], self.motor_steps[1]] = [first, second];
        let pull = cruise.pull;
        let before = &self.previous;
        let radius = radius_in_plane_10nm(&before.path, &path, self.path_limits.four_deviations_10nm);
        // Zero where there is no move before.
        let speed = pull.weaker(before.pull).speed_along(radius);
        self.open.junction = self.held_in_corner(speed, &path, prepared.line);
        self.previous.path.turn_in_plane(&path);
        self.previous.pull = pull;
        self.previous.unended_line = (!prepared.ends_move).then_some(prepared.line);
        true
    }

    /// What moves at this feed have in common.
    #[cold]
    #[inline(never)]
    fn cruise_at(&self, feed_mm_per_s: f32, prints: u32) -> Cruise {
        let key = feed_mm_per_s.to_bits() ^ prints;
        let none = Cruise { key, ..Cruise::NONE };
        let limits = &self.path_limits;
        let acceleration = if prints != 0 { limits.print_acceleration() } else { limits.travel_acceleration() };
        // NaN is in no range.
        let feeds = MIN_FEED_MM_PER_S as f32..=f32::MAX;
        let Some(filament) = limits
            .filament_in_plane(feed_mm_per_s, acceleration)
            .filter(|_| self.method.is_default() && feeds.contains(&feed_mm_per_s))
            .filter(|_| self.geometry.steps_per_mm.iter().all(StepsPerMm::is_near))
            .filter(|_| !self.geometry.kinematics.shares_motors(2))
        else {
            return none;
        };
        // As long as this, at the feed, are an event and a move.
        let path_of = |ticks: f32| ticks * feed_mm_per_s / TICKS_PER_10NM_AT_1_MM_PER_S;
        let (event_ticks, move_ticks) = self.budget.ticks();
        let event_10nm = path_of(larger(event_ticks, self.geometry.minimum_event_interval_ticks as f32));
        // A path of length s has as many events as the motor that has most steps, a step more for rounding, and the
        // extruder's, one more for rounding and one for good measure: (s k + f e + 3) event + move <= s.
        let [x, y, _, extruder] = self.geometry.steps_per_mm.map(|steps| steps.to_f64() as f32);
        let diagonal = if self.geometry.kinematics == Kinematics::CoreXy { core::f32::consts::SQRT_2 } else { 1.0 };
        let share_left = STRICTER - larger(x, y) * diagonal / UNITS_PER_MM as f32 * event_10nm;
        if share_left <= 0.0 {
            return none;
        }
        let shortest_10nm = (3.0 * event_10nm + path_of(move_ticks)) / share_left;
        Cruise {
            key,
            acceleration: Acceleration::from_mm_per_s2_f32(acceleration),
            pull: Pull::of_mm_per_s2(acceleration),
            nominal: Speed::from_mm_per_s_f32(feed_mm_per_s).max(Speed(1)),
            most_filament: smaller(filament * super::FILAMENT_UNITS_PER_10NM as f32 * STRICTER, MOST_FILAMENT),
            // Not without a way.
            move_10nm: larger(shortest_10nm, 0.5),
            filament_10nm: extruder / FILAMENT_UNITS_PER_MM as f32 * event_10nm / share_left,
        }
    }
}
