//! CoreXZ: two fixed motors move X and Z together, as on the Voron Switchwire; Y has a separate
//! motor.

use super::linear::{Length, LinearKinematics};

/// A = X + Z, C = X - Z.
pub struct CoreXz;

impl LinearKinematics for CoreXz {
    const NAME: &'static str = "corexz";
    const REPORTED: &'static str = "COREXZ";
    const MOTORS: [char; 3] = ['A', 'Y', 'C'];

    #[inline(always)]
    fn motors<T: Length>([x, y, z]: [T; 3]) -> [T; 3] {
        [x + z, y, x - z]
    }

    #[inline(always)]
    fn position<T: Length>([a, y, c]: [T; 3]) -> [T; 3] {
        [(a + c).half(), y, (a - c).half()]
    }
}
