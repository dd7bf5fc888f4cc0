//! Limits of the machine: feed, acceleration and corners, in mm and seconds.

use crate::kinematics::UNITS_PER_MM;
use crate::square_root::square_root_f32;
use crate::surface::SurfaceBounds;

/// Number of axes with limits: X, Y, Z and the extruder, in this order.
pub const AXES: usize = 4;

/// Limits along every path. All values are in mm, mm/s, mm/s^2 and mm/s^3, and greater than zero.
///
/// M201, M203, M204 and M205 change them between moves; a block keeps those with which it was
/// planned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest speed of X, Y, Z and the filament, mm/s (M203).
    pub max_feed_mm_per_s: [f64; AXES],
    /// Largest acceleration of X, Y, Z and the filament, mm/s^2 (M201).
    pub max_acceleration_mm_per_s2: [f64; AXES],
    /// Acceleration of a move with extrusion, mm/s^2 (M204 P).
    pub print_acceleration_mm_per_s2: f64,
    /// Acceleration of a move without extrusion, mm/s^2 (M204 T).
    pub travel_acceleration_mm_per_s2: f64,
    /// Acceleration of an extruder-only move, mm/s^2 (M204 R).
    pub retract_acceleration_mm_per_s2: f64,
    /// Maximum distance between a corner and the arc that rounds it, mm (Yu 2019, delta; M205 J).
    pub junction_deviation_mm: f64,
    /// Maximum change of speed of X, Y, Z and the filament at a corner, mm/s (M205 X Y Z E,
    /// "jerk"); infinite for an axis limited by the arc alone.
    pub instantaneous_corner_velocity_mm_per_s: [f64; AXES],
}

/// Extruder advance, which takes a share of the extruder's speed and acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ExtruderAdvance {
    /// The largest K, s; 0 without an advance.
    pub seconds: f32,
    /// Time over which the advance is averaged, s.
    pub smooth_time_s: f32,
}

impl ExtruderAdvance {
    /// No advance.
    pub const NONE: Self = Self { seconds: 0.0, smooth_time_s: 1.0 };

    /// Filament feed and acceleration that the advance leaves to the flow.
    pub fn left_to_flow(&self, feed_mm_per_s: f32, acceleration_mm_per_s2: f32) -> FeedAndAcceleration {
        let averages = self.seconds / self.smooth_time_s;
        let by_feed = 0.25 * feed_mm_per_s / self.seconds;
        (0.5 * feed_mm_per_s, smaller(by_feed, acceleration_mm_per_s2 / (1.0 + 2.0 * averages)))
    }
}

/// The limits as used to plan a block: in single precision, for which the Cortex-M4F has
/// instructions; double precision takes some hundred instructions an operation in software.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathLimits {
    /// The filament's limit is that within a line, where the extruder's advance takes a part of it.
    max_feed_mm_per_s: [f32; AXES],
    max_acceleration_mm_per_s2: [f32; AXES],
    /// Limits of the filament alone.
    filament_feed_mm_per_s: f32,
    filament_acceleration_mm_per_s2: f32,
    print_acceleration_mm_per_s2: f32,
    travel_acceleration_mm_per_s2: f32,
    retract_acceleration_mm_per_s2: f32,
    /// The smaller of the feeds of X and Y.
    plane_feed_mm_per_s: f32,
    plane_acceleration_mm_per_s2: f32,
    /// Four times the junction deviation, units of 10 nm.
    pub four_deviations_10nm: f32,
    /// Reciprocals of the instantaneous corner velocities, s/mm; 0 for an axis without one.
    pub per_corner_velocity: [f32; AXES],
    has_corner_velocities: bool,
}

/// Feed, mm/s, and acceleration, mm/s^2, along a path.
pub(crate) type FeedAndAcceleration = (f32, f32);

impl PathLimits {
    /// Limits without the extruder's share for its advance: largest K, s, and the time over which
    /// it is averaged, s.
    ///
    /// The extruder goes at e' + (K / B) times the difference of e' over B. Half of its speed is
    /// left to the flow, a quarter to the advance where the flow accelerates, K e'', and a quarter
    /// where it changes at a corner, (K / B) times the change. Its acceleration is e'' + (K / B)
    /// times a difference of e'', at most 1 + 2 K / B times the flow's.
    pub fn new(limits: &Limits, advance: &ExtruderAdvance) -> Self {
        let [feed_x, feed_y, .., filament_feed] = limits.max_feed_mm_per_s.map(|limit| limit as f32);
        let [acceleration_x, acceleration_y, .., filament_acceleration] =
            limits.max_acceleration_mm_per_s2.map(|limit| limit as f32);
        let mut max_feed_mm_per_s = limits.max_feed_mm_per_s.map(|limit| limit as f32);
        let mut max_acceleration_mm_per_s2 = limits.max_acceleration_mm_per_s2.map(|limit| limit as f32);
        let mut per_corner_velocity = limits.instantaneous_corner_velocity_mm_per_s.map(|limit| 1.0 / limit as f32);
        let ExtruderAdvance { seconds, smooth_time_s } = *advance;
        if seconds > 0.0 {
            let averages = seconds / smooth_time_s;
            let [.., feed] = &mut max_feed_mm_per_s;
            let [.., acceleration] = &mut max_acceleration_mm_per_s2;
            (*feed, *acceleration) = advance.left_to_flow(filament_feed, filament_acceleration);
            let [.., per_velocity] = &mut per_corner_velocity;
            *per_velocity = larger((1.0 + averages) * *per_velocity, averages / (0.25 * filament_feed));
        }
        Self {
            plane_feed_mm_per_s: smaller(feed_x, feed_y),
            plane_acceleration_mm_per_s2: smaller(acceleration_x, acceleration_y),
            max_feed_mm_per_s,
            max_acceleration_mm_per_s2,
            filament_feed_mm_per_s: filament_feed,
            filament_acceleration_mm_per_s2: filament_acceleration,
            print_acceleration_mm_per_s2: limits.print_acceleration_mm_per_s2 as f32,
            travel_acceleration_mm_per_s2: limits.travel_acceleration_mm_per_s2 as f32,
            retract_acceleration_mm_per_s2: limits.retract_acceleration_mm_per_s2 as f32,
            four_deviations_10nm: 4.0 * (limits.junction_deviation_mm * UNITS_PER_MM as f64) as f32,
            per_corner_velocity,
            has_corner_velocities: per_corner_velocity.iter().any(|reciprocal| *reciprocal > 0.0),
        }
    }

    /// True if any axis limits corners by its instantaneous corner velocity.
    #[inline(always)]
    pub fn has_corner_velocities(&self) -> bool {
        self.has_corner_velocities
    }

    /// The filament's acceleration in a line, mm/s^2.
    pub fn line_filament_acceleration_mm_per_s2(&self) -> f32 {
        let [.., filament] = self.max_acceleration_mm_per_s2;
        filament
    }

    /// Limits the feed of a filament-only move.
    pub fn of_filament(&self, feed_mm_per_s: f32) -> FeedAndAcceleration {
        let acceleration = smaller(self.retract_acceleration_mm_per_s2, self.filament_acceleration_mm_per_s2);
        (smaller(feed_mm_per_s, self.filament_feed_mm_per_s), acceleration)
    }

    /// Limits a feed along a path of this length with these travels of X, Y, Z and the filament,
    /// all in units of 10 nm, with or without extrusion.
    ///
    /// An axis with share u of the path allows v / |u| and a / |u|. A multiplication shows whether
    /// the axis limits at all; only then is a division needed.
    #[inline(always)]
    pub fn along(&self, feed_mm_per_s: f32, length: f32, travels: [f32; AXES], prints: bool) -> FeedAndAcceleration {
        let feed = feed_mm_per_s;
        let acceleration = if prints { self.print_acceleration_mm_per_s2 } else { self.travel_acceleration_mm_per_s2 };
        // Nearly all moves are in the plane, at a feed and an acceleration that both axes permit by
        // themselves. Products of numbers that are no larger are never rounded to a larger one, so
        // X, Y and the resting Z set no limit.
        let [x, y, z, filament] = travels;
        let [.., filament_feed] = self.max_feed_mm_per_s;
        let [.., filament_acceleration] = self.max_acceleration_mm_per_s2;
        let any = feed <= self.plane_feed_mm_per_s
            && acceleration <= self.plane_acceleration_mm_per_s2
            && z == 0.0
            && x <= length
            && y <= length
            && feed * filament <= filament_feed * length
            && acceleration * filament <= filament_acceleration * length;
        if any { (feed, acceleration) } else { self.held_along(feed, length, travels, acceleration) }
    }

    /// Version of [`Self::along`] for a Z that also follows a surface.
    ///
    /// Z's part of the path is then |u_z| (1 + fade) + slope_x |u_x| + slope_y |u_y| at most. Along
    /// a straight path that part changes by 2 twist |u_x u_y| + 2 fade' |u_z| for each mm, and Z's
    /// acceleration is a times the part plus v^2 times its change; the change gets at most half of
    /// Z's limit. At the border of two cells Z's speed changes at once, as at a corner.
    #[inline(never)]
    pub fn along_surface(
        &self,
        feed_mm_per_s: f32,
        length: f32,
        travels: [f32; AXES],
        prints: bool,
        surface: &SurfaceBounds,
    ) -> FeedAndAcceleration {
        let [x, y, z, filament] = travels;
        let SurfaceBounds { slope: [slope_x, slope_y], border: [border_x, border_y], twist_per_mm, fade, .. } =
            *surface;
        let in_plane = slope_x * x + slope_y * y;
        let with_surface = z + (z * fade + in_plane);
        let acceleration = if prints { self.print_acceleration_mm_per_s2 } else { self.travel_acceleration_mm_per_s2 };
        let travels = [x, y, with_surface, filament];
        let (mut feed, mut acceleration) = self.held_along(feed_mm_per_s, length, travels, acceleration);
        let [_, _, z_acceleration, _] = self.max_acceleration_mm_per_s2;
        let [_, _, per_z_velocity, _] = self.per_corner_velocity;
        let border = border_x * x + border_y * y;
        if feed * border * per_z_velocity > length {
            feed = length / (border * per_z_velocity);
        }
        let change_per_mm = 2.0 * (twist_per_mm * x * y + surface.fade_per_mm * in_plane * z) / (length * length);
        let part = with_surface / length;
        if feed * feed * change_per_mm + acceleration * part > z_acceleration {
            if feed * feed * change_per_mm > 0.5 * z_acceleration {
                feed = square_root_f32(0.5 * z_acceleration / change_per_mm);
            }
            acceleration = smaller(acceleration, (z_acceleration - feed * feed * change_per_mm) / part);
        }
        (feed, acceleration)
    }

    #[inline(never)]
    fn held_along(&self, feed: f32, length: f32, travels: [f32; AXES], acceleration: f32) -> FeedAndAcceleration {
        let (mut feed, mut acceleration) = (feed, acceleration);
        let axes = travels.iter().zip(&self.max_feed_mm_per_s).zip(&self.max_acceleration_mm_per_s2);
        for ((travel, max_feed), max_acceleration) in axes {
            if feed * travel > max_feed * length {
                feed = max_feed * length / travel;
            }
            if acceleration * travel > max_acceleration * length {
                acceleration = max_acceleration * length / travel;
            }
        }
        (feed, acceleration)
    }
}

/// The larger of two numbers, with the comparison of [`smaller`].
pub(crate) fn larger(one: f32, other: f32) -> f32 {
    if other > one { other } else { one }
}

/// The smaller of two numbers; `f32::min` is a call, because it handles NaN.
pub(crate) fn smaller(one: f32, other: f32) -> f32 {
    if other < one { other } else { one }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::Path;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_not_asked_would_not_have_limited(
            x in prop_oneof![-100_000i32..100_000, -40_000_000i32..40_000_000],
            y in prop_oneof![Just(0), -100_000i32..100_000, -40_000_000i32..40_000_000],
            z in prop_oneof![Just(0), -100i32..100],
            filament in 0u32..1_000_000,
            feed in prop_oneof![Just(200.0f32), 0.1f32..400.0],
            limits in (100.0f64..300.0, 100.0f64..300.0, 500.0f64..3000.0, 500.0f64..3000.0),
            prints in any::<bool>(),
        ) {
            let (feed_x, feed_y, acceleration_x, acceleration_y) = limits;
            let limits = PathLimits::new(&Limits {
                max_feed_mm_per_s: [feed_x, feed_y, 12.0, 120.0],
                max_acceleration_mm_per_s2: [acceleration_x, acceleration_y, 200.0, 5000.0],
                print_acceleration_mm_per_s2: 1000.0,
                travel_acceleration_mm_per_s2: 2000.0,
                retract_acceleration_mm_per_s2: 1500.0,
                junction_deviation_mm: 0.05,
                instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; 4],
            }, &ExtruderAdvance::NONE);
            let path = Path::along([x, y, z]);
            let [x, y, z] = path.vector.map(f32::abs);
            let travels = [x, y, z, filament as f32];
            let acceleration =
                if prints { limits.print_acceleration_mm_per_s2 } else { limits.travel_acceleration_mm_per_s2 };
            let (feed_now, acceleration_now) = limits.along(feed, path.length, travels, prints);
            let (feed, acceleration) = limits.held_along(feed, path.length, travels, acceleration);
            prop_assert_eq!(feed_now.to_bits(), feed.to_bits());
            prop_assert_eq!(acceleration_now.to_bits(), acceleration.to_bits());
        }
    }
}
