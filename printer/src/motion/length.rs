//! Lengths as texts show them.

use ferrostep_gcode::Real;

/// A length as replies show it, mm.
pub(crate) fn mm(length_10nm: i64) -> Real {
    Real::fixed(length_10nm as f64 / 100_000.0, 2)
}
