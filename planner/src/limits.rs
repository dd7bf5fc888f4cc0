//! What the machine may do: feed, acceleration and junction limits, in mm and seconds.

/// Number of axes a limit is kept for: X, Y, Z and the extruder, in this order.
pub const AXES: usize = 4;

/// Limits that hold along every path. All values are in mm, mm/s, mm/s^2 and mm/s^3 and greater than zero.
///
/// M201, M203, M204 and M205 change them between moves; a block keeps those it was planned with.
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
    /// How far the arc that rounds a corner may stay from it, mm (Yu 2019, delta; M205 J).
    pub junction_deviation_mm: f64,
}
