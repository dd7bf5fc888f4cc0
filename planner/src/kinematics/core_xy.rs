//! CoreXY: two fixed motors, with one belt or two, move X and Y together.

use super::linear::{Length, LinearKinematics};

/// A = X + Y, B = X - Y.
pub struct CoreXy;

impl LinearKinematics for CoreXy {
    const NAME: &'static str = "corexy";
    const REPORTED: &'static str = "COREXY";
    const MOTORS: [char; 3] = ['A', 'B', 'Z'];

    #[inline(always)]
    fn motors<T: Length>([x, y, z]: [T; 3]) -> [T; 3] {
        [x + y, x - y, z]
    }

    #[inline(always)]
    fn position<T: Length>([a, b, z]: [T; 3]) -> [T; 3] {
        [(a + b).half(), (a - b).half(), z]
    }
}
