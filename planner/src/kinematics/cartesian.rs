//! Cartesian kinematics: one motor per axis.

use super::linear::{Length, LinearKinematics};

/// Machine whose X, Y and Z have a motor each.
pub struct Cartesian;

impl LinearKinematics for Cartesian {
    const NAME: &'static str = "cartesian";
    const REPORTED: &'static str = "Cartesian";
    const MOTORS: [char; 3] = ['X', 'Y', 'Z'];

    #[inline(always)]
    fn motors<T: Length>(position: [T; 3]) -> [T; 3] {
        position
    }

    #[inline(always)]
    fn position<T: Length>(motors: [T; 3]) -> [T; 3] {
        motors
    }
}
