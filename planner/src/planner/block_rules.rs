//! Planning of a move as a separate block: its steps, its length, and the speeds that machine
//! and limits allow.

use super::move_error::MoveError;
use super::position::{Position, Target};
use crate::block::{Acceleration, Speed};
use crate::bresenham::MAX_STEPS;
use crate::budget::Budget;
use crate::extruder::{Extruder, FILAMENT_UNITS_PER_MM};
use crate::junction::{CornerAcceleration, radius_10nm, speed_of_jumps};
use crate::kinematics::{Geometry, StepsPerMm, UNITS_PER_MM};
use crate::limits::{AXES, ExtruderAdvance, FeedAndAcceleration, Limits, PathLimits, larger, smaller};
use crate::methods::{MotionMethods, StepPattern};
use crate::on_the_way::{EXTRUDER_JUMP_MM_PER_S, stage_jump_mm_per_s};
use crate::path::Path;
use crate::pressure_advance::MOST_FILAMENT_IN_LINE;
use crate::shaping::Shaping;
use crate::surface::{Bed, SurfaceBounds};
use crate::time_units::TICKS_PER_SECOND;
use crate::tolerance::PathTolerance;
use crate::u64_to_f32;

/// Slowest feed that is planned, mm/s; slower ones are raised to it. The longest block then ends
/// within 20 days, which the time base holds.
pub const MIN_FEED_MM_PER_S: f64 = 0.01;

/// A move with more filament than this for its path, 1000 to 1, is planned as an extruder-only
/// move: the extruder's speed cannot follow from a speed along a path so short.
const MAX_FILAMENT_PER_PATH: i64 = 1000;

/// Units of filament in a unit of length.
const FILAMENT_UNITS_PER_10NM: i64 = FILAMENT_UNITS_PER_MM / UNITS_PER_MM;

/// Ticks for 10 nm at 1 mm/s.
const TICKS_PER_10NM_AT_1_MM_PER_S: f32 = (TICKS_PER_SECOND as i64 / UNITS_PER_MM) as f32;

/// The move before, as its successor's corner sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Previous {
    pub path: Path,
    /// Corner acceleration; zero if there is no move before, or it has no path.
    pub acceleration: CornerAcceleration,
    /// The line of which more moves come: those of an arc.
    pub unended_line: Option<u32>,
    /// Length of the travel that it is a part of, units of 10 nm; 0 if it is not part of one.
    pub whole_10nm: f32,
    /// True once no filter sees the path before this move's end.
    pub is_forgotten: bool,
}

impl Previous {
    /// No move before.
    pub const NONE: Self = Self {
        path: Path::NONE,
        acceleration: CornerAcceleration::ZERO,
        unended_line: None,
        whole_10nm: 0.0,
        is_forgotten: true,
    };
}

/// A straight move, its target within reach.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Travel {
    pub target_10nm: [i32; 3],
    /// Filament, units of 0.1 nm.
    pub filament_100pm: i64,
    /// Filament as its corners see it, in units of 0.1 nm: as it was prepared.
    pub corner_filament_100pm: i64,
    pub feed_mm_per_s: f32,
    pub line: u32,
    pub ends_move: bool,
    /// Limits of the travel, if it is a part of one on which filament moves.
    pub part: Option<PartLimits>,
}

/// Limits of a part of a travel on which filament moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PartLimits {
    /// Limits along the path.
    pub feed_mm_per_s: f32,
    pub acceleration_mm_per_s2: f32,
    /// Limits of the filament.
    pub filament_feed_mm_per_s: f32,
    pub filament_acceleration_mm_per_s2: f32,
    /// The length of the travel, units of 10 nm.
    pub whole_10nm: f32,
}

impl PartLimits {
    /// Feed and acceleration of a part of this length, along which this filament
    /// moves, units of 10 nm.
    fn along(&self, length: f32, filament: f32) -> FeedAndAcceleration {
        let Self { feed_mm_per_s, acceleration_mm_per_s2, .. } = *self;
        if filament <= 0.0 {
            return (feed_mm_per_s, acceleration_mm_per_s2);
        }
        let path_per_filament = length / filament;
        (
            smaller(feed_mm_per_s, self.filament_feed_mm_per_s * path_per_filament),
            smaller(acceleration_mm_per_s2, self.filament_acceleration_mm_per_s2 * path_per_filament),
        )
    }
}

/// A move planned by itself: its block, without ends of moves inside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planned {
    pub steps: [i32; 3],
    pub extruder_256ths: i32,
    pub length_10nm: u32,
    pub nominal: Speed,
    pub acceleration: Acceleration,
    pub line: u32,
    pub ends_move: bool,
    /// Maximum number of step events of the move, the extruder's among them.
    pub events: f32,
    /// Bound of the speed at its start, by the corner there.
    pub corner: Speed,
    /// Path of the move.
    pub path: Path,
    /// Acceleration as its corners see it; zero if the filament moves alone.
    pub corner_acceleration: CornerAcceleration,
    /// True for a stop after which no filter sees an earlier path.
    pub is_forgotten: bool,
}

/// Rules that every block of a machine keeps to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockRules<M: MotionMethods> {
    pub geometry: Geometry,
    pub limits: Limits,
    pub path_limits: PathLimits,
    /// Length of a step of the extruder, mm: a division in double precision, which no
    /// block has to make.
    extruder_step_mm: f32,
    /// A step pattern other than step Bresenham.
    pub pattern: Option<M::Pattern>,
    /// Every motor steps in its own time.
    is_shaped: bool,
    advance: ExtruderAdvance,
    /// Tolerance of the filtered path; `None` without a tolerance or without filters.
    pub tolerance: Option<PathTolerance>,
    pub budget: Budget,
    /// Limits on Z for following the bed; `None` while Z follows no bed.
    surface: Option<SurfaceBounds>,
}

impl<M: MotionMethods> BlockRules<M> {
    pub fn new(geometry: Geometry, limits: Limits) -> Self {
        let [.., extruder] = geometry.steps_per_mm;
        Self {
            geometry,
            limits,
            path_limits: PathLimits::new(&limits, &ExtruderAdvance::NONE),
            extruder_step_mm: 1.0 / extruder.to_f64() as f32,
            pattern: None,
            is_shaped: false,
            advance: ExtruderAdvance::NONE,
            tolerance: None,
            budget: Budget::new(&geometry),
            surface: None,
        }
    }

    /// Sets the steps of the extruder in a millimetre of filament.
    pub fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) {
        let [.., extruder] = &mut self.geometry.steps_per_mm;
        *extruder = steps_per_mm;
        self.extruder_step_mm = 1.0 / steps_per_mm.to_f64() as f32;
    }

    /// Sets the length of the filters that shape the axes, in ticks; 0: not shaped.
    pub fn set_shaped_for(&mut self, length_ticks: u32, is_s_curve: bool, has_knee: bool) {
        self.is_shaped = length_ticks > 0;
        self.budget.hold_pieces(length_ticks, is_s_curve, has_knee);
    }

    /// Sets the tolerance of the path for these filters.
    #[cold]
    pub fn set_tolerance(&mut self, tolerance_mm: Option<f64>, shaping: &Shaping) {
        self.tolerance = tolerance_mm.and_then(|tolerance_mm| PathTolerance::new(tolerance_mm, shaping));
    }

    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
        self.path_limits = PathLimits::new(&self.limits, &self.advance);
    }

    /// Sets the surface that the moves to come follow; `None`: no surface.
    pub fn set_surface(&mut self, surface: Option<SurfaceBounds>) {
        self.surface = surface;
    }

    /// The surface that Z follows. An image without a bed has no code for one.
    #[inline(always)]
    fn surface(&self) -> Option<&SurfaceBounds> {
        if M::Bed::PRESENT { self.surface.as_ref() } else { None }
    }

    /// Version of [`PathLimits::along`] that leaves Z what it needs to follow the surface.
    #[inline(always)]
    pub fn limits_along(&self, feed: f32, length: f32, travels: [f32; AXES], prints: bool) -> FeedAndAcceleration {
        match self.surface() {
            None => self.path_limits.along(feed, length, travels, prints),
            Some(surface) => self.path_limits.along_surface(feed, length, travels, prints, surface),
        }
    }

    /// Sets the extruder's advance for the moves to come.
    pub fn set_advance(&mut self, advance: ExtruderAdvance) {
        self.advance = advance;
        self.path_limits = PathLimits::new(&self.limits, &self.advance);
    }

    /// Largest change of the extruder's speed at once where filament moves along a travel, mm/s.
    pub fn extruder_jump_mm_per_s(&self) -> f32 {
        let [.., extruder] = self.limits.instantaneous_corner_velocity_mm_per_s;
        smaller(EXTRUDER_JUMP_MM_PER_S, extruder as f32)
    }

    /// Target of a move; `None` for a move of no length.
    #[inline(always)]
    pub fn target(&self, travel: &Travel, from: &Position) -> Result<Option<Target>, MoveError> {
        // NaN is in no range. `is_finite` takes the number's bits apart.
        if !(travel.feed_mm_per_s > 0.0 && travel.feed_mm_per_s <= f32::MAX) {
            return Err(MoveError::Feed);
        }
        let coordinates_10nm = travel.target_10nm;
        if !Extruder::can_push(self.geometry.steps_per_mm[3], travel.filament_100pm) {
            return Err(MoveError::TooMuchFilament);
        }
        if travel.filament_100pm == 0 && coordinates_10nm == from.coordinates_10nm {
            return Ok(None);
        }
        let motor_steps = self.geometry.motor_steps_from(coordinates_10nm, from.coordinates_10nm, from.motor_steps);
        let steps = differences(motor_steps, from.motor_steps);
        if steps.iter().any(|steps| steps.unsigned_abs() > MAX_STEPS) {
            return Err(MoveError::TooFar);
        }
        let extruder = from.extruder.advanced(travel.filament_100pm);
        let travel_256ths = extruder.position_256ths().wrapping_sub(from.extruder.position_256ths());
        let Ok(extruder_256ths) = i32::try_from(travel_256ths) else { return Err(MoveError::TooMuchFilament) };
        let vector_10nm = differences(coordinates_10nm, from.coordinates_10nm);
        Ok(Some(Target { coordinates_10nm, motor_steps, extruder, vector_10nm, steps, extruder_256ths }))
    }

    /// Plans a move as a separate block, its speed not yet within the budget.
    #[inline(never)]
    pub fn plan(&self, travel: &Travel, target: &Target, before: &Previous) -> Planned {
        let Target { steps, extruder_256ths, .. } = *target;
        let Travel { line, ends_move, .. } = *travel;
        let least = MIN_FEED_MM_PER_S as f32;
        let feed = if travel.feed_mm_per_s < least { least } else { travel.feed_mm_per_s };
        let filament_100pm = travel.filament_100pm.wrapping_abs();
        let filament = filament_10nm(filament_100pm);
        let mut path = Path::along(target.vector_10nm);
        path.filament = if travel.corner_filament_100pm == travel.filament_100pm {
            if filament_100pm == travel.filament_100pm { filament } else { -filament }
        } else {
            filament_10nm(travel.corner_filament_100pm)
        };
        let path_10nm = path.length_10nm();

        let moves_filament_alone =
            i64::from(path_10nm) * (MAX_FILAMENT_PER_PATH * FILAMENT_UNITS_PER_10NM) <= filament_100pm;
        let (length, length_10nm, (mut feed, acceleration)) = if moves_filament_alone {
            let rounded = (filament_100pm + FILAMENT_UNITS_PER_10NM / 2) / FILAMENT_UNITS_PER_10NM;
            (filament, (rounded as u32).max(1), self.path_limits.of_filament(feed))
        } else {
            let [x, y, z] = path.vector.map(f32::abs);
            let prints = filament_100pm != 0;
            let limits = match &travel.part {
                None => self.limits_along(feed, path.length, [x, y, z, filament], prints),
                Some(part) => part.along(path.length, filament),
            };
            (path.length, path_10nm, limits)
        };
        // No motor steps faster than events may follow each other: v / S * steps <= 1 / interval.
        let (densest, least_ticks) = match &self.pattern {
            None => (steps_of_master(steps), 0.0),
            Some(pattern) => (pattern.densest(steps), pattern.least_ticks(steps)),
        };
        let most = larger(densest as f32, extruder_256ths.unsigned_abs() as f32 / 256.0);
        let shortest_ticks = most * self.geometry.minimum_event_interval_ticks as f32;
        let shortest_ticks = larger(shortest_ticks, least_ticks);
        if feed * shortest_ticks > length * TICKS_PER_10NM_AT_1_MM_PER_S {
            feed = length * TICKS_PER_10NM_AT_1_MM_PER_S / shortest_ticks;
        }
        let corner_acceleration = if moves_filament_alone {
            CornerAcceleration::ZERO
        } else {
            CornerAcceleration::of_mm_per_s2(acceleration)
        };
        let has_corner = corner_acceleration.is_some() && before.acceleration.is_some();
        let corner = if has_corner { self.corner(before, &path, corner_acceleration, travel) } else { Speed::ZERO };
        Planned {
            steps,
            extruder_256ths,
            length_10nm,
            nominal: Speed::from_mm_per_s_f32(feed).max(Speed(1)),
            acceleration: Acceleration::from_mm_per_s2_f32(acceleration),
            line,
            ends_move,
            events: self.events(steps, path.filament),
            corner,
            path,
            corner_acceleration,
            is_forgotten: false,
        }
    }

    /// Maximum number of step events of a move: of X, Y, Z and the extruder with this filament,
    /// units of 10 nm. How its steps fall depends on earlier filament; a plan must not, and
    /// so counts one more than it has filament for.
    #[inline(always)]
    fn events(&self, steps: [i32; 3], filament_10nm: f32) -> f32 {
        let motors = match &self.pattern {
            // Saturates nowhere: each is below 2^29.
            None if self.is_shaped => steps.iter().fold(0, |sum, steps| steps.unsigned_abs().wrapping_add(sum)),
            None => steps_of_master(steps),
            Some(pattern) => pattern.events(steps),
        } as f32;
        if filament_10nm == 0.0 {
            return motors;
        }
        motors + 1.0 + filament_10nm.abs() / (self.extruder_step_mm * UNITS_PER_MM as f32)
    }

    /// The radius of the arc in a corner beside a part of a travel: it has room along
    /// all of the travel.
    #[inline(never)]
    fn radius_between_parts(&self, before: &Path, after: &Path) -> f32 {
        radius_10nm(before, after, self.path_limits.four_deviations_10nm)
    }

    /// Bound of the speed in the corner before a path. The axes' instantaneous corner
    /// velocities, if any is set, limit no corner between the chords of an arc: the commanded
    /// path has no corner there.
    #[inline(never)]
    pub fn corner(&self, before: &Previous, path: &Path, acceleration: CornerAcceleration, travel: &Travel) -> Speed {
        let radius = if before.whole_10nm > 0.0 || travel.part.is_some() {
            let whole_10nm = travel.part.as_ref().map_or(0.0, |part| part.whole_10nm);
            self.radius_between_parts(&before.path.of_length(before.whole_10nm), &path.of_length(whole_10nm))
        } else {
            radius_10nm(&before.path, path, self.path_limits.four_deviations_10nm)
        };
        let is_line = |path: &Path| path.filament <= MOST_FILAMENT_IN_LINE * path.length;
        let speed = acceleration.min(before.acceleration).speed_along(radius);
        let mut per_velocity = self.path_limits.per_corner_velocity;
        let [.., per_filament_velocity] = &mut per_velocity;
        // No part of a travel has an advance, whatever filament moves along it.
        match (before.whole_10nm > 0.0, &travel.part) {
            (false, None) => {
                if self.advance.seconds > 0.0 && is_line(&before.path) != is_line(path) {
                    return Speed::ZERO;
                }
                if !self.path_limits.has_corner_velocities() || before.unended_line == Some(travel.line) {
                    return speed;
                }
            }
            (true, Some(part)) => *per_filament_velocity = 1.0 / stage_jump_mm_per_s(part.filament_feed_mm_per_s),
            (is_left, _) => {
                // Filament beside a line needs a stop, as for filament alone: a faster nozzle would
                // round the line's end.
                let beside = if is_left { path } else { &before.path };
                if beside.filament > 0.0 {
                    return Speed::ZERO;
                }
                *per_filament_velocity = 1.0 / self.extruder_jump_mm_per_s();
            }
        }
        let slope = self.surface().map_or([0.0; 2], |surface| surface.slope);
        speed.min(speed_of_jumps(&before.path, path, per_velocity, slope))
    }
}

/// Differences of the components, each below 2^31: positions are within 10^8 steps and 5 m.
#[inline(always)]
fn differences(to: [i32; 3], from: [i32; 3]) -> [i32; 3] {
    let ([to_x, to_y, to_z], [x, y, z]) = (to, from);
    [to_x.wrapping_sub(x), to_y.wrapping_sub(y), to_z.wrapping_sub(z)]
}

/// Filament of units of 0.1 nm in units of 10 nm.
#[inline(always)]
fn filament_10nm(filament_100pm: i64) -> f32 {
    // Up to 43 cm fit in 32 bits, which the processor converts to a float.
    let filament = match u32::try_from(filament_100pm) {
        Ok(filament) => filament as f32,
        Err(_) => u64_to_f32::of_i64(filament_100pm),
    };
    filament / FILAMENT_UNITS_PER_10NM as f32
}

/// Steps of the motor that has most: each of them is an event under step Bresenham.
#[inline(always)]
pub(super) fn steps_of_master([x, y, z]: [i32; 3]) -> u32 {
    x.unsigned_abs().max(y.unsigned_abs()).max(z.unsigned_abs())
}
