//! The table of the kinematics that exist.

use super::cartesian::Cartesian;
use super::core_xy::CoreXy;
use super::core_xz::CoreXz;
use super::linear::{Length, LinearKinematics};

/// Generates the enum of all kinematics from a line each: everything that depends on the kind goes
/// through its functions.
macro_rules! kinematics {
    ($($(#[$about:meta])* $name:ident,)+) => {
        /// Relation between motors and axes.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kinematics {
            $($(#[$about])* $name,)+
        }

        impl Kinematics {
            /// All kinematics.
            pub const ALL: [Self; [$($name::NAME),+].len()] = [$(Self::$name),+];

            /// Name in the profile and the trace.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => $name::NAME,)+ }
            }

            /// Name reported by M115.
            pub const fn reported_name(self) -> &'static str {
                match self { $(Self::$name => $name::REPORTED,)+ }
            }

            /// Letters of the motors that the board names X, Y and Z.
            pub const fn motor_names(self) -> [char; 3] {
                match self { $(Self::$name => $name::MOTORS,)+ }
            }

            /// Motor positions X, Y, Z for a position, in the same unit of length.
            #[inline(always)]
            pub fn motors<T: Length>(self, position: [T; 3]) -> [T; 3] {
                match self { $(Self::$name => $name::motors(position),)+ }
            }

            /// Position for these motor positions, the inverse of [`Self::motors`].
            #[inline(always)]
            pub fn position<T: Length>(self, motors: [T; 3]) -> [T; 3] {
                match self { $(Self::$name => $name::position(motors),)+ }
            }
        }
    };
}

// ANCHOR: table
kinematics! {
    /// One motor an axis.
    Cartesian,
    /// Two fixed motors, both driving X and Y: A = X + Y, B = X - Y.
    CoreXy,
    /// Two fixed motors, both driving X and Z: A = X + Z, C = X - Z.
    CoreXz,
}
// ANCHOR_END: table

impl Kinematics {
    /// Kinematics of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kinematics| kinematics.name() == name)
    }

    /// Mask of the axes that the motors in the mask move; bits above Z are unchanged.
    pub fn axes_of_motors(self, motors: u8) -> u8 {
        let mut axes = motors & !0b111;
        for motor in (0..3).filter(|motor| motors >> motor & 1 == 1) {
            for (axis, distance) in self.position(unit(motor)).into_iter().enumerate() {
                axes |= u8::from(distance != 0) << axis;
            }
        }
        axes
    }

    /// Mask of the motors that move an axis.
    pub fn motors_of_axis(self, axis: usize) -> u8 {
        let moved = self.motors(unit(axis)).into_iter().enumerate();
        moved.fold(0, |motors, (motor, distance)| motors | u8::from(distance != 0) << motor)
    }

    /// True if a motor of this axis also moves another axis.
    pub fn shares_motors(self, axis: usize) -> bool {
        self.axes_of_motors(self.motors_of_axis(axis)) != 1 << axis
    }

    /// Largest speeds of the motors if each axis moves at up to its own: on a diagonal the axes'
    /// contributions add up.
    pub fn largest_motor_feeds(self, axes: [f64; 3]) -> [f64; 3] {
        let mut feeds = [0.0; 3];
        for (axis, feed) in axes.into_iter().enumerate() {
            for (sum, share) in feeds.iter_mut().zip(self.motors(unit(axis))) {
                *sum += feed * share.unsigned_abs() as f64 / UNIT as f64;
            }
        }
        feeds
    }
}

/// An even distance, so that its half is whole.
const UNIT: i64 = 2;

/// Position with one axis, or one motor, moved by a unit.
fn unit(index: usize) -> [i64; 3] {
    core::array::from_fn(|other| if other == index { UNIT } else { 0 })
}

#[cfg(test)]
mod tests;
